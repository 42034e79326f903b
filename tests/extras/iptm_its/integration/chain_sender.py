"""A process that sends what two cars and a signal send in some seconds: CAM, SPATEM and MAPEM, tick by tick.

Usage: chain_sender.py PORT. A receiver in lock-step takes the datagrams of each tick at that tick.
"""

from __future__ import annotations

import sys
from contextlib import closing

from tests.extras.iptm_its.roadside import RED, STATION, lanes, phases
from tests.iptm_v2x_bridge.radio import datagram

from iptm_its.mapem import encode_mapem
from iptm_its.spatem import encode_spatem
from iptm_v2x_bridge.datagrams import DatagramSender
from iptm_v2x_bridge.messages.packets import its_timestamp_ms

TICKS = 6
START_MS = its_timestamp_ms(1_790_000_000 * 10**9)
LEADER, AHEAD = 11, 12
SPEED_M_S = 20.0
LEADER_M, AHEAD_M = 60.0, 96.5
RED_FOR_S = 100.0


def main(port: int) -> None:
    """Send all ticks."""
    with closing(DatagramSender("127.0.0.1", port)) as radio:
        for tick in range(TICKS):
            now_ms = START_MS + 1000 * tick
            for before_ms in (600, 200):
                driven_m = SPEED_M_S * (tick - before_ms / 1000.0)
                for station, rear_m in ((LEADER, LEADER_M), (AHEAD, AHEAD_M)):
                    radio.send(datagram(station, now_ms - before_ms, rear_m + driven_m, SPEED_M_S))
            red = phases(now_ms, (RED, RED_FOR_S, RED_FOR_S))
            radio.send(encode_spatem(STATION, [red]))
            radio.send(encode_mapem(STATION, [lanes()]))
            radio.end_tick(tick * 10**9)


if __name__ == "__main__":
    main(int(sys.argv[1]))
