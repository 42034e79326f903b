"""opendbc's safety code as a foreign judge of the gateway, by the vehicle folders that fit its cars.

The package `opendbc` (MIT licence; requirements/opendbc.txt) brings its C code, which is compiled here and
decides by itself, from the car's frames, whether requests are allowed. A car is driven in steps: its driver
enables, brakes, accelerates and cancels at random, frames are lost, and behind the gateway is a suite that
goes mad in turn: then it asks to drive all the time, with requests of any size.
"""

from __future__ import annotations

import ctypes
import math
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import RouteError
from iptm_vehicle_interface.authority import decision_frame
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.gateway import PERIOD_S, Gateway
from iptm_vehicle_interface.vehicle import load_vehicle

_SOURCE = Path(__file__).with_suffix(".c")
_MAD_S = 5.0
_FIRST_EVENT_S, _BETWEEN_EVENTS_S = 2.0, (0.5, 6.0)
_EVENTS = {"enable": 0.3, "brake": 0.6, "gas": 1.0, "cancel": 0.2}
"""What a driver does at random, and for how long, in s."""
_BESIDE_PRESS = 0.6
"""Share of the events that are the enable button."""


@dataclass(frozen=True)
class ForeignCar:
    """A car of opendbc.

    Attributes:
        mode: its safety mode.
        parameter: of that mode: the suite requests accelerations itself.
        buses: numbers that opendbc gives to the buses of the vehicle.
        values: values of the messages of the car by message, in the units of the DBC; texts name what the
            driver does ("speed" in km/h).
        states: values by which pedals and cruise control are stated when off and on; else 0 and 1.
    """

    name: str
    mode: int
    parameter: int
    buses: tuple[int, ...]
    values: Mapping[str, Mapping[str, float | str]]
    states: Mapping[str, tuple[float, float]] = field(default_factory=dict)


CARS = (
    ForeignCar(
        "rivian_r1", 33, 1, (0, 2),
        {
            "ESP_Status": {"ESP_Vehicle_Speed": "speed", "ESP_Vehicle_Speed_Q": 1.0},
            "VDM_PropStatus": {
                "VDM_AcceleratorPedalPosition": "gas", "VDM_VehicleSpeed": "speed", "VDM_VehicleSpeedQ": 1.0,
            },
            "iBESP2": {"iBESP2_BrakePedalApplied": "brake"},
            "ACM_Status": {"ACM_FeatureStatus": "cruise"},
        },
        {"gas": (0.0, 20.0), "cruise": (0.0, 1.0)},
    ),
    ForeignCar(
        "tesla_model_3", 10, 1, (0,),
        {
            "DI_speed": {"DI_vehicleSpeed": "speed"},
            "ESP_status": {"ESP_driverBrakeApply": "brake"},
            "DI_systemStatus": {"DI_accelPedalPos": "gas"},
            "DI_state": {"DI_cruiseState": "cruise"},
            "UI_warning": {},
        },
        {"brake": (1.0, 2.0), "gas": (0.0, 20.0), "cruise": (1.0, 2.0)},
    ),
    ForeignCar(
        "hyundai_ioniq_5", 28, 4 + 1, (0,),
        {
            "WHEEL_SPEEDS": dict.fromkeys(
                ("WHL_SpdFLVal", "WHL_SpdFRVal", "WHL_SpdRLVal", "WHL_SpdRRVal"), "speed"
            ),
            "TCS": {"DriverBraking": "brake"},
            "ACCELERATOR": {"ACCELERATOR_PEDAL": "gas"},
            "CRUISE_BUTTONS": {"CRUISE_BUTTONS": "button"},
            "DOORS_SEATBELTS": {},
        },
        {"gas": (0.0, 50.0)},
    ),
)  # fmt: skip


