"""What a receiver gets of a tick, and what it can tell of what it did not get."""

from __future__ import annotations

import socket
from contextlib import closing

from iptm_v2x_bridge.datagrams import DatagramSender, EndOfTick

TOO_LONG = bytes(70_000)


def test_the_mark_of_a_tick_counts_what_was_lost_on_the_way() -> None:
    with (
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as receiver,
        closing(DatagramSender("127.0.0.1", _port(receiver))) as sender,
    ):
        sender.repeat_end()  # before the first tick there is nothing to say
        for datagram in (b"first", TOO_LONG, b"third"):
            sender.send(datagram)
        sender.end_tick(5)
        sender.repeat_end()
        heard = [receiver.recv(100) for _ in range(4)]
        assert heard == [b"first", b"third", EndOfTick(5, 3).encode(), EndOfTick(5, 3).encode()]
        assert sender.failed == 1
        sender.sent = 0
        sender.end_tick(0)
        assert EndOfTick.decode(receiver.recv(100)) == EndOfTick(0, 0)


def _port(receiver: socket.socket) -> int:
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(10.0)
    return int(receiver.getsockname()[1])
