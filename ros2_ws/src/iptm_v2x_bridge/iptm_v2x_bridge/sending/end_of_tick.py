"""The end of a tick on the wire: after it, everything that arrives up to the tick has been sent.

A sender that follows `/clock` puts it behind the datagrams of each tick, through the same socket. Loopback
keeps their order, so a bridge that waits for it receives the same messages before the same tick in every run.
It is not a standard message, and only a bridge in lock-step uses it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

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