def build() -> ctypes.CDLL:
    """Return opendbc's safety code as a library.

    Raises:
        RouteError: the package is not installed, or cannot be compiled.
    """
    found = find_spec("opendbc")
    if found is None or found.origin is None:
        raise RouteError("opendbc is not installed; install: requirements/opendbc.txt")
    package = Path(found.origin).parents[1]
    library = Path(tempfile.mkdtemp(prefix="iptm_opendbc_")) / "judge.so"
    command = ["cc", "-std=gnu11", "-O1", "-fPIC", "-shared", "-w", f"-I{package}"]
    done = subprocess.run(  # noqa: S603 - the user's compiler
        [*command, str(_SOURCE), "-o", str(library)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RouteError(f"opendbc cannot be compiled: {done.stderr.strip()[:300]}")
    return ctypes.CDLL(str(library))


class _Driver:
    """What a driver does, at random."""

    def __init__(self, draws: np.random.Generator) -> None:
        self._draws, self._next_s = draws, _FIRST_EVENT_S
        self._until_s = dict.fromkeys(_EVENTS, -math.inf)
        self._cruise = False

    def state(self, now_s: float) -> dict[str, bool]:
        """Return pedals, buttons and whether the cruise control is on."""
        if now_s >= self._next_s:
            shares = [_BESIDE_PRESS, *[(1.0 - _BESIDE_PRESS) / 3.0] * 3]
            event = str(self._draws.choice(list(_EVENTS), p=shares))
            self._until_s[event] = now_s + _EVENTS[event]
            self._next_s = now_s + self._draws.uniform(*_BETWEEN_EVENTS_S)
        does = {event: now_s < until_s for event, until_s in self._until_s.items()}
        if does["brake"] or does["cancel"]:
            self._cruise = False
        elif does["enable"]:
            self._cruise = True
        return {**does, "cruise": self._cruise}


def judged(
    library: Any, car: ForeignCar, frames: int, seed: int, lost: float = 0.002
) -> Counter[str]:
    """Drive a car of opendbc with a mad suite behind its gateway, and let opendbc judge each frame.

    Args:
        frames: number of requests that the gateway sends.
        lost: share of the car's frames that are lost.

    Returns:
        Numbers of requests: sent by the gateway enabled and not, of both how many opendbc blocks; asked for
        by the suite, and how many of these opendbc would have let pass.
    """
    if library.set_safety_hooks(car.mode, car.parameter):
        raise RouteError(f"{car.name} is not in this opendbc")
    vehicle, draws = load_vehicle(car.name), np.random.default_rng(seed)
    gateway, of_car, of_suite = Gateway(vehicle), FrameCodec(vehicle), FrameCodec(vehicle)
    driver, counts, speed = _Driver(draws), Counter[str](), 60.0
    target = vehicle.motion
    for step in range(frames):
        now_s = 1.0 + step * PERIOD_S
        library.judge_time(int(now_s * 1e6) & 0xFFFFFFFF)
        does = driver.state(now_s)
        speed = min(max(speed + draws.normal(0.0, 0.3), 5.0), 150.0)
        for bus, frame_id, data in _frames(car, of_car, does, speed):
            if draws.random() >= lost:
                gateway.from_car(frame_id, data, now_s, bus)
                library.judge_receives(car.buses[bus], frame_id, data, len(data))
        is_mad = now_s % (2.0 * _MAD_S) > _MAD_S
        wanted = draws.uniform(-12.0, 12.0) if is_mad else draws.uniform(-2.0, 1.5)
        enabled = is_mad or gateway.report.is_armed
        asked = of_suite.encode_command(target, wanted, enabled=enabled)
        gateway.from_suite(*decision_frame(step), now_s)
        gateway.from_suite(*asked, now_s)
        counts["asked, opendbc lets pass"] += enabled and _passes(library, car, asked)
        for frame_id, data in gateway.frames(now_s):
            is_enabled = gateway.report.is_active
            kind = "enabled" if is_enabled else "inactive"
            counts[kind] += 1
            counts[f"{kind}, blocked"] += not _passes(library, car, (frame_id, data))
            counts["enabled, opendbc does not allow"] += is_enabled and not library.judge_allows()
        counts["asked"] += enabled
    return counts


def _passes(library: Any, car: ForeignCar, frame: tuple[int, bytes]) -> bool:
    return bool(library.judge_lets_pass(car.buses[0], frame[0], frame[1], len(frame[1])))


def _frames(
    car: ForeignCar, codec: FrameCodec, does: Mapping[str, bool], speed_km_h: float
) -> Iterator[tuple[int, int, bytes]]:
    """Yield the frames of a car at an instant."""
    stated = {"speed": speed_km_h, "button": 1.0 * does["enable"] + 4.0 * does["cancel"]}
    for name in ("brake", "gas", "cruise"):
        off, on = car.states.get(name, (0.0, 1.0))
        stated[name] = on if does[name] else off
    for message, values in car.values.items():
        numbers = {
            name: stated[value] if isinstance(value, str) else value
            for name, value in values.items()
        }
        yield codec.vehicle.buses[message], *codec.encode(message, numbers)
