"""Entrants: controls of other people by their published equations, of the suite, and bad ones on purpose.

Each is written here once more from its publication, with the parameters printed there. Where a publication
leaves a gap at standstill or limits of acceleration to the car, the ones of the car count, and `REST_M` more
at standstill: laws that approach their gap come to rest short of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from studies.benchmark.foreign import controller_of, has_bags, place_of
from studies.road_space.run import EQUAL
from studies.savings import BASELINE, PRODUCTION, PRODUCTION_SIMPLE, RULE_PREVIEW

import iptm
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_gym.policy import LearnedPolicy

REST_M = 1.0
COOL_FROM_K, COOL_FULLY_K = 303.15, 313.15
COOL_SHARE = 0.5
"""Of the largest power, at which proportional cooling ends."""


class Law:
    """A law of motion with proportional cooling of the warmer cell: the base of the entrants.

    Args:
        car: parameters of the vehicle.
        ticks: of the trip.
    """

    def __init__(self, car: ModelParameters, ticks: int) -> None:
        self.car, self.ticks, self.tick = car, ticks, 0
        self.rest_m = car.gap.standstill_gap_m + REST_M

    def decide(self, measured: iptm.Measurements) -> iptm.Command:
        """Return the command of a tick; without a measured lead vehicle the brakes hold the jerk limit."""
        state, leader = measured.state, measured.leader
        self.tick += 1
        if state is None:
            return iptm.Command(-1.0, 0.0)
        warm_k = max(state.cell_1_temperature_k, state.cell_n_temperature_k)
        power_w = self.power_w(warm_k)
        if leader is None:
            return iptm.Command(-1.0, power_w)
        gap_m = leader.position_m - state.position_m
        return iptm.Command(
            self.acceleration_m_s2(gap_m, max(state.speed_m_s, 0.0), leader.speed_m_s, measured),
            power_w,
        )

    def acceleration_m_s2(
        self, gap_m: float, speed: float, leader: float, measured: iptm.Measurements
    ) -> float:
        """Return the wanted acceleration."""
        raise NotImplementedError

    def power_w(self, warm_k: float) -> float:
        """Return the power of the compressor."""
        share = min(max((warm_k - COOL_FROM_K) / (COOL_FULLY_K - COOL_FROM_K), 0.0), 1.0)
        return share * COOL_SHARE * self.car.limits.max_compressor_power_w


class IntelligentDriver(Law):
    """M. Treiber, A. Hennecke, D. Helbing, Phys. Rev. E 62, 2000, 1805: eqs. (2), (3), table I.

    The desired speed lies above every lead vehicle's: near it the model keeps a gap without bound.
    """

    headway_s, most_m_s2, comfort_m_s2, exponent = 1.6, 0.73, 1.67, 4.0
    desired_m_s, farther_m = 60.0, 0.0

    def acceleration_m_s2(
        self, gap_m: float, speed: float, leader: float, measured: iptm.Measurements
    ) -> float:
        """Return ``a (1 - (v / v_0)^4 - (s* / s)^2)``."""
        del measured
        approach = speed * (speed - leader) / (2.0 * math.sqrt(self.most_m_s2 * self.comfort_m_s2))
        wanted_m = self.rest_m + self.farther_m
        wanted_m += max(self.headway_s * speed + approach, 0.0)
        free = 1.0 - math.pow(speed / self.desired_m_s, self.exponent)
        return self.most_m_s2 * (free - (wanted_m / max(gap_m, 0.1)) ** 2)


class DriverWithThermostat(IntelligentDriver):
    """The same with a compressor at a fixed power that is switched: the reference of the scores."""

    on_k, off_k, share = 303.15, 301.15, 0.26
    cools = False

    def power_w(self, warm_k: float) -> float:
        """Return the power of the compressor."""
        self.cools = warm_k > (self.off_k if self.cools else self.on_k)
        return self.share * self.car.limits.max_compressor_power_w if self.cools else 0.0


class CooperativeCruise(Law):
    """V. Milanés, S. E. Shladover, Transp. Res. C 48, 2014, 285: CACC, gains 0.45 and 0.25.

    The speed changes by ``k_p e + k_d de/dt`` of the error e of the gap in a step, here a tick, and e counts
    the acceleration that is to be found. The time gap is one of today's cars: the 0.6 to 1.1 s of the
    publication are below the smallest gap here.
    """

    headway_s, by_gap, by_rate = 1.6, 0.45, 0.25

    def acceleration_m_s2(
        self, gap_m: float, speed: float, leader: float, measured: iptm.Measurements
    ) -> float:
        """Return ``k_p e + k_d de/dt``, solved for the acceleration in it."""
        del measured
        error_m = gap_m - self.rest_m - self.headway_s * speed
        wanted = self.by_gap * error_m + self.by_rate * (leader - speed)
        return wanted / (1.0 + self.by_rate * self.headway_s)


class Planned(Law):
    """A plan of accelerations at nodes ahead: least squares between bounds.

    Attributes:
        nodes_s: of the plan, the first is now; the acceleration is linear in between.
    """

    nodes_s: FloatArray

    def __init__(self, car: ModelParameters, ticks: int) -> None:
        super().__init__(car, ticks)
        step_s = np.diff(self.nodes_s)
        count = self.nodes_s.size
        # Speed and way at the nodes are linear in the accelerations at the nodes.
        self.speed_of = np.zeros((count, count))
        self.way_of = np.zeros((count, count))
        for node, length_s in enumerate(step_s):
            self.speed_of[node + 1] = self.speed_of[node]
            self.speed_of[node + 1, node : node + 2] += 0.5 * length_s
            self.way_of[node + 1] = self.way_of[node] + length_s * self.speed_of[node]
            self.way_of[node + 1, node] += length_s**2 / 3.0
            self.way_of[node + 1, node + 1] += length_s**2 / 6.0
        self.jerk_of = np.diff(np.eye(count), axis=0) / step_s[:, np.newaxis]

    def solved_m_s2(self, rows: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the accelerations with the least sum of squares of ``rows a - wanted``."""
        limits = self.car.limits
        bounds = limits.min_acceleration_m_s2, limits.max_acceleration_m_s2
        found: FloatArray = lsq_linear(rows, wanted, bounds, method="bvls").x
        return found


