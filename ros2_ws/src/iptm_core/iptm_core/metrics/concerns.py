"""Concerns for an operator: limits violated for long, and cooling without effect.

The controller's node evaluates them per tick, the metrics of a run over all rows, both with the conditions
and clocks of this module, so that a warning and a figure of the result table mean the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from iptm_core.metrics.constraints import (
    GAP_TOLERANCE_M,
    SPEED_TOLERANCE_M_S,
    TEMPERATURE_TOLERANCE_K,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import maximum_gap_m, minimum_gap_m
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.physics.ops import Scalar, both, maximum
from iptm_core.state import LeaderState, VehicleState
from iptm_core.trajectory import Trajectory

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
    """What is watched, at one instant (floats) or at all of a run (arrays of shape (n,))."""

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
    hot = broken_limits(at, parameters)[Concern.HOT_CELL]
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
