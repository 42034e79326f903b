"""Datagrams to and from a UDP port, and at the end of every tick its mark.

A sender that follows `/clock` puts the mark behind the datagrams of each tick, through the same socket.
Loopback keeps their order, so a bridge that waits for it receives the same messages before the same tick in
every run. The mark is not a standard message, and only a bridge in lock-step uses it.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections import deque
from dataclasses import dataclass

from iptm_core.errors import ParameterError

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


@dataclass(frozen=True)
class Reception:
    """A datagram as it was received.

    Attributes:
        tick_ns: the first tick that it counts for, trip time.
        received_ns: when it was received, trip time.
        datagram: its bytes.
    """

    tick_ns: int
    received_ns: int
    datagram: bytes


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


MAX_KEPT = 20_000
"""Datagrams kept unread: ten seconds at two thousand a second."""
LONGEST_READ = 2048
"""A longer datagram is cut, and refused for its size."""
_RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024
_STOP_PERIOD_S = 0.2
_SO_RXQ_OVFL = 40  # Linux: how many datagrams the kernel dropped comes along with each one
_COUNTER = struct.Struct("=I")


class DatagramReader:
    """Reads a UDP socket in a thread of its own, so that a busy reader loses nothing.

    The thread only moves bytes; what they mean is left to the caller. When too many are kept, the oldest are
    dropped and counted, those that the kernel dropped too.
    """

    def __init__(self, address: str, port: int) -> None:
        """Open the socket.

        Args:
            address: own address to listen at.
            port: UDP port; 0 takes a free one.

        Raises:
            ParameterError: the socket cannot be had.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            self._socket.bind((address, port))
        except (OSError, OverflowError) as reason:
            self._socket.close()
            raise ParameterError(
                f"cam_address and cam_port are {address!r} and {port} ({reason}); "
                "allowed: an address of this computer and a free UDP port"
            ) from reason
        self._socket.settimeout(_STOP_PERIOD_S)
        self._kept: deque[bytes] = deque()
        self._lock = threading.Lock()
        self._dropped = 0
        self._dropped_by_kernel = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, name="cam_datagrams", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that is listened at."""
        return int(self._socket.getsockname()[1])

    @property
    def dropped(self) -> int:
        """Datagrams dropped unread so far."""
        return self._dropped + self._dropped_by_kernel

    def take(self) -> list[bytes]:
        """Return what has arrived since the last call, in order."""
        with self._lock:
            taken = list(self._kept)
            self._kept.clear()
        return taken

    def close(self) -> None:
        """Stop reading and give the port back."""
        self._closing.set()
        self._thread.join(10.0 * _STOP_PERIOD_S)
        self._socket.close()

    def _read(self) -> None:
        space = socket.CMSG_SPACE(_COUNTER.size)
        while not self._closing.is_set():
            try:
                datagram, ancillary, _, _ = self._socket.recvmsg(LONGEST_READ, space)
            except TimeoutError:
                continue
            except OSError:
                continue  # such as a refusal by the receiver of something sent from this port
            for level, kind, data in ancillary:
                if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                    (self._dropped_by_kernel,) = _COUNTER.unpack_from(data)
            with self._lock:
                if len(self._kept) >= MAX_KEPT:
                    self._kept.popleft()
                    self._dropped += 1
                self._kept.append(datagram)
