"""Observations of a trip and actions, in SI units: for environments, and for policies alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from iptm_controller.measurements import (
    LARGEST_GAP_M,
    MAX_SPEED_M_S,
    MOTION_RANGES,
    PACK_RANGES,
    STEEPEST_RAD,
    Measurements,
    slope_at_rad,
)
from iptm_core.errors import ScenarioError
from iptm_core.state import FloatArray

PREVIEW_S = (1.0, 2.0, 5.0, 10.0, 20.0, 40.0)
"""Times ahead at which the predicted speed of the lead vehicle is observed."""
ACTIONS = ("acceleration_m_s2", "compressor_power_w")
"""The fields of `iptm_core.state.Command`, in the order of the action."""
_STATE = {
    "speed_m_s": (0.0, MAX_SPEED_M_S),
    "acceleration_m_s2": MOTION_RANGES["acceleration_m_s2"],
    "compressor_power_w": PACK_RANGES["compressor_power_w"],
    "cell_1_temperature_k": PACK_RANGES["cell_1_temperature_k"],
    "cell_n_temperature_k": PACK_RANGES["cell_n_temperature_k"],
    "state_of_charge": (0.0, 1.0),
}
_SPEED = (0.0, MAX_SPEED_M_S)
OBSERVED: Mapping[str, tuple[float, float]] = {
    **_STATE,
    "slope_rad": (-STEEPEST_RAD, STEEPEST_RAD),
    "gap_m": (-LARGEST_GAP_M, LARGEST_GAP_M),
    "leader_speed_m_s": _SPEED,
    **{f"leader_speed_in_{ahead_s:g}_s_m_s": _SPEED for ahead_s in PREVIEW_S},
}
"""Entries of the observation with their units and ranges. What is measured is clipped to them; a lead vehicle
that is not measured is far away, at the speed of the ego vehicle, and keeps its speed without a preview."""


def observation(measured: Measurements) -> FloatArray:
    """Return the entries of `OBSERVED`."""
    state, leader, preview = measured.state, measured.leader, measured.preview
    if state is None:
        raise ScenarioError("state is not measured; allowed: trips with a measured state")
    gap_m, leader_m_s = LARGEST_GAP_M, state.speed_m_s
    if leader is not None:
        gap_m, leader_m_s = leader.position_m - state.position_m, leader.speed_m_s
    ahead_m_s: FloatArray = np.full(len(PREVIEW_S), leader_m_s)
    if preview.times_s.size:
        ahead_m_s = preview.at(state.time_s + np.array(PREVIEW_S))[1]
    slope_rad = slope_at_rad(measured.slope, state.position_m)
    own = [getattr(state, name) for name in _STATE]
    values = np.array([*own, slope_rad, gap_m, leader_m_s, *ahead_m_s])
    low, high = np.array(list(OBSERVED.values())).T
    return np.clip(np.nan_to_num(values), low, high)
