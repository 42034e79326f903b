"""A CAN bus by python-can: opened by the names of its back ends, read in a thread of its own.

``udp:PORT`` is a bus of this machine's processes: multicast in python-can's format, bound to its group and
joined on the loopback interface alone, so that nothing from another machine reaches it.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from iptm_core.errors import MessageError, ScenarioError
from iptm_drives.can_files import library

LOOPBACK_GROUP, LOOPBACK = "239.74.163.2", "127.0.0.1"
FAILED_S = 0.1
"""Pause after a failure of a bus: one that is down fails at once, hundreds of thousands of times a second."""
_IP_MULTICAST_ALL = (
    49  # of Linux: 0 leaves out groups that other sockets of the machine have joined
)
_LONGEST_DATAGRAM = 4096


@dataclass(frozen=True)
class Frame:
    """A frame and its time of arrival.

    Attributes:
        bus: number of the bus that it arrived on, in the order of the vehicle's databases.
    """

    frame_id: int
    data: bytes
    time_s: float
    bus: int = 0


class LoopbackBus:
    """A bus of this machine's processes; sent frames come back to their sender, too."""

    def __init__(self, port: int) -> None:
        self._codec = library("can.interfaces.udp_multicast.utils")
        self._place = LOOPBACK_GROUP, port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        group, interface = map(socket.inet_aton, (LOOPBACK_GROUP, LOOPBACK))
        try:
            for option in (socket.SO_REUSEADDR, socket.SO_REUSEPORT):
                self._socket.setsockopt(socket.SOL_SOCKET, option, 1)
            for name, value in (
                (socket.IP_MULTICAST_TTL, 0),
                (_IP_MULTICAST_ALL, 0),
                (socket.IP_MULTICAST_IF, interface),
                (socket.IP_ADD_MEMBERSHIP, group + interface),
            ):
                self._socket.setsockopt(socket.IPPROTO_IP, name, value)
            self._socket.bind(self._place)
        except OSError:
            self._socket.close()
            raise

    def recv(self, timeout: float) -> Any:
        """Return the next frame, None for none in time.

        Raises:
            MessageError: a datagram is not a frame.
        """
        if not select.select([self._socket], [], [], timeout)[0]:
            return None
        data = self._socket.recv(_LONGEST_DATAGRAM)
        try:
            return self._codec.unpack_message(data, check=True)
        except Exception as error:
            raise MessageError(f"{len(data)} bytes are not a frame: {error}") from error

    def send(self, message: Any) -> None:
        """Send a frame."""
        try:
            self._socket.sendto(self._codec.pack_message(message), self._place)
        except OSError as error:
            raise library("can").CanOperationError(str(error)) from error

    def shutdown(self) -> None:
        """Close the socket."""
        self._socket.close()


def is_unused(port: int) -> bool:
    """Return whether no process of this machine has a bus on the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((LOOPBACK_GROUP, port))
        except OSError:
            return False
    return True


def open_bus(address: str, *, fd: bool = False) -> Any:
    """Open a bus, ``INTERFACE:CHANNEL``: ``socketcan:can0``, ``pcan:PCAN_USBBUS1``, ``udp:43113``.

    Args:
        fd: whether it carries frames of CAN FD.

    Raises:
        ScenarioError: the bus does not exist.
    """
    can = library("can")
    interface, _, channel = address.partition(":")
    try:
        if interface == "udp":
            return LoopbackBus(int(channel))
        return can.Bus(interface=interface, channel=channel, **({"fd": True} if fd else {}))
    except Exception as error:
        raise ScenarioError(
            f"bus is {address!r}: {error}; allowed: INTERFACE:CHANNEL of python-can, such as "
            "socketcan:can0, or udp:PORT"
        ) from error


def open_buses(addresses: Sequence[str], has_fd: Sequence[bool]) -> list[Any]:
    """Open the buses of a vehicle.

    Args:
        has_fd: of each bus of the vehicle, whether it carries frames of CAN FD.

    Raises:
        ScenarioError: their number is another one, or a bus does not exist.
    """
    if len(addresses) != len(has_fd):
        raise ScenarioError(
            f"buses are {', '.join(addresses)}; allowed: one for each database of the vehicle, "
            f"{len(has_fd)} here"
        )
    return [open_bus(address, fd=fd) for address, fd in zip(addresses, has_fd, strict=True)]


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
        number: int = 0,
    ) -> None:
        self._bus, self._clock_s, self._number = bus, clock_s, number
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
        while not self._ended.is_set():
            try:
                message = self._bus.recv(0.1)
            except MessageError:
                self.unreadable += 1
                continue
            except Exception:  # noqa: BLE001  of any back end: a reader that ends leaves every signal stale
                self.unreadable += 1
                self._ended.wait(FAILED_S)
                continue
            if message is not None and not message.is_error_frame:
                frame = message.arbitration_id, bytes(message.data), self._clock_s(), self._number
                self._frames.append(Frame(*frame))


def log_line(time_s: float, frame_id: int, data: bytes, direction: str, bus: int = 0) -> str:
    """Return a frame as a line of a candump log: received (R) or sent (T)."""
    identifier = f"{frame_id:08X}" if frame_id > 0x7FF else f"{frame_id:03X}"
    channel = f"car{bus}" if bus else "car"
    # Two signs and flags (bit rate switched) mark a frame of CAN FD.
    between = "##1" if len(data) > 8 else "#"
    return f"({time_s:.6f}) {channel} {identifier}{between}{data.hex().upper()} {direction}\n"


def send(bus: Any, frame_id: int, data: bytes, *, is_fd: bool = False) -> bool:
    """Send a frame; return whether the bus took it."""
    can = library("can")
    is_fd = is_fd or len(data) > 8
    message = can.Message(
        arbitration_id=frame_id,
        data=data,
        is_extended_id=frame_id > 0x7FF,
        is_fd=is_fd,
        bitrate_switch=is_fd,
    )
    try:
        bus.send(message)
    except can.CanError:
        return False
    return True
