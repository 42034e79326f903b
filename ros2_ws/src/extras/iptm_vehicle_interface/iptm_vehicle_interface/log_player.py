"""Plays a CAN log with its recorded timing: ``python -m iptm_vehicle_interface.log_player LOG BUS``.

For a drive in shadow from a log. python-can's own player does not reach the loopback bus ``udp:PORT``, which
takes frames of this machine only.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from iptm_core.errors import IptmError, MessageError
from iptm_core.program import EXIT_OK, refused
from iptm_drives.can_files import library
from iptm_vehicle_interface.bus import open_bus

PROGRAM = "log_player"


def play(log: Path, address: str) -> int:
    """Send the frames of a log on a bus; return how many.

    Raises:
        IptmError: the log or the bus cannot be opened.
    """
    can = library("can")
    try:
        reader = can.LogReader(log)
    except (OSError, ValueError) as error:
        raise MessageError(f"{log}: {error}; allowed: a log that python-can reads") from error
    bus, sent = open_bus(address), 0
    try:
        for message in can.MessageSync(reader):
            bus.send(message)
            sent += 1
    finally:
        bus.shutdown()
        reader.stop()
    return sent


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return its exit code."""
    parser = argparse.ArgumentParser(PROGRAM, description=__doc__)
    parser.add_argument("log", type=Path, help="BLF, ASC, candump, or what else python-can reads")
    parser.add_argument("bus", help="such as udp:43113")
    given = parser.parse_args(arguments)
    try:
        print(f"{play(given.log, given.bus)} frames sent")
    except IptmError as error:
        return refused(PROGRAM, error)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
