"""opendbc's safety code as a foreign judge: commands of a recorded bench drive as frames of two of its cars.

The package (`opendbc`, MIT) is unpacked into a folder by the user and compiled here; it does not belong to
this project. Its cars keep a requested acceleration within -3.5 to 2 m/s^2 while controls are allowed, and 0
while the driver has a foot on a pedal or the suite is not engaged.
"""

from __future__ import annotations

import ctypes
import math
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from iptm.parts import MeasurementError
from iptm_vehicle_interface.bench_car import STEP_S
from iptm_vehicle_interface.bus import Frame
from iptm_vehicle_interface.drive_record import read_frames
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.vehicle import load_vehicle

_SOURCE = Path(__file__).with_suffix(".c")
_LONGITUDINAL = 1
"""Flag of both cars: the suite requests accelerations itself."""


class DriverState(NamedTuple):
    """Pedals, and whether cruise control is engaged."""

    brake: bool
    gas: bool
    engaged: bool


@dataclass(frozen=True)
class ForeignCar:
    """A car of opendbc: its safety mode, and how its frames carry what the bench car's carry.

    Attributes:
        request: bytes of a request in m/s^2 with a counter.
        driver: frames (bus, address, bytes) that state pedals and whether cruise control is engaged.
    """

    name: str
    mode: int
    address: int
    request: Callable[[float, int], bytes]
    driver: Callable[[DriverState, int], list[tuple[int, int, bytes]]]


def _rivian_request(acceleration_m_s2: float, counter: int) -> bytes:
    raw = round(acceleration_m_s2 * 100.0) + 1024
    return bytes([0, counter & 0xF, raw >> 3, (raw & 7) << 5, 0])


def _rivian_checksum(data: bytes, last: int) -> int:
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D) & 0xFF if crc & 0x80 else crc << 1
    return crc ^ last


def _rivian_driver(state: DriverState, counter: int) -> list[tuple[int, int, bytes]]:
    brake, gas, engaged = state
    pedal = bytes([0x40 | counter % 15, 0, 20 if gas else 0, 0, 0, 0])
    return [
        (0, 0x38F, bytes([0, 0, 0x80 if brake else 0, 0, 0, 0])),
        (0, 0x150, bytes([_rivian_checksum(pedal, 0x9A)]) + pedal),
        (2, 0x100, bytes([0, 0, 0x20 if engaged else 0, 0, 0, 0, 0, 0])),
    ]


def _tesla_checked(address: int, data: bytes, place: int) -> bytes:
    total = (address & 0xFF) + (address >> 8) + sum(data) - data[place]
    return data[:place] + bytes([total & 0xFF]) + data[place + 1 :]


def _tesla_request(acceleration_m_s2: float, counter: int) -> bytes:
    # DAS_control: state of the cruise control, lower and upper acceleration, counter. Never both negative.
    low, high = (round((a + 15.0) / 0.04) for a in (acceleration_m_s2, max(acceleration_m_s2, 0.0)))
    value = 4 << 12 | low << 35 | high << 44 | (counter & 7) << 53
    return _tesla_checked(0x2B9, value.to_bytes(8, "little"), 7)


def _tesla_driver(state: DriverState, counter: int) -> list[tuple[int, int, bytes]]:
    brake, gas, engaged = state
    count = counter & 0xF
    frames = [
        (0x145, bytes([0, count, 0, (2 if brake else 1) << 5, 0, 0, 0, 0])),
        (0x118, bytes([0, count, 0, 0, 20 if gas else 0, 0, 0, 0])),
        (0x286, bytes([0, count | (2 if engaged else 0) << 4, 0, 0, 0, 0, 0, 0])),
    ]
    return [(0, address, _tesla_checked(address, data, 0)) for address, data in frames]


CARS = (
    ForeignCar("Rivian R1", 33, 0x160, _rivian_request, _rivian_driver),
    ForeignCar("Tesla Model 3", 10, 0x2B9, _tesla_request, _tesla_driver),
)


def build(package: Path) -> ctypes.CDLL:
    """Return the safety code as a library.

    Raises:
        MeasurementError: the package is not in the folder, or cannot be compiled.
    """
    if not (package / "opendbc" / "safety" / "safety.h").is_file():
        raise MeasurementError(f"{package} has no opendbc; allowed: the folder of its package")
    library = Path(tempfile.mkdtemp(prefix="iptm_opendbc_")) / "judge.so"
    command = ["cc", "-std=gnu11", "-O1", "-fPIC", "-shared", "-w", f"-I{package}"]
    done = subprocess.run(  # noqa: S603 - the user's compiler
        [*command, str(_SOURCE), "-o", str(library)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise MeasurementError(f"opendbc cannot be compiled: {done.stderr.strip()[:300]}")
    return ctypes.CDLL(str(library))


def judged(library: Any, car: ForeignCar, log: Path) -> Counter[str]:
    """Pass the frames of a car's log through the judge of a car.

    Returns:
        Requests while engaged, how many of these were blocked, and requests beside 0 while a pedal was
        pressed or the suite was not engaged. A request that the car takes in the step in which it states a
        pedal was in flight: it is counted beside, whatever becomes of it.
    """
    if library.set_safety_hooks(car.mode, _LONGITUDINAL):
        raise MeasurementError(f"{car.name} is not in this opendbc")
    counts: Counter[str] = Counter({"in flight": 0})
    brake = gas = engaged = False
    stated, pressed_s = 0, -math.inf
    for count, (is_request, time_s, value, flags) in enumerate(_events(log)):
        library.judge_time(int(time_s * 1e6) & 0xFFFFFFFF)
        changed = is_request and flags[0] is not engaged
        if is_request:
            engaged = flags[0]
        else:
            if any(flags) and not (brake or gas):
                pressed_s = time_s
            brake, gas = flags
        if changed or not is_request:
            for bus, address, data in car.driver(DriverState(brake, gas, engaged), stated):
                library.judge_receives(bus, address, data, len(data))
            stated += 1
        if not is_request:
            continue
        data = car.request(value, count)
        passed = bool(library.judge_lets_pass(0, car.address, data, len(data)))
        if engaged and time_s - pressed_s < STEP_S / 2.0:
            counts["in flight"] += 1
            continue
        counts["engaged"] += engaged
        counts["inactive"] += not engaged
        counts["blocked while engaged"] += engaged and not passed
        counts["blocked while inactive"] += not engaged and not passed
        counts["sent with a pedal pressed"] += engaged and (brake or gas)
    return counts


def _events(log: Path) -> Iterator[tuple[bool, float, float, tuple[bool, bool]]]:
    """Yield requests (True) and pedals in the order in which the car received and sent them."""
    vehicle = load_vehicle("bench")
    of_car, of_suite = FrameCodec(vehicle), FrameCodec(vehicle)
    frames: list[tuple[Frame, bool]] = read_frames(log)
    for frame, received in frames:
        if not received:
            values = of_car.decode(frame.frame_id, frame.data).values
            if "brake_pressed" in values:
                pedals = values["brake_pressed"] > 0.0, values["accelerator_pressed"] > 0.0
                yield False, frame.time_s, 0.0, pedals
            continue
        command = of_suite.command(frame.frame_id, frame.data)
        if command is not None and command[0] is vehicle.acceleration:
            yield True, frame.time_s, command[1], (command[2], False)
