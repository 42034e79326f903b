"""Datagrams to and from a UDP port tick by tick, and at the end of every tick its mark.

A sender that follows `/clock` puts the mark behind the datagrams of each tick, through the same socket.
Loopback keeps their order, so a bridge that waits for it receives the same messages before the same tick in
every run. The mark is not a standard message, and only a bridge in lock-step uses it.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from iptm_core.errors import ParameterError
from iptm_core.state import NS_PER_MS
from iptm_v2x_bridge.messages.packets import its_timestamp_ms

REPEAT_PERIOD_S = 0.2
"""Repeat period of the end-of-tick mark, for a receiver that starts late."""
NOT_ALL_SENT = "some messages could not be sent"
Received = tuple[int, bytes]
"""When a datagram was received (integer nanoseconds of trip time), and its bytes."""
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


class DatagramSource:
    """Provides received datagrams, tick by tick; this one never has any."""

    def __init__(self, start_timestamp_ms: int) -> None:
        self._given_start_ms = start_timestamp_ms

    def begin_trip(self, time_ns: int) -> int:
        """Begin a trip with its first tick; return the TimestampIts of trip time 0 in ms.

        A negative one in the parameters stands for the clock of the computer.
        """
        if self._given_start_ms >= 0:
            return self._given_start_ms
        return its_timestamp_ms(time.time_ns()) - time_ns // NS_PER_MS

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Received], int]:  # noqa: ARG002
        """Return the datagrams received after one tick (None: from the beginning) up to another.

        Returns:
            The datagrams, and how many more had to be dropped unread meanwhile.
        """
        return (), 0

    def missing(self, time_ns: int) -> str:  # noqa: ARG002
        """Return the input that a tick still lacks, empty for none."""
        return ""

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {}

    def close(self) -> None:
        """Release its resources."""


MAX_KEPT = 20_000
"""Datagrams kept unread: ten seconds at two thousand a second."""
LONGEST_READ = 2048
"""A longer datagram is cut, and refused for its size."""
_RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024
_STOP_PERIOD_S = 0.2
_SO_RXQ_OVFL = 40  # Linux: how many datagrams the kernel dropped comes along with each one
_COUNTER = struct.Struct("=I")


class SocketSource(DatagramSource):
    """Datagrams of a UDP socket, read in a thread of its own, so that a busy receiver loses nothing.

    The thread only moves bytes; what they mean is left to the receiver. When too many are kept, the oldest
    are dropped and counted, those that the kernel dropped as well.
    """

    def __init__(self, address: str, port: int, start_timestamp_ms: int = 0) -> None:
        """Open the socket.

        Args:
            address: own address to listen at.
            port: UDP port; 0 takes a free one.
            start_timestamp_ms: TimestampIts of trip time 0, negative for the clock of the computer.

        Raises:
            ParameterError: the socket cannot be had.
        """
        super().__init__(start_timestamp_ms)
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
        self._dropped = self._dropped_by_kernel = self._dropped_before = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, name="cam_datagrams", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that is listened at."""
        return int(self._socket.getsockname()[1])

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Received], int]:  # noqa: ARG002
        """Return the datagrams that have arrived since the last call; see `DatagramSource`."""
        taken = [(until_ns, datagram) for datagram in self._arrived(until_ns)]
        dropped = self._dropped + self._dropped_by_kernel
        since, self._dropped_before = dropped - self._dropped_before, dropped
        return taken, since

    def _arrived(self, until_ns: int) -> list[bytes]:  # noqa: ARG002
        with self._lock:
            taken = list(self._kept)
            self._kept.clear()
        return taken

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {"port": self.port}

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


class LockStepSource(SocketSource):
    """Datagrams up to the mark of a tick count for it; a sender that is ahead has to wait for its tick."""

    def __init__(self, address: str, port: int, start_timestamp_ms: int = 0) -> None:
        """Open the socket; see `SocketSource`."""
        super().__init__(address, port, start_timestamp_ms)
        self._waiting: deque[bytes] = deque()
        self._marks: deque[EndOfTick] = deque()
        """Those in what waits, in the same order."""
        self._ended_ns: int | None = None
        self._heard = self._lost_on_the_way = 0

    def _arrived(self, until_ns: int) -> list[bytes]:
        self._listen()
        taken: list[bytes] = []
        while self._marks and self._marks[0].time_ns <= until_ns:
            taken += self._pass_mark()
        return taken

    def _listen(self) -> None:
        """Let what has arrived wait for the mark behind it; too much of it is left to the thread to drop."""
        if len(self._waiting) >= MAX_KEPT:
            return
        for datagram in super()._arrived(0):
            self._waiting.append(datagram)
            mark = EndOfTick.decode(datagram)
            if mark is None:
                continue
            while self._marks and mark.time_ns < self._marks[-1].time_ns:
                self._pass_mark()  # the sender began a new trip
            self._marks.append(mark)

    def _pass_mark(self) -> list[bytes]:
        """Return what came before the first mark that waits, and take note of it."""
        mark, before = self._marks.popleft(), []
        while EndOfTick.decode(datagram := self._waiting.popleft()) is None:
            before.append(datagram)
        if self._ended_ns is not None and mark.time_ns < self._ended_ns:
            self._heard = mark.sent - len(before)  # the sender began a new trip
        self._heard += len(before)
        self._ended_ns = mark.time_ns
        self._lost_on_the_way = mark.sent - self._heard
        return before

    def missing(self, time_ns: int) -> str:
        """Return the input that a tick still lacks, empty for none."""
        if self._ended_ns == time_ns:
            return ""
        before = self._ended_ns is not None and self._ended_ns < time_ns
        if before and self._marks and self._marks[0].time_ns > time_ns:
            return ""  # the sender skipped this tick, as it had no decision
        return "waiting for the sender's end of the tick"

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return super().report() | {"lost_between_sender_and_bridge": self._lost_on_the_way}
