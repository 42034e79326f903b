"""The command `send`: its own short help, which loads nothing, in front of the node."""

from __future__ import annotations

import sys
from importlib import import_module

from iptm_core.program import EXIT_OK

SEND = "iptm send"


_SEND_HELP = f"""\
usage: {SEND} [--help] [--ros-args -p NAME:=VALUE ...]

Sends a drive as V2X messages (ETSI CAM) on a UDP port, as a car ahead would send them: with or without path
prediction, lost, late and jittered. By default it follows /clock, so that a bridge with leader_source:=cam
hears the same in every run. All parameters: docs/reference/nodes.md. Examples:

  scripts/iptm send --ros-args -p cycle:=us06 -p foresight:=none -p rate_hz:=1.0
  scripts/iptm send --ros-args -p cycle:=drive.gpx -p loss_probability:=0.2 -p link_delay_s:=0.3
  scripts/iptm send --ros-args -p cycle:=bags/example_us06_120s
  scripts/iptm send --ros-args -p cycle:=traffic.fcd.xml#leader
  scripts/iptm send --ros-args -p sent_drive:=ego -p cycle:=us06 -r __ns:=/car_1
  scripts/iptm send --ros-args -p follow_clock:=false -p trip_start_timestamp_ms:=-1 -p to_address:=192.0.2.7
"""


def main() -> int:
    """Send a drive as messages: the node that does it, with the arguments of the process."""
    if sys.argv[1:2] in (["--help"], ["-h"]):
        print(_SEND_HELP, end="")
        return EXIT_OK
    # The one node among the commands; it ends the process with its exit code.
    import_module("iptm_its.node_sender").main()
    return EXIT_OK
