"""Datagrams from a socket, read at once and kept until they are asked for."""

from __future__ import annotations

import socket
import struct
import threading
from collections import deque

from iptm_core.errors import ParameterError

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
