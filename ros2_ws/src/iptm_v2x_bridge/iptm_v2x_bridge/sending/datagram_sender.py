"""Datagrams to a UDP port, and at the end of every tick its mark."""

from __future__ import annotations

import socket

from iptm_v2x_bridge.sending.end_of_tick import EndOfTick

REPEAT_PERIOD_S = 0.2
"""Repeat period of the end-of-tick mark, for a receiver that starts late."""
NOT_ALL_SENT = "some messages could not be sent"


class DatagramSender:
    """Sends all through one socket, so that loopback keeps its order.

    What cannot be sent is lost, as on a radio, and counted: a full buffer, or a network that is down.

    Attributes:
        sent: datagrams of this trip so far, lost ones included, marks not.
        failed: datagrams that could not be sent, marks included.
    """

    def __init__(self, address: str, port: int) -> None:
        self._target = (address, port)
        self.sent = 0
        self.failed = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._ended: EndOfTick | None = None

    def begin_trip(self) -> None:
        """Count from 0 again."""
        self.sent = 0

    def send(self, datagram: bytes) -> None:
        """Send a message."""
        self.sent += 1
        self._send(datagram)

    def end_tick(self, time_ns: int) -> None:
        """Mark the end of a tick: everything that arrives up to it has been sent."""
        self._ended = EndOfTick(time_ns, self.sent)
        self.repeat_end()

    def repeat_end(self) -> None:
        """Repeat the mark of the last tick, if any."""
        if self._ended is not None:
            self._send(self._ended.encode())

    def report(self) -> dict[str, object]:
        """Return the values for the diagnostics, by name."""
        address, port = self._target
        return {"to": f"{address}:{port}", "sent": self.sent, "not_sent": self.failed}

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()

    def _send(self, datagram: bytes) -> None:
        try:
            self._socket.sendto(datagram, self._target)
        except OSError:
            self.failed += 1
