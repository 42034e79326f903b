"""Measurements of the controller, and their plausibility checks.

A temperature sensor is compared with its model, and the cooling with its command; both carry a memory.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np

from iptm_core.frozen import replace
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import (
    SPEED_AT_REST_M_S,
    LeaderPreview,
    LeaderState,
    PackReading,
    SlopePreview,
    VehicleState,
)

Vehicle = TypeVar("Vehicle", VehicleState, LeaderState)

MAX_TIME_APART_S = 60.0
NOISE_TIME_S = 60.0
"""Time over which the noise of a sensor is averaged."""
LARGEST_GAP_M = 1e4
"""Ahead or behind: an overlap is a measurement like any other, and calls for the brakes."""
MAX_SPEED_M_S = 100.0
STEEPEST_RAD = 1.5

MOTION_RANGES: dict[str, tuple[float, float]] = {
    "time_s": (0.0, float(2**31)),
    "position_m": (-1e9, 1e9),
    "speed_m_s": (SPEED_AT_REST_M_S, MAX_SPEED_M_S),
    "acceleration_m_s2": (-20.0, 20.0),
}
PACK_RANGES: dict[str, tuple[float, float]] = {
    "compressor_power_w": (-2e4, 1e5),
    "cell_1_temperature_k": (223.15, 373.15),
    "cell_n_temperature_k": (223.15, 373.15),
    "cell_1_capacity_loss": (1e-9, 0.9),
    "cell_n_capacity_loss": (1e-9, 0.9),
}


@dataclass(frozen=True)
class Measurements:
    """Measurements of one tick, all of the same instant.

    Attributes:
        state: ego vehicle and pack, None if not measured.
        leader: the preceding vehicle by range sensor, None if not measured.
        preview: newest received prediction, possibly empty.
        slope: road slope over position.
        fault: why something is not measured; empty if all is.
        road: rules of the road, None where none are known.
        pack: coolant and power of the pack, None if not measured.
        is_followed: whether the commands are followed; False while a driver drives.
    """

    state: VehicleState | None
    leader: LeaderState | None
    preview: LeaderPreview
    slope: SlopePreview
    fault: str = ""
    road: RoadAhead | None = None
    pack: PackReading | None = None
    is_followed: bool = True

    @property
    def rules(self) -> RoadAhead | None:
        """The rules of the road that bind the ego vehicle, None for none."""
        return None if self.road is None or self.road.limits is None else self.road

    @property
    def is_free(self) -> bool:
        """Whether no vehicle is ahead, and the rules of the road apply."""
        return self.leader is None and self.rules is not None and not self.rules.has_leader

    def with_state(self, state: VehicleState | None) -> Measurements:
        """Return a copy with another state."""
        return self if state is self.state else replace(self, state=state)


Trusted = tuple[VehicleState | None, LeaderState | None, str]
"""State and leader that may be used, and why no problem can be posed; empty if one can."""


def trusted_measurements(measured: Measurements) -> Trusted:
    """Return the plausible parts: the ego vehicle if its motion is, the leader if both are.

    The `PackObserver` judges the measurements of the pack.
    """
    state, leader = measured.state, measured.leader
    if state is None:
        return None, None, measured.fault or "no measurement of the state"
    fault = motion_fault(state)
    if fault:
        return None, None, fault
    state = _at_rest_if_negative(state)
    if measured.is_free:
        return state, None, slope_fault(measured.slope)
    if leader is None:
        fault = measured.fault or "no measurement of the leader"
        return state, None, fault
    fault = leader_fault(leader, state)
    if fault:
        return state, None, fault
    leader = _at_rest_if_negative(leader)
    return state, leader, slope_fault(measured.slope)


def _at_rest_if_negative(vehicle: Vehicle) -> Vehicle:
    return replace(vehicle, speed_m_s=0.0) if vehicle.speed_m_s < 0.0 else vehicle


def motion_fault(state: VehicleState) -> str:
    """Return why a motion cannot belong to a vehicle, empty if it can."""
    return _out_of_range(state, MOTION_RANGES)


def _out_of_range(state: VehicleState, ranges: Mapping[str, tuple[float, float]]) -> str:
    """Return why a part of a state cannot belong to a vehicle, empty if it can."""
    for name, (low, high) in ranges.items():
        value = getattr(state, name)
        if not low <= value <= high:
            return f"measured {name} is {value}; allowed: {low:g} to {high:g}"
    return ""


def leader_fault(leader: LeaderState, ego: VehicleState) -> str:
    """Return why a leader cannot be where it is measured, empty if it can."""
    if not math.isfinite(leader.time_s):
        return f"measured leader time is {leader.time_s} s; allowed: finite values"
    speed_m_s = leader.speed_m_s
    if not (math.isfinite(speed_m_s) and SPEED_AT_REST_M_S <= speed_m_s <= MAX_SPEED_M_S):
        return (
            f"measured leader speed is {speed_m_s} m/s; "
            f"allowed: {SPEED_AT_REST_M_S:g} to {MAX_SPEED_M_S:g} m/s"
        )
    apart_s = abs(leader.time_s - ego.time_s)
    if not apart_s <= MAX_TIME_APART_S:
        return f"leader was measured {apart_s} s apart from the ego vehicle; allowed: {MAX_TIME_APART_S:g} s"
    gap_m = leader.position_m - ego.position_m
    if not abs(gap_m) <= LARGEST_GAP_M:
        return f"measured gap is {gap_m} m; allowed: {-LARGEST_GAP_M:g} to {LARGEST_GAP_M:g} m"
    return ""


def slope_at_rad(slope: SlopePreview, position_m: float) -> float:
    """Return the slope of the road at a position, as ``numpy.interp`` does in thrice the time."""
    positions_m, slopes_rad = _nodes(slope)
    place = bisect_right(positions_m, position_m)
    if place in {0, len(positions_m)}:
        return slopes_rad[max(place - 1, 0)]
    start_m, start_rad = positions_m[place - 1], slopes_rad[place - 1]
    rate = (slopes_rad[place] - start_rad) / (positions_m[place] - start_m)
    return rate * (position_m - start_m) + start_rad


@lru_cache(maxsize=8)
def _nodes(slope: SlopePreview) -> tuple[list[float], list[float]]:
    return slope.positions_m.tolist(), slope.slopes_rad.tolist()


@lru_cache(maxsize=8)  # the road ahead stays the same object for many ticks
def slope_fault(slope: SlopePreview) -> str:
    """Return why a road cannot be driven on, empty if it can."""
    sizes = (slope.positions_m.size, slope.slopes_rad.size)
    if sizes[0] != sizes[1] or not sizes[0]:
        return (
            f"slope has {sizes[0]} positions and {sizes[1]} slopes; allowed: equal numbers from 1"
        )
    if not (np.isfinite(slope.positions_m).all() and np.isfinite(slope.slopes_rad).all()):
        return "slope has positions or slopes that are not finite numbers"
    steepest = float(np.abs(slope.slopes_rad).max())
    if steepest > STEEPEST_RAD:
        return f"slope is {steepest} rad; allowed: {STEEPEST_RAD:g} rad up or down"
    return ""


TOLERANCE_K = 2.5
"""Least difference from the model at which a sensor is rejected; noise raises it to at most twice as much."""
NOISE_FACTOR = 5.0
STUCK_K = 0.02
STUCK_STEPS = 5.0
"""A sensor is stuck when the model has moved by both, in K and in steps of the sensor, since it changed."""
RECOVERY_S = 10.0
APART_K = 6.0
"""Cells of one channel do not start a trip farther apart."""
START_S = 10.0
"""In which two sensors that are alike, and both unlike the model, show that the first values were wrong."""
CORRECTION_1_S = 0.05
EFFECT_W, EFFECT_SHARE, EFFECT_S = 300.0, 0.3, 20.0
"""Cooling below this share of an expected heat of at least this power has no effect, after this time."""
FOLLOW_W, FOLLOW_SHARE, FOLLOW_S = 30.0, 0.3, 8.0
"""A compressor that draws less than this share of a command of at least this power does not follow it."""


_COLDEST_K, _WARMEST_K = PACK_RANGES["cell_1_temperature_k"]


def is_temperature(value_k: float) -> bool:
    """Return whether a cell or its coolant may have a temperature."""
    return _COLDEST_K <= value_k <= _WARMEST_K


@dataclass(frozen=True)
class SensorMemory:
    """Of one temperature sensor.

    Attributes:
        model_k: temperature of the model, NaN before the first tick.
        value_k: last measured value.
        moved_k: distance that the model has moved since the value changed.
        step_k: smallest change of the value so far.
        noise_k2: mean square of the difference from the model.
        bad_s: time since it is not used, 0 while it is.
        sound_s: time for which a sensor that is not used has agreed with the model.
    """

    model_k: float = math.nan
    value_k: float = math.nan
    moved_k: float = 0.0
    step_k: float = 0.25
    noise_k2: float = 0.0
    bad_s: float = 0.0
    sound_s: float = 0.0

    def judged(self, value_k: float, by_k: float, elapsed_s: float) -> SensorMemory:
        """Return the sensor at a tick: whether it is used, from its value and the model.

        Args:
            by_k: by how much the model has moved.
        """
        model_k, step_k, moved_k = self.model_k + by_k, self.step_k, self.moved_k + abs(by_k)
        apart_k = value_k - model_k
        noise_k = NOISE_FACTOR * math.sqrt(self.noise_k2)
        tolerance_k = min(max(TOLERANCE_K, noise_k), 2.0 * TOLERANCE_K)
        if value_k != self.value_k:
            moved_k = 0.0
            if math.isfinite(self.value_k) and math.isfinite(value_k):
                step_k = min(step_k, abs(value_k - self.value_k))
        is_stuck = moved_k > max(STUCK_K, STUCK_STEPS * step_k)
        is_wrong = is_stuck or not (is_temperature(value_k) and abs(apart_k) <= tolerance_k)
        sound_s = 0.0 if is_wrong else self.sound_s + elapsed_s
        bad_s = self.bad_s + elapsed_s if is_wrong or self.bad_s else 0.0
        if is_wrong:
            bad_s = max(bad_s, 1e-9)
        elif sound_s >= RECOVERY_S:
            bad_s = 0.0
        noise_k2 = self.noise_k2
        if not bad_s:
            noise_k2 += min(elapsed_s / NOISE_TIME_S, 1.0) * (apart_k * apart_k - noise_k2)
        return SensorMemory(model_k, value_k, moved_k, step_k, noise_k2, bad_s, sound_s)

    def corrected(self, by_k: float) -> SensorMemory:
        """Return the sensor with a model that is corrected."""
        return SensorMemory(
            self.model_k + by_k,
            self.value_k,
            self.moved_k,
            self.step_k,
            self.noise_k2,
            self.bad_s,
            self.sound_s,
        )


@dataclass(frozen=True)
class CoolingMemory:
    """Of compressor, pump and fan.

    Attributes:
        without_effect_s: for how long cooling, or heating, has had no effect.
        unfollowed_s: for how long the compressor has not followed its command.
    """

    without_effect_s: float = 0.0
    unfollowed_s: float = 0.0

    @property
    def has_no_effect(self) -> bool:
        """Whether cooling has had no effect for long."""
        return self.without_effect_s > EFFECT_S

    @property
    def is_ignored(self) -> bool:
        """Whether the compressor has not followed its command for long."""
        return self.unfollowed_s > FOLLOW_S

    def after(
        self, elapsed_s: float, taken_w: float, expected_w: float, drawn_w: float, asked_w: float
    ) -> CoolingMemory:
        """Return the memory a tick later.

        Args:
            taken_w: heat that the coolant loses on its way round, negative where it is heated.
            expected_w: what it ought to lose at the power that is drawn.
            drawn_w: measured power of the compressor, negative of the heater.
            asked_w: its last command.
        """
        # Where little is asked for, nothing is shown: the times stay as they are.
        without_effect_s, unfollowed_s = self.without_effect_s, self.unfollowed_s
        if abs(expected_w) > EFFECT_W:
            fails = not taken_w / expected_w >= EFFECT_SHARE
            without_effect_s = without_effect_s + elapsed_s if fails else 0.0
        if abs(asked_w) > FOLLOW_W:
            ignored = drawn_w / asked_w < FOLLOW_SHARE
            unfollowed_s = unfollowed_s + elapsed_s if ignored else 0.0
        elif abs(drawn_w) > FOLLOW_W:
            unfollowed_s = 0.0  # it follows late
        return CoolingMemory(without_effect_s, unfollowed_s)


def are_alike(sensors: list[SensorMemory], measured_k: list[float]) -> bool:
    """Return whether both sensors contradict the model, but not each other."""
    (first, last), (first_k, last_k) = sensors, measured_k
    contradict = bool(first.bad_s and last.bad_s)
    possible = is_temperature(first_k) and is_temperature(last_k)
    return contradict and possible and abs(first_k - last_k) <= APART_K


def corrected(
    sensors: list[SensorMemory], measured_k: list[float], offset_k: float, elapsed_s: float
) -> list[SensorMemory]:
    """Return the sensors with their models corrected: by its value, the other sensor, or the coolant."""
    gain = min(CORRECTION_1_S * elapsed_s, 1.0)
    (first, last), (first_k, last_k) = sensors, measured_k
    apart_k, last_apart_k = first_k - first.model_k, last_k - last.model_k
    if first.bad_s:
        apart_k = offset_k if last.bad_s else last_apart_k
    if last.bad_s:
        last_apart_k = offset_k if first.bad_s else apart_k
    return [first.corrected(gain * apart_k), last.corrected(gain * last_apart_k)]
