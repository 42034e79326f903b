"""Limiter and safety monitor in C, called with what Python answers to.

A case is a call with the answer of Python. Cases are drawn at random, and some lie on the bounds.
"""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.safeguards import CommandLimiter
from iptm_controller.tick_library import numbers_of
from iptm_core.braking import BrakingCapability, SafetyMonitorSettings
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import BrakeParameters
from iptm_core.state import Command, LeaderState, VehicleState
from iptm_ecu.controller_code import limit_numbers
from iptm_plant_sim.safety_monitor import MonitorMemory, RoadBraking, SafetyMonitor, with_delivery

PARAMETERS = load_parameters().values
OWN_M = 128.0
DOUBLE, BOOL = ctypes.c_double, ctypes.c_bool
BITS = {
    "acceleration not finite": 1,
    "compressor power not finite": 2,
    "acceleration bound": 4,
    "top speed": 8,
    "jerk": 16,
    "compressor power bound": 32,
    "compressor rate": 64,
}


class CMemory(ctypes.Structure):
    """What the monitor carries, as in ``safety_monitor.h``."""

    _fields_ = (
        ("braking", BOOL),
        ("gently", BOOL),
        *((name, DOUBLE) for name in ("since_s", "brake_share", "followed_m_s2", "road_m_s2")),
    )

    @classmethod
    def of(cls, memory: MonitorMemory) -> CMemory:
        """Return a memory of Python."""
        names = [str(name) for name, *_ in cls._fields_]
        return cls(*(getattr(memory, name) for name in names))

    def numbers(self) -> list[float]:
        """Return what counts: how hard it brakes only where it does."""
        return [
            self.braking,
            self.braking and self.gently,
            self.since_s,
            self.brake_share,
            self.followed_m_s2,
            self.road_m_s2,
        ]


class CRoad(ctypes.Structure):
    """What both vehicles can do, as in ``safety_monitor.h``."""

    _fields_ = (("both", DOUBLE * 6), ("may_be_slippery", BOOL), ("descends", BOOL))


@dataclass(frozen=True)
class Case:
    """A call and its answer.

    Attributes:
        changed: the argument that is an answer, by its place.
    """

    function: str
    arguments: tuple[Any, ...]
    changed: int
    expected: Sequence[float]
    returned: float | None = None

    def holds(self, library: ctypes.CDLL) -> bool:
        """Return whether the library answers alike."""
        given = list(self.arguments)
        answer = type(given[self.changed]).from_buffer_copy(given[self.changed])
        given[self.changed] = answer
        returned = getattr(library, self.function)(
            *(each if isinstance(each, DOUBLE | BOOL) else ctypes.byref(each) for each in given)
        )
        numbers = answer.numbers() if isinstance(answer, CMemory) else list(answer)
        return numbers == list(self.expected) and self.returned in (None, returned)


def limiter_cases() -> Iterator[Case]:
    """Yield calls of the limiter."""
    for tick_s in (1.0, 0.5):
        given = (DOUBLE * 12)(*limit_numbers(PARAMETERS, tick_s))
        limiter = CommandLimiter(PARAMETERS.limits, tick_s)
        rng = np.random.default_rng(1)
        for _ in range(1000):
            wanted = Command(
                float(rng.choice([rng.uniform(-12.0, 12.0), math.nan, -math.inf, 2.0005])),
                float(rng.choice([rng.uniform(-1e3, 1e4), math.nan, math.inf, -1e-3, -2e-3])),
            )
            state = VehicleState(
                time_s=0.0,
                position_m=0.0,
                speed_m_s=float(rng.choice([0.0, rng.uniform(0.0, 40.0), 37.0])),
                acceleration_m_s2=float(rng.choice([rng.uniform(-9.0, 4.0), 5e-4, 2.0])),
                compressor_power_w=float(rng.choice([rng.uniform(-100.0, 6000.0), 0.0])),
                cell_1_temperature_k=300.0,
                cell_n_temperature_k=300.0,
                cell_1_capacity_loss=0.0,
                cell_n_capacity_loss=0.0,
            )
            expected, reasons = limiter.limit(wanted, state)
            vehicle = (DOUBLE * 9)(*numbers_of(state))
            command = (DOUBLE * 2)(wanted.acceleration_m_s2, wanted.compressor_power_w)
            answer = (expected.acceleration_m_s2, expected.compressor_power_w)
            bits = sum(BITS[reason] for reason in reasons)
            yield Case("iptm_limit_command", (given, vehicle, command), 2, answer, bits)


