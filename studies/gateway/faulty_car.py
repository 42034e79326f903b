"""The bench in steps with measurements that are wrong, and with a second sender of the gateway's command."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from studies.vehicle.in_steps import BenchInSteps

from iptm_vehicle_interface.bench_car import BenchCar
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.vehicle import load_vehicle

Values = dict[str, float]
PRESS = ("enable_button", 4.0, 0.3, 3.0)
STRATEGY = "aging_cost_to_go"


def _speed(change: Callable[[float], float]) -> Callable[[Values], Values]:
    return lambda values: {**values, "VehicleSpeed": change(values["VehicleSpeed"])}


def _range(name: str, change: Callable[[float], float]) -> Callable[[Values], Values]:
    def changed(values: Values) -> Values:
        seen = values["TargetValid"] >= 0.5
        return {**values, name: change(values[name])} if seen else values

    return changed


FAULTS: Mapping[str, tuple[str, Callable[[Values], Values]]] = {
    "gap 1.5 times as large and 10 m more": (
        "RADAR", _range("Distance", lambda gap_m: min(1.5 * gap_m + 10.0, 400.0)),
    ),
    "relative speed reversed": ("RADAR", _range("RelativeSpeed", lambda value: -value)),
    "relative speed 0": ("RADAR", _range("RelativeSpeed", lambda _: 0.0)),
    "vehicle ahead not seen for 3 s": (
        "RADAR", lambda _: {"TargetValid": 0.0, "Distance": 0.0, "RelativeSpeed": 0.0},
    ),
    "speed halved": ("SPEED", _speed(lambda value: 0.5 * value)),
    "speed 0 for 1 s": ("SPEED", _speed(lambda _: 0.0)),
}  # fmt: skip
"""Message and what becomes of its values, in the units of the DBC."""
LENGTHS_S = {"vehicle ahead not seen for 3 s": 3.0, "speed 0 for 1 s": 1.0}
FROZEN, RIVAL, NONE = "speed frozen", "second sender of the command for 2 s", "none"
RIVAL_S = 2.0
NAMES = (NONE, *FAULTS, FROZEN, RIVAL)


class FaultyCar(BenchCar):
    """A bench car whose messages are wrong for a while."""

    def __init__(self, fault: str, from_s: float, cycle: str, seed: int) -> None:
        super().__init__(load_vehicle("bench"), cycle, [PRESS], seed)
        self.fault, self.from_s = fault, from_s
        self.until_s = from_s + LENGTHS_S.get(fault, RIVAL_S if fault == RIVAL else math.inf)
        self._kept: Values = {}
        self._rival = FrameCodec(load_vehicle("bench"))

    @property
    def is_wrong(self) -> bool:
        """Whether the fault is there now."""
        return self.from_s <= self.time_s < self.until_s

    def rival_frame(self) -> tuple[int, bytes]:
        """Return a frame of the second sender."""
        target = self._vehicle.motion
        return self._rival.encode_command(target, 2.0, enabled=True)

    def _values(self, message: str) -> Values:
        values = super()._values(message)
        if message == "SPEED" and self.fault == FROZEN:
            self._kept = self._kept if self.is_wrong else values
            return self._kept
        place, change = FAULTS.get(self.fault, ("", dict))
        return change(values) if self.is_wrong and message == place else values


class FaultyBench(BenchInSteps):
    """The bench in steps around a faulty car; frames of a second sender reach car and gateway."""

    def __init__(self, fault: str, from_s: float, cycle: str, seed: int = 0) -> None:
        super().__init__(cycle, STRATEGY, PRESS)
        self.car: FaultyCar = FaultyCar(fault, from_s, cycle, seed)

    def _hear_car(self, now_ns: int) -> None:
        super()._hear_car(now_ns)
        car = self.car
        if car.fault == RIVAL and car.is_wrong and round(100.0 * car.time_s) % 2 == 0:
            frame = car.rival_frame()
            car.receive(*frame)
            self._gateway.from_car(*frame, 1e-9 * now_ns)

    def outcome(self, duration_s: float) -> dict[str, Any]:
        """Drive; return gap, time engaged, and the first change after the fault began with its delay."""
        log = self.drive(duration_s)
        from_s = self.car.from_s
        after = [
            (at_s, reason)
            for at_s, mode, reason in self._driver.log.changes
            if at_s >= from_s - 0.05 and mode in {"hand_over", "off"}
        ]
        at_s, reason = after[0] if after else (math.nan, "goes on")
        return {
            "fault": self.car.fault,
            "noticed_s": at_s - from_s,
            "reaction": reason,
            "engaged_s": log["active_s"],
            "engagements": log["engagements"],
            "gap_m": log["smallest_gap_m"],
            "rejected": log["rejected_frames"],
        }