class LikeOpenpilot(Planned):
    """The cost of openpilot's longitudinal MPC (comma.ai, long_mpc, 2022), linearised at the present speed.

    Relaxed time gap 1.75 s, stop distance 6 m; costs 3 of the distance, 5 of the jerk, 200 of a changed
    acceleration; the lead vehicle's acceleration fades. It brakes with what the car allows (2 m/s^2 in place
    of 2.5 and 3.5). Left out: danger zone.
    """

    nodes_s: FloatArray = 10.0 * (np.arange(13) / 12.0) ** 2
    time_gap_s, stop_m, fade_1_s = 1.75, 6.0, 1.5
    replanned_s, plans = 0.1, 10
    before_m_s = math.nan

    def __init__(self, car: ModelParameters, ticks: int) -> None:
        super().__init__(car, ticks)
        self.braking_m_s2 = -car.limits.min_acceleration_m_s2
        self.change = np.sqrt(200.0 * np.interp(self.nodes_s, [0.0, 1.0, 2.0], [1.0, 1.0, 0.0]))
        self.plan: FloatArray = np.zeros(self.nodes_s.size)

    def acceleration_m_s2(
        self, gap_m: float, speed: float, leader: float, measured: iptm.Measurements
    ) -> float:
        """Return the mean of a tick in which the plan is made ten times (there twenty)."""
        del measured
        changed_m_s2 = 0.0 if math.isnan(self.before_m_s) else leader - self.before_m_s
        self.before_m_s, began, step_s = leader, speed, self.replanned_s
        for _ in range(self.plans):
            self.plan = self.planned_m_s2(gap_m, speed, leader, changed_m_s2)
            after = max(speed + step_s * float(self.plan[0]), 0.0)
            gap_m += step_s * (leader - 0.5 * (speed + after))
            speed, leader = after, max(leader + step_s * changed_m_s2, 0.0)
        return (speed - began) / (self.plans * step_s)

    def planned_m_s2(
        self, gap_m: float, speed: float, leader: float, changed_m_s2: float
    ) -> FloatArray:
        """Return the accelerations of a plan at the nodes."""
        fading = changed_m_s2 * np.exp(-0.5 * self.fade_1_s * self.nodes_s**2)
        step_s = np.diff(self.nodes_s, prepend=0.0)
        leader_m_s = np.clip(leader + np.cumsum(step_s * fading), 0.0, None)
        free_m = gap_m + np.cumsum(step_s * leader_m_s) + leader_m_s**2 / (2 * self.braking_m_s2)
        # Wanted: v^2 / (2 b) + T v + d, by its tangent at the present speed.
        slope_s = speed / self.braking_m_s2 + self.time_gap_s
        free_m += speed**2 / (2 * self.braking_m_s2) - self.stop_m
        free_m -= speed * (slope_s + self.nodes_s)
        scale = math.sqrt(3.0) / (speed + 10.0)
        rows = np.vstack(
            (
                scale * (self.way_of + slope_s * self.speed_of),
                np.diag(self.change),
                math.sqrt(5.0) * self.jerk_of,
            )
        )
        before = np.interp(self.nodes_s + self.replanned_s, self.nodes_s, self.plan)
        wanted = np.concatenate(
            (scale * free_m, self.change * before, np.zeros(self.nodes_s.size - 1))
        )
        return self.solved_m_s2(rows, wanted)


