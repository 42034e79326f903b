"""Runs that are made by hand, and the parameters that their figures are worked out with."""

from __future__ import annotations

import numpy as np

from iptm_core.parameters import load_parameters
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

PARAMETERS = load_parameters(
    overrides={
        "gap.standstill_gap_m": 5.0,
        "gap.time_headway_s": 1.5,
        "gap.max_gap_m": 120.0,
        "limits.min_acceleration_m_s2": -2.0,
        "limits.max_acceleration_m_s2": 2.0,
        "limits.max_jerk_m_s3": 0.5,
        "limits.max_compressor_power_w": 4500.0,
        "limits.max_compressor_rate_w_s": 200.0,
        "limits.max_speed_m_s": 37.5,
        "limits.min_temperature_k": 298.15,
        "limits.max_temperature_k": 313.15,
    }
).values


def make_run(rows: int = 4, /, **columns: object) -> Trajectory:
    """A calm run at standstill behind a standing leader, with the given columns replaced."""
    calm = dict.fromkeys(TRAJECTORY_COLUMNS, np.zeros(rows))
    calm["time_s"] = np.arange(float(rows))
    calm["leader_position_m"] = np.full(rows, 15.0)
    calm["state_of_charge"] = np.full(rows, 0.5)
    calm["smallest_gap_m"] = np.full(rows, 1e3)
    for name in TRAJECTORY_COLUMNS:
        if name.endswith("temperature_k"):
            calm[name] = np.full(rows, 303.15)
    return Trajectory.from_arrays({**calm, **columns})  # type: ignore[dict-item]
