"""Limits that a run kept (eq_cons1 to eq_cons8 of the paper), and concerns for an operator.

The bounds and rates of the two inputs are hard: no command may ever break them. Speed, spacing and
temperatures are soft: the controller pays for breaking them but may have to. A collision, which no soft
limit may be traded for, is a hard violation, and so is a charge that no pack can hold.

Concerns are limits violated for long, and cooling without effect. The controller's node evaluates them per
tick, the metrics of a run over all rows, both with the conditions and clocks of this module, so that a
warning and a figure of the result table mean the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import maximum_gap_m, minimum_gap_m
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.physics.ops import Scalar, both, maximum
from iptm_core.state import FloatArray, LeaderState, VehicleState
from iptm_core.trajectory import Trajectory

ACCELERATION_TOLERANCE_M_S2 = 1e-6
POWER_TOLERANCE_W = 1e-3
SPEED_TOLERANCE_M_S = 1e-3
GAP_TOLERANCE_M = 0.01
TEMPERATURE_TOLERANCE_K = 0.01
CHARGE_TOLERANCE = 1e-6

_Row = tuple[str, str, str, FloatArray, float]
"""One limit: key, label, unit, excess at every instant (negative inside the limit), tolerance."""


@dataclass(frozen=True)
class ConstraintCheck:
    """How well a run kept one limit.

    Attributes:
        unit: unit of ``worst_excess`` and ``tolerance``.
        violations: number of rows where the excess is larger than ``tolerance``.
        worst_excess: largest amount by which the limit was exceeded, 0 if it never was.
        worst_time_s: when that happened; None if the limit was never exceeded.
        first_time_s: when it was first exceeded by more than ``tolerance``; None if it never was.
    """

    key: str
    label: str
    unit: str
    hard: bool
    violations: int
    worst_excess: float
    worst_time_s: float | None
    tolerance: float
    first_time_s: float | None = None

    @property
    def text(self) -> str:
        """One line about a broken limit: which, how far, how often and when first."""
        kind = "hard" if self.hard else "soft"
        plural = "" if self.violations == 1 else "s"
        amount = (
            ""
            if self.worst_time_s is None
            else (f", worst by {self.worst_excess:.3g} {self.unit} at {self.worst_time_s:g} s")
        )
        since = "" if self.first_time_s is None else f", first at {self.first_time_s:g} s"
        return f"{self.label} ({kind} limit): {self.violations} tick{plural}{since}{amount}"


def check_constraints(
    trajectory: Trajectory, parameters: ModelParameters
) -> tuple[ConstraintCheck, ...]:
    """Check every limit on every row of a run.

    Rates are checked from row to row, so that row 0 serves as the input before the run. Where a vehicle comes
    to rest its deceleration ends with the motion, and where it meets its top speed its acceleration: no
    command does that, and it breaks no limit. Service braking keeps to the brakes of the vehicle, not to the
    limits of comfort. Collisions are looked for inside the intervals as well.

    Returns:
        One check per limit, hard ones first; none of what is not known in any row.
    """
    limits, gap = parameters.limits, parameters.gap
    run = trajectory
    intervals = np.diff(run.time_s, prepend=run.time_s[:1])
    braked = run.service_braking_s > 0.0
    hardest = np.where(
        braked, -parameters.brakes.max_deceleration_m_s2, limits.min_acceleration_m_s2
    )
    acceleration = _outside(run.acceleration_m_s2, hardest, limits.max_acceleration_m_s2)
    jerk = _steps(run.acceleration_m_s2) - limits.max_jerk_m_s3 * intervals
    free = _speed_ends_acceleration(run, limits.max_speed_m_s)
    free |= braked | np.concatenate(([False], braked[:-1]))
    jerk = np.where(free, -limits.max_jerk_m_s3 * intervals, jerk)
    compressor = _outside(
        run.compressor_power_w, limits.lowest_thermal_power_w, limits.max_compressor_power_w
    )
    ramp = _steps(run.compressor_power_w) - limits.max_compressor_rate_w_s * intervals
    speed = _outside(run.speed_m_s, limits.min_speed_m_s, limits.max_speed_m_s)
    cell_1, cell_n, outlet = (
        _outside(values, limits.min_temperature_k, limits.max_temperature_k)
        for values in (
            run.cell_1_temperature_k,
            run.cell_n_temperature_k,
            run.coolant_outlet_temperature_k,
        )
    )
    largest_m = maximum_gap_m(run.speed_m_s, gap)
    impossible = _outside(run.state_of_charge, 0.0, 1.0)
    low_charge = parameters.charge.min_charge - run.state_of_charge
    m_s2, watt, kelvin = ACCELERATION_TOLERANCE_M_S2, POWER_TOLERANCE_W, TEMPERATURE_TOLERANCE_K
    # fmt: off
    hard: tuple[_Row, ...] = (
        ("acceleration", "acceleration", "m/s^2", acceleration, m_s2),
        ("acceleration_step", "change of acceleration in one interval", "m/s^2", jerk, m_s2),
        ("compressor_power", "compressor power", "W", compressor, watt),
        ("compressor_power_step", "change of compressor power in one interval", "W", ramp, watt),
        ("collision", "collision", "m", -run.closest_m, 0.0),
        ("charge", "charge outside of 0 to 100 %", "1", impossible, CHARGE_TOLERANCE),
    )
    soft: tuple[_Row, ...] = (
        ("speed", "speed", "m/s", speed, SPEED_TOLERANCE_M_S),
        ("smallest_gap", "gap below s_min", "m", -gap_margins_m(run, parameters), GAP_TOLERANCE_M),
        ("largest_gap", "gap above s_max", "m", run.gap_m - largest_m, GAP_TOLERANCE_M),
        ("cell_1_temperature", "temperature of cell 1", "K", cell_1, kelvin),
        ("cell_n_temperature", "temperature of cell N", "K", cell_n, kelvin),
        ("coolant_outlet_temperature", "coolant outlet temperature", "K", outlet, kelvin),
        ("state_of_charge", "state of charge below soc_min", "1", low_charge, CHARGE_TOLERANCE),
    )
    # fmt: on
    rows = [*((row, True) for row in hard), *((row, False) for row in soft)]
    return tuple(
        _check(run, row, hard=is_hard) for row, is_hard in rows if not np.all(np.isnan(row[3]))
    )


def gap_margins_m(trajectory: Trajectory, parameters: ModelParameters) -> FloatArray:
    """Return gap less s_min at every instant, shape (n,); negative where violated, NaN without a leader."""
    smallest = minimum_gap_m(
        trajectory.speed_m_s, trajectory.leader_speed_m_s, parameters.gap, parameters.limits
    )
    margins: FloatArray = trajectory.gap_m - smallest
    return margins


def _steps(values: FloatArray) -> FloatArray:
    """Return the magnitude of the change from the row before, shape (n,), 0 in row 0."""
    steps: FloatArray = np.abs(np.diff(values, prepend=values[:1]))
    return steps


def _speed_ends_acceleration(run: Trajectory, top_speed_m_s: float) -> NDArray[np.bool_]:
    """Return the rows in which braking ended at standstill or speeding up at the top speed, shape (n,)."""
    before = np.concatenate(([0.0], run.acceleration_m_s2[:-1]))
    halts = (before < 0.0) & (run.speed_m_s == 0.0)
    tops = (before > 0.0) & (run.speed_m_s == top_speed_m_s)
    ends: NDArray[np.bool_] = (halts | tops) & (run.acceleration_m_s2 == 0.0)
    return ends


def _outside(values: FloatArray, lower: float | FloatArray, upper: float) -> FloatArray:
    """Return the distance to the permitted interval, negative inside."""
    return np.maximum(lower - values, values - upper)


def _check(run: Trajectory, row: _Row, *, hard: bool) -> ConstraintCheck:
    key, label, unit, excess, tolerance = row
    worst = int(np.nanargmax(excess))
    exceeded = bool(excess[worst] > 0.0)
    beyond = np.flatnonzero(excess > tolerance)
    return ConstraintCheck(
        key=key,
        label=label,
        unit=unit,
        hard=hard,
        violations=int(beyond.size),
        worst_excess=float(excess[worst]) if exceeded else 0.0,
        worst_time_s=float(run.time_s[worst]) if exceeded else None,
        tolerance=tolerance,
        first_time_s=float(run.time_s[beyond[0]]) if beyond.size else None,
    )


NEAR_FULL_POWER = 0.95
"""Share of the largest useful compressor power from which the compressor is considered at its limit."""
EFFECT_K = 0.1
"""Fall of the warmest cell that is considered an effect of cooling."""


class Concern(Enum):
    """What may go on for too long; the value is part of the keys of figures."""

    SHORT_GAP = "gap_below_s_min"
    LONG_GAP = "gap_above_s_max"
    SPEED = "speed_out_of_limits"
    HOT_CELL = "cell_above_limit"
    COOLING = "cooling_without_effect"
    PLAN = "plan_out_of_limits"


@dataclass(frozen=True)
class Situation:
    """Watched quantities, at one instant (floats) or at all of a run (arrays of shape (n,))."""

    gap_m: Scalar
    speed_m_s: Scalar
    leader_speed_m_s: Scalar
    warmest_cell_k: Scalar
    compressor_power_w: Scalar

    @classmethod
    def at(cls, state: VehicleState, leader: LeaderState) -> Situation:
        """Situation of one tick."""
        return cls(
            gap_m=leader.position_m - state.position_m,
            speed_m_s=state.speed_m_s,
            leader_speed_m_s=leader.speed_m_s,
            warmest_cell_k=max(state.cell_1_temperature_k, state.cell_n_temperature_k),
            compressor_power_w=state.compressor_power_w,
        )

    @classmethod
    def over(cls, run: Trajectory) -> Situation:
        """Situations of all rows of a run."""
        return cls(
            gap_m=run.gap_m,
            speed_m_s=run.speed_m_s,
            leader_speed_m_s=run.leader_speed_m_s,
            warmest_cell_k=maximum(run.cell_1_temperature_k, run.cell_n_temperature_k),
            compressor_power_w=run.compressor_power_w,
        )


def broken_limits(at: Situation, parameters: ModelParameters) -> dict[Concern, Scalar]:
    """Return for each watched soft limit whether it is broken by more than its tolerance.

    A cell below its lower limit only forbids cooling; the controller cannot correct it, so it is not counted.
    """
    limits, gap = parameters.limits, parameters.gap
    smallest = minimum_gap_m(at.speed_m_s, at.leader_speed_m_s, gap, limits)
    speed_excess = maximum(limits.min_speed_m_s - at.speed_m_s, at.speed_m_s - limits.max_speed_m_s)
    return {
        Concern.SHORT_GAP: at.gap_m < smallest - GAP_TOLERANCE_M,
        Concern.LONG_GAP: at.gap_m > maximum_gap_m(at.speed_m_s, gap) + GAP_TOLERANCE_M,
        Concern.SPEED: speed_excess > SPEED_TOLERANCE_M_S,
        Concern.HOT_CELL: at.warmest_cell_k > limits.max_temperature_k + TEMPERATURE_TOLERANCE_K,
    }


def cooling_at_limit(at: Situation, parameters: ModelParameters) -> Scalar:
    """Return whether the compressor runs near its largest useful power while a cell is too hot."""
    hot = at.warmest_cell_k > parameters.limits.max_temperature_k + TEMPERATURE_TOLERANCE_K
    useful_w = largest_useful_power_w(parameters.chiller, parameters.limits)
    return both(hot, at.compressor_power_w >= NEAR_FULL_POWER * useful_w)


class Streak:
    """For how long a condition has held without a break; fed in the order of time."""

    def __init__(self) -> None:
        self._since_s: float | None = None
        self._last_s = float("-inf")

    def update(self, time_s: float, *, holds: bool) -> float:
        """Return for how long the condition has held, in s; an earlier instant begins a new trip."""
        if not holds or time_s < self._last_s:
            self._since_s = None
        self._last_s = time_s
        if not holds:
            return 0.0
        if self._since_s is None:
            self._since_s = time_s
        return time_s - self._since_s


class IneffectiveCooling:
    """For how long the compressor has been at its limit without a fall of the warmest cell."""

    def __init__(self) -> None:
        self._streak = Streak()
        self._warmest_k = float("-inf")

    def update(self, time_s: float, warmest_cell_k: float, *, at_limit: bool) -> float:
        """Take an instant into account; returns the time without effect, in s.

        A fall by ``EFFECT_K`` below the highest temperature since the beginning is an effect, from which
        the time restarts.
        """
        if at_limit and warmest_cell_k <= self._warmest_k - EFFECT_K:
            self._streak = Streak()
        lasted_s = self._streak.update(time_s, holds=at_limit)
        if lasted_s == 0.0:
            self._warmest_k = float("-inf")
        self._warmest_k = max(self._warmest_k, warmest_cell_k)
        return lasted_s


def longest_times_s(run: Trajectory, parameters: ModelParameters) -> Mapping[Concern, float]:
    """Return for how long in a row each concern lasted at most, in s; NaN for what is not known in any row.

    Plans have no such figure: a trajectory does not hold them.
    """
    at = Situation.over(run)
    times = run.time_s.tolist()
    longest: dict[Concern, float] = {}
    for concern, broken in broken_limits(at, parameters).items():
        streak = Streak()
        longest[concern] = max(
            streak.update(time_s, holds=holds)
            for time_s, holds in zip(times, broken.tolist(), strict=True)
        )
    gap_concerns = (Concern.SHORT_GAP, Concern.LONG_GAP)
    unknown = [*(gap_concerns if np.all(np.isnan(run.gap_m)) else ())]
    if np.all(np.isnan(at.warmest_cell_k)):
        unknown += [Concern.HOT_CELL, Concern.COOLING]
    elif np.all(np.isnan(run.compressor_power_w)):
        unknown.append(Concern.COOLING)
    futile = IneffectiveCooling()
    rows = zip(
        times, at.warmest_cell_k.tolist(), cooling_at_limit(at, parameters).tolist(), strict=True
    )
    longest[Concern.COOLING] = max(
        futile.update(time_s, warmest_k, at_limit=at_limit) for time_s, warmest_k, at_limit in rows
    )
    return {**longest, **dict.fromkeys(unknown, float("nan"))}