class LinearMpc(Planned):
    """A textbook linear MPC of the motion: 20 s of preview, gap, acceleration and jerk in squares.

    The power of a battery is convex in the acceleration, so a small sum of squares stands for energy.
    """

    nodes_s: FloatArray = np.arange(21.0, dtype=np.float64)
    headway_s, by_gap, by_change = 1.9, 0.3, 1.0

    def acceleration_m_s2(
        self, gap_m: float, speed: float, leader: float, measured: iptm.Measurements
    ) -> float:
        """Return the mean acceleration of the first tick of the plan."""
        state, seen = measured.state, measured.preview
        ahead_m = gap_m + leader * self.nodes_s
        if state is not None and measured.leader is not None and seen.times_s.size > 1:
            moved_m, _ = seen.at(measured.leader.time_s + self.nodes_s)
            ahead_m = gap_m + moved_m - moved_m[0]
        own_m_s2 = 0.0 if state is None else state.acceleration_m_s2
        free_m = ahead_m - self.rest_m - self.headway_s * speed
        free_m = free_m - speed * self.nodes_s
        first = np.zeros(self.nodes_s.size)
        first[0] = 10.0
        rows = np.vstack(
            (
                self.by_gap * (self.way_of + self.headway_s * self.speed_of),
                np.eye(self.nodes_s.size),
                self.by_change * self.jerk_of,
                first,
            )
        )
        wanted = np.concatenate(
            (self.by_gap * free_m, np.zeros(2 * self.nodes_s.size - 1), [10.0 * own_m_s2])
        )
        plan = self.solved_m_s2(rows, wanted)
        return float(0.5 * (plan[0] + plan[1]))


class TwentyMetresMore(DriverWithThermostat):
    """Bad on purpose: saves by distance."""

    farther_m = 20.0


class ColdAtTheEnd(DriverWithThermostat):
    """Bad on purpose: the compressor runs fully in the last ten minutes."""

    def power_w(self, warm_k: float) -> float:
        """Return the power of the compressor."""
        power_w = super().power_w(warm_k)
        ends = self.tick > self.ticks - 600
        return self.car.limits.max_compressor_power_w if ends else power_w


class Hugging(DriverWithThermostat):
    """Bad on purpose: drives at the smallest gap that is allowed."""

    def acceleration_m_s2(
        self, gap_m: float, speed: float, leader: float, measured: iptm.Measurements
    ) -> float:
        """Return what brings the gap to s_min."""
        del measured
        gap, limits = self.car.gap, self.car.limits
        braking = 2.0 * math.sqrt(-limits.min_acceleration_m_s2 * limits.max_acceleration_m_s2)
        least_m = gap.standstill_gap_m + speed * (gap.time_headway_s + (speed - leader) / braking)
        return 0.3 * (gap_m - least_m) + 0.8 * (leader - speed)