class Monitored:
    """A monitor of Python, and calls of the one in C with its settings."""

    def __init__(self, brakes: BrakeParameters = PARAMETERS.brakes, friction: float = 0.0) -> None:
        settings = replace(
            SafetyMonitorSettings(),
            road_friction=friction,
            gap_accuracy_m=0.3,
            lead_speed_accuracy_m_s=0.2,
        )
        self.settings, self.monitor = settings, SafetyMonitor(settings, brakes)
        self._numbers = (DOUBLE * 8)(
            settings.monitor_reaction_s,
            settings.monitor_release_reaction_s,
            settings.monitor_hold_s,
            settings.monitor_margin_m,
            settings.gap_accuracy_m,
            settings.lead_speed_accuracy_m_s,
            brakes.delay_s,
            brakes.build_up_m_s3,
        )

    def judged(
        self,
        memory: MonitorMemory,
        ego: Sequence[float],
        lead: LeaderState | None,
        road: RoadBraking,
        unseen_s: float,
    ) -> tuple[Case, MonitorMemory]:
        """Return a decision, and the memory after it; ego is time, position, speed and acceleration."""
        time_s, position_m, speed_m_s, acceleration_m_s2 = ego
        after = self.monitor.judge(
            memory, time_s, (position_m, speed_m_s, acceleration_m_s2), lead, road, unseen_s
        )
        # What does not count is there to be misread.
        roads = (
            road.full,
            *(each or BrakingCapability(0.5, 9.0) for each in (road.slippery, road.descent)),
        )
        both = (DOUBLE * 6)(*(number for each in roads for number in astuple(each)))
        given = (
            self._numbers,
            CMemory.of(memory),
            (DOUBLE * 4)(*ego),
            BOOL(lead is not None),
            *((DOUBLE(lead.position_m), DOUBLE(lead.speed_m_s)) if lead else (DOUBLE(), DOUBLE())),
            CRoad(both, road.slippery is not None, road.descent is not None),
            DOUBLE(unseen_s),
        )
        return Case("iptm_monitor_judge", given, 1, CMemory.of(after).numbers()), after

    def distance(self, *numbers: float, own_m_s2: float, lead_m_s2: float) -> Case:
        """Return a safe distance; numbers as in ``safety_monitor.h``."""
        both = (DOUBLE * 2)(own_m_s2, lead_m_s2)
        speed, acceleration, lead, share, further = numbers
        metres = self.monitor.safe_distance_m(
            speed, acceleration, lead, share, further, BrakingCapability(own_m_s2, lead_m_s2)
        )
        given = (self._numbers, *map(DOUBLE, numbers), both)
        return Case("iptm_safe_distance_m", given, 0, list(self._numbers), metres)


def learnt(
    memory: MonitorMemory, requested_m_s2: float, delivered_m_s2: float, speed_m_s: float
) -> tuple[Case, MonitorMemory]:
    """Return what is learnt of a request, and the memory after it."""
    numbers = (requested_m_s2, delivered_m_s2, speed_m_s, 0.1)
    after = with_delivery(memory, *numbers)
    given = (CMemory.of(memory), *map(DOUBLE, numbers))
    return Case("iptm_monitor_learn", given, 0, CMemory.of(after).numbers()), after


