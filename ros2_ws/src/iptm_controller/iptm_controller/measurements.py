"""What the controller acts on, and how much of it is plausible before anything is computed from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

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
LARGEST_GAP_M = 1e4
"""Ahead or behind: an overlap is a measurement like any other, and calls for the brakes."""
MAX_SPEED_M_S = 100.0
STEEPEST_RAD = 1.5

_MOTION: dict[str, tuple[float, float]] = {
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
    """What is measured at one tick, all of the same instant.

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


Trusted = tuple[VehicleState | None, LeaderState | None, str]
"""State and leader that may be used, and why no problem can be posed; empty if one can."""


def trusted_measurements(measured: Measurements) -> Trusted:
    """Return what is plausible: the ego vehicle if its motion is, the leader if both are.

    What is measured of the pack is for the `PackObserver` to judge.
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
    return _out_of_range(state, _MOTION)


def _out_of_range(state: VehicleState, ranges: Mapping[str, tuple[float, float]]) -> str:
    """Return why a part of a state cannot belong to a vehicle, empty if it can."""
    for name, (low, high) in ranges.items():
        value = getattr(state, name)
        if not (math.isfinite(value) and low <= value <= high):
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
    """Return the slope of the road at a position."""
    return float(np.interp(position_m, slope.positions_m, slope.slopes_rad))


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