@dataclass(frozen=True)
class Entrant:
    """Who takes part.

    Attributes:
        what: in one line, with its source.
        law: class of a controller, None for a strategy of the suite.
        settings: of the trip, for a strategy.
        is_bad: on purpose; it may not win.
        changes: attributes of the law that differ.
        source: text that names its file, see `foreign`; empty for one of this file.
    """

    name: str
    what: str
    law: Callable[[ModelParameters, int], iptm.Controller] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    is_bad: bool = False
    changes: Mapping[str, float] = field(default_factory=dict)
    source: str = ""

    def controller(self, trip: iptm.Trip) -> iptm.Controller | None:
        """Return a fresh controller for a trip, None for one of the suite."""
        if self.law is None:
            return None
        law = self.law(trip.parameters, trip.ticks)
        for name, value in self.changes.items():
            setattr(law, name, value)
        return law

    @property
    def files(self) -> list[Path]:
        """Files of one from outside."""
        path = place_of(self.source)[0] if self.source else None
        if path is None or path.is_file():
            return [] if path is None else [path]
        return sorted(each for each in path.rglob("*") if each.is_file())


def _said(law: type[Law]) -> str:
    return (law.__doc__ or "").partition("\n")[0]


LEARNED = Path(__file__).parent / "learned.json"


@lru_cache(maxsize=1)
def learned() -> LearnedPolicy:
    """Return the shipped policy."""
    return LearnedPolicy.read(LEARNED)


def _policy(_: ModelParameters, __: int) -> LearnedPolicy:
    return learned()


REFERENCE_HEADWAYS_S = (1.3, 1.6, 1.9, 2.2, 2.6, 3.2, 4.2)
REFERENCE = tuple(
    Entrant(
        f"reference, {headway_s:g} s",
        _said(DriverWithThermostat),
        DriverWithThermostat,
        changes={"headway_s": headway_s},
    )
    for headway_s in REFERENCE_HEADWAYS_S
)
_LAWS: Mapping[str, type[Law]] = {
    "idm": IntelligentDriver,
    "idm_thermostat": DriverWithThermostat,
    "cacc": CooperativeCruise,
    "like_openpilot": LikeOpenpilot,
    "linear_mpc": LinearMpc,
}
_BAD: Mapping[str, type[Law]] = {
    "bad_farther": TwentyMetresMore,
    "bad_cold": ColdAtTheEnd,
    "bad_hugging": Hugging,
}
_STRATEGIES: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    PRODUCTION: ("a tuned car of today", {"strategy": PRODUCTION}),
    PRODUCTION_SIMPLE: ("the same with published gains", {"strategy": PRODUCTION_SIMPLE}),
    BASELINE: ("a smooth cruise control with a long gap", {"strategy": BASELINE}),
    RULE_PREVIEW: ("the gentlest cubic behind the preview", {"strategy": RULE_PREVIEW}),
    "paper": ("the paper's proposal, drawn to a gap", {**EQUAL, "strategy": "aging"}),
    "default": ("the suite's default, drawn to a gap", EQUAL),
    "prices": ("energy, capacity and headway in one currency", {**EQUAL, "strategy": "prices"}),
}
ENTRANTS = (
    *(Entrant(name, _said(law), law) for name, law in _LAWS.items()),
    Entrant(
        "learned",
        "a network of 220 weights, learned by an evolution strategy on synthetic trips",
        _policy,
    ),
    *(Entrant(name, what, settings=given) for name, (what, given) in _STRATEGIES.items()),
    *(Entrant(name, _said(law), law, is_bad=True) for name, law in _BAD.items()),
)
BY_NAME = {entrant.name: entrant for entrant in (*REFERENCE, *ENTRANTS)}


def entrant_of(text: str) -> Entrant:
    """Return an entrant by its name, or by its file.

    Raises:
        ScenarioError: the file does not exist.
    """
    if text in BY_NAME:
        return BY_NAME[text]
    path, inside = place_of(text)
    law = None if has_bags(path) else lambda car, _: controller_of(path, inside, car)
    return Entrant(Path(text).name, f"`{text}`", law, source=text)
