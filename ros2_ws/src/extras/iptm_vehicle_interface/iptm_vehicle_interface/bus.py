"""A CAN bus by python-can: opened by the names of its back ends, read in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from iptm_core.errors import ScenarioError
from iptm_core.routes.can_files import library

LOOPBACK_GROUP = "239.74.163.2"


@dataclass(frozen=True)
class Frame:
    """A frame and its time of arrival."""

    frame_id: int
    data: bytes
    time_s: float


def open_bus(address: str) -> Any:
    """Open a bus, ``INTERFACE:CHANNEL``: ``socketcan:can0``, ``pcan:PCAN_USBBUS1``, ``udp:43113``.

    ``udp:PORT`` is a bus of this machine's processes: multicast that does not leave it.

    Raises:
        ScenarioError: the bus does not exist.
    """
    can = library("can")
    interface, _, channel = address.partition(":")
    try:
        if interface == "udp":
            return can.Bus(
                interface="udp_multicast", channel=LOOPBACK_GROUP, port=int(channel), hop_limit=0
            )
        return can.Bus(interface=interface, channel=channel)
    except Exception as error:
        raise ScenarioError(
            f"bus is {address!r}: {error}; allowed: INTERFACE:CHANNEL of python-can, such as "
            "socketcan:can0, or udp:PORT"
        ) from error


class BusReader:
    """Frames in the order of their arrival; a thread reads, so that the socket's buffer does not overflow.

    Attributes:
        unreadable: number of times that the bus failed or something other than a frame arrived.
    """

    def __init__(
        self,
        bus: Any,
        clock_s: Callable[[], float] = time.monotonic,
        capacity: int = 10_000,
    ) -> None:
        self._bus, self._clock_s = bus, clock_s
        self._frames: deque[Frame] = deque(maxlen=capacity)
        self._ended = threading.Event()
        self.unreadable = 0
        self._thread = threading.Thread(target=self._read, name="can", daemon=True)
        self._thread.start()

    def taken(self) -> list[Frame]:
        """Return the frames since the last call."""
        frames = []
        while self._frames:
            frames.append(self._frames.popleft())
        return frames

    def close(self) -> None:
        """End the thread and close the bus."""
        self._ended.set()
        self._thread.join(timeout=2.0)
        self._bus.shutdown()

    def _read(self) -> None:
        error = library("can").CanError
        while not self._ended.is_set():
            try:
                message = self._bus.recv(0.1)
            except error:
                self.unreadable += 1
                continue
            if message is not None and not message.is_error_frame:
                self._frames.append(
                    Frame(message.arbitration_id, bytes(message.data), self._clock_s())
                )


def log_line(time_s: float, frame_id: int, data: bytes, direction: str) -> str:
    """Return a frame as a line of a candump log: received (R) or sent (T)."""
    identifier = f"{frame_id:08X}" if frame_id > 0x7FF else f"{frame_id:03X}"
    return f"({time_s:.6f}) car {identifier}#{data.hex().upper()} {direction}\n"


def send(bus: Any, frame_id: int, data: bytes) -> bool:
    """Send a frame; return whether the bus took it."""
    can = library("can")
    message = can.Message(arbitration_id=frame_id, data=data, is_extended_id=frame_id > 0x7FF)
    try:
        bus.send(message)
    except can.CanError:
        return False
    return True
