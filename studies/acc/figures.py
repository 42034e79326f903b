"""Spacing, comfort, energy and ageing of a run compared with the real follower's."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from studies.acc.scenes import Scene
from studies.savings import road_taken, savings

from iptm_core.markdown import NO_VALUE
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K

ROLLING_M_S = 1.0
REAL = "real follower"


def figures_of(
    run: Trajectory,
    scene: Scene,
    parameters: ModelParameters,
    real: Trajectory,
    bases: Mapping[str, Trajectory],
) -> dict[str, float]:
    """Compare a run with the real follower, and with the bases of every saving.

    Gap, headway and jerk cover the measured seconds; energy and ageing count from standstill.

    Args:
        run: the run.
        scene: the measured scene.
        parameters: of the vehicle.
        real: the run of the real follower, see `real_follower`.
        bases: runs of the bases by name.

    Returns:
        `road_taken`; `savings` against the bases and the ``real`` follower; ``off_headway_s``, by how much
        the median headway is off the real follower's; ``collided``, whether the lead vehicle was touched;
        ``smallest_gap_m``; ``below_percent`` of the time with a shorter time headway than the real
        follower's, both moving (missing for itself); ``jerk_m_s3``, root mean square between means of a
        second; ``emergency_s`` with braking by the safety monitor; ``consumption_kwh_100_km``;
        ``cooling_kwh`` of compressor and auxiliaries; ``end_c``, the mean of both cells at the end.
    """
    begin = scene.run_in_s
    speed, gap = run.speed_m_s[begin:], run.gap_m[begin:]
    real_speed, real_gap = real.speed_m_s[begin:], real.gap_m[begin:]
    both = (speed > ROLLING_M_S) & (real_speed > ROLLING_M_S)
    shorter = gap[both] / speed[both] < real_gap[both] / real_speed[both]
    metrics = compute_metrics(run, parameters)
    others = {name: [compute_metrics(base, parameters)] for name, base in bases.items()}
    others["real"] = [compute_metrics(real, parameters)]
    is_real = run is real
    smallest_gap_m = gap.min() if is_real else np.nanmin(run.smallest_gap_m[begin:])
    road = road_taken([run], begin)
    return {
        **road,
        **savings([metrics], others, parameters),
        "off_headway_s": abs(road["headway_s"] - float(np.median(scene.headways_s))),
        "collided": float(not is_real and np.nanmin(run.smallest_gap_m) <= 0.0),
        "smallest_gap_m": float(smallest_gap_m),
        "below_percent": math.nan if is_real else 100.0 * float(shorter.mean()),
        "jerk_m_s3": jerk_m_s3(speed),
        "emergency_s": metrics.service_braking_s,
        "consumption_kwh_100_km": metrics.battery_energy_j / metrics.distance_m / 36.0,
        "cooling_kwh": metrics.cooling_energy_j / 3.6e6,
        "end_c": metrics.final_temperature_k - CELSIUS_ZERO_K,
    }


def jerk_m_s3(speeds_m_s: FloatArray) -> float:
    """Return the root mean square of second differences at steps of a second."""
    return float(np.sqrt(np.mean(np.diff(speeds_m_s, 2) ** 2)))


def spread(values: pd.Series, digits: int) -> str:
    """Return ``median (lower to upper quartile)`` of the known values."""
    known = values.dropna()
    if known.empty:
        return NO_VALUE
    lower, median, upper = np.percentile(known, (25.0, 50.0, 75.0))
    return f"{median:.{digits}f} ({lower:.{digits}f} to {upper:.{digits}f})"
