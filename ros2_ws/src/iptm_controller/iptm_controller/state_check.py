"""Plausibility of a measured state before anything is computed from it."""

from __future__ import annotations

import math

import numpy as np

from iptm_core.errors import StateError
from iptm_core.state import LeaderState, SlopePreview, VehicleState

MAX_TIME_APART_S = 60.0
MAX_GAP_M = 1e4
STEEPEST_RAD = 1.5

_RANGES: dict[str, tuple[float, float]] = {
    "time_s": (0.0, 1e9),
    "position_m": (-1e9, 1e9),
    "speed_m_s": (0.0, 100.0),
    "acceleration_m_s2": (-20.0, 20.0),
    "compressor_power_w": (0.0, 1e5),
    "cell_1_temperature_k": (223.15, 373.15),
    "cell_n_temperature_k": (223.15, 373.15),
    "cell_1_capacity_loss": (1e-9, 0.9),
    "cell_n_capacity_loss": (1e-9, 0.9),
}


def check_state(state: VehicleState) -> None:
    """Refuse a state that is not finite or outside what any vehicle can be in.

    Raises:
        StateError: names the quantity, its value and the permitted range.
    """
    for name, (low, high) in _RANGES.items():
        value = getattr(state, name)
        if not (math.isfinite(value) and low <= value <= high):
            raise StateError(f"measured {name} = {value}, allowed are {low:g} to {high:g}")


def check_leader(leader: LeaderState, host: VehicleState) -> None:
    """Refuse a leader that is not finite, drives backwards, is behind the host or out of sight.

    Raises:
        StateError: names the quantity, its value and what is allowed.
    """
    if not math.isfinite(leader.time_s):
        raise StateError(f"measured leader time = {leader.time_s} s, allowed are finite values")
    if not (math.isfinite(leader.speed_m_s) and 0.0 <= leader.speed_m_s <= 100.0):
        raise StateError(f"measured leader speed = {leader.speed_m_s} m/s, allowed are 0 to 100")
    apart_s = abs(leader.time_s - host.time_s)
    if not apart_s <= MAX_TIME_APART_S:
        raise StateError(
            f"leader was measured {apart_s} s apart from the host, allowed are {MAX_TIME_APART_S:g} s"
        )
    gap_m = leader.position_m - host.position_m
    if not -1.0 <= gap_m <= MAX_GAP_M:
        raise StateError(f"measured gap = {gap_m} m, allowed are -1 to {MAX_GAP_M:g} m")


def check_slope(slope: SlopePreview) -> None:
    """Refuse a road without nodes, with unequal numbers of them, not finite or as steep as a wall.

    Raises:
        StateError: says what is wrong.
    """
    sizes = (slope.positions_m.size, slope.slopes_rad.size)
    if sizes[0] != sizes[1] or not sizes[0]:
        raise StateError(
            f"slope has {sizes[0]} positions and {sizes[1]} slopes, "
            "allowed are equal numbers from 1"
        )
    if not (np.isfinite(slope.positions_m).all() and np.isfinite(slope.slopes_rad).all()):
        raise StateError("slope has positions or slopes that are not finite numbers")
    steepest = float(np.abs(slope.slopes_rad).max())
    if steepest > STEEPEST_RAD:
        raise StateError(f"slope of {steepest} rad, allowed are {STEEPEST_RAD:g} rad up or down")
