"""Datagrams to a UDP port, and at the end of every tick its mark.

A sender that follows `/clock` puts the mark behind the datagrams of each tick, through the same socket.
Loopback keeps their order, so a bridge that waits for it receives the same messages before the same tick in
every run.
The mark is not a standard message, and only a bridge in lock-step uses it.
"""

from __future__ import annotations

import socket
import struct
from dataclasses import dataclass

REPEAT_PERIOD_S = 0.2
"""Repeat period of the end-of-tick mark, for a receiver that starts late."""
NOT_ALL_SENT = "some messages could not be sent"
_FORMAT = struct.Struct("!8sqQ")
_NAME = b"iptmtick"


@dataclass(frozen=True)
class EndOfTick:
    """Mark of a sender at the end of a tick.

    Attributes:
        time_ns: the tick, integer nanoseconds of trip time.
        sent: datagrams sent in this trip so far; a receiver that has fewer has lost some.
    """

    time_ns: int
    sent: int

    def encode(self) -> bytes:
        """Return the datagram."""
        return _FORMAT.pack(_NAME, self.time_ns, self.sent)

    @classmethod
    def decode(cls, datagram: bytes) -> EndOfTick | None:
        """Return the decoded datagram, None if it is not an end of a tick."""
        if len(datagram) != _FORMAT.size or not datagram.startswith(_NAME):
            return None
        _, time_ns, sent = _FORMAT.unpack(datagram)
        return cls(time_ns, sent)


class DatagramSender:
    """Sends through one socket; what cannot be sent is lost, as on a radio, and counted.

    Attributes:
        sent: datagrams of this trip so far, lost ones included, marks not.
        failed: datagrams that could not be sent, marks included.
    """

    def __init__(self, address: str, port: int) -> None:
        self._target = (address, port)
        self.sent = 0
        self.failed = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._mark = b""

    def send(self, datagram: bytes) -> None:
        """Send a message."""
        self.sent += 1
        self._send(datagram)

    def end_tick(self, time_ns: int) -> None:
        """Mark the end of a tick: everything that arrives up to it has been sent."""
        self._mark = EndOfTick(time_ns, self.sent).encode()
        self.repeat_end()

    def repeat_end(self) -> None:
        """Repeat the mark of the last tick, if any."""
        if self._mark:
            self._send(self._mark)

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