def monitor_cases(friction: float) -> Iterator[Case]:
    """Yield calls of the monitor along random drives, with what brakes and road made of the requests."""
    monitored = Monitored(friction=friction)
    rng = np.random.default_rng(3)
    for _ in range(60):
        memory = MonitorMemory()
        speed, gap, lead_speed = rng.uniform([0.0, 5.0, 0.0], [30.0, 60.0, 30.0])
        for step in range(80):
            gap += 0.1 * (lead_speed - speed) + rng.normal(0.0, 0.5)
            speed = max(speed + rng.normal(0.0, 0.3), 0.0)
            lead_speed = max(lead_speed + rng.normal(-0.05, 0.5), 0.0)
            ego = (0.1 * step, OWN_M, speed, float(rng.choice([rng.normal(0.0, 1.0), -4.0, 0.0])))
            road = monitored.monitor.road_braking(float(rng.normal(0.0, 0.1)), memory.road_m_s2)
            lead = LeaderState(ego[0], OWN_M + gap, lead_speed) if rng.random() < 0.9 else None
            unseen = float(rng.choice([0.0, 0.2, 1.0]))
            case, memory = monitored.judged(memory, ego, lead, road, unseen)
            yield case
            requested = float(rng.choice([0.0, -0.2, -0.3, -2.0, -6.0]))
            share = float(rng.choice([1.1, 1.0, 0.97, 0.95, 0.8, 0.4, 0.02]))
            at = float(rng.choice([speed, 0.5, 0.3]))
            case, memory = learnt(memory, requested, requested * share, at)
            yield case


def edge_cases() -> Iterator[Case]:
    """Yield safe distances, and calls of the monitor on the bounds of its decisions."""
    rng = np.random.default_rng(4)
    usual, short = (
        Monitored(),
        Monitored(replace(PARAMETERS.brakes, delay_s=0.0, build_up_m_s3=8.0)),
    )
    for monitored in (usual, short):
        for _ in range(500):
            speed = float(rng.choice([0.0, 1e-3, 1.0, 1.0005, rng.uniform(0.0, 30.0)]))
            acceleration = float(rng.choice([0.0, 5e-4, -4.0, rng.uniform(-9.0, 3.0)]))
            lead_speed, share = (
                float(rng.choice([0.0, rng.uniform(0.0, 30.0)])),
                float(rng.uniform(0.1, 1.0)),
            )
            for shown in (share, 1.0):
                further = float(rng.choice([0.0, -5.0, -0.3, 0.2]))
                yield monitored.distance(
                    speed, acceleration, lead_speed, shown, further, own_m_s2=4.0, lead_m_s2=9.0
                )
    far, hold_s = LeaderState(0.0, 1e4, 20.0), usual.settings.monitor_hold_s
    road, known = usual.monitor.road_braking(), Monitored(friction=0.8).monitor.road_braking()
    for late_s in (-1e-9, -1e-4, 0.0):
        for seen in (far, None):
            ego = (hold_s + late_s, 0.0, 10.0, 0.0)
            yield usual.judged(MonitorMemory(braking=True), ego, seen, road, 0.0)[0]
    for capability, here in ((known.full, known), (road.slippery, road)):
        safe_m = usual.monitor.safe_distance_m(10.0, 0.0, 5.0, 1.0, 0.0, capability)
        lead = LeaderState(0.0, safe_m, 5.0)
        yield usual.judged(MonitorMemory(), (0.0, 0.0, 10.0, 0.0), lead, here, 0.0)[0]
    released_m = usual.monitor.safe_distance_m(
        10.0, 0.0, 5.0, 1.0, usual.settings.monitor_release_reaction_s, known.full
    )
    lead, braking = LeaderState(0.0, released_m, 5.0), MonitorMemory(braking=True)
    yield usual.judged(braking, (hold_s, 0.0, 10.0, -1.0), lead, known, 0.0)[0]
    yield learnt(MonitorMemory(brake_share=0.95, followed_m_s2=1.0), -6.0, -0.5, 10.0)[0]
    yield learnt(MonitorMemory(followed_m_s2=1.0), -6.0, -1.2, 10.0)[0]


def all_cases() -> list[Case]:
    """Return the cases of limiter and monitor."""
    return [*limiter_cases(), *monitor_cases(0.0), *monitor_cases(0.8), *edge_cases()]


def loaded(path: Path) -> ctypes.CDLL:
    """Load a library of limiter and monitor."""
    library = ctypes.CDLL(str(path))
    library.iptm_safe_distance_m.restype = DOUBLE
    return library


if __name__ == "__main__":
    covered = loaded(Path(sys.argv[1]))
    sys.exit(0 if all(case.holds(covered) for case in all_cases()) else 1)
