"""Spacing, comfort, energy and ageing of a run compared with those of the real follower."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from studies.acc.scenes import HEADWAY_FROM_M_S, Scene

from iptm.parts import (
    NO_VALUE,
    FloatArray,
    ModelParameters,
    Trajectory,
    at_equal_end,
    compute_metrics,
)

MOVING_M_S = 1.0


def figures_of(
    run: Trajectory, real: Trajectory, scene: Scene, parameters: ModelParameters
) -> dict[str, float]:
    """Compare a run with the real follower; the real follower itself with itself.

    Gap, time headway and jerk are those of the measured seconds; energy and ageing count from standstill.

    Args:
        run: the run.
        real: the run of the real follower, see `real_follower`.
        scene: the measured scene.
        parameters: of the vehicle.

    Returns:
        ``collided``, whether the lead vehicle was touched; ``smallest_gap_m``; medians ``gap_m`` and
        ``headway_s`` (above 5 m/s); ``below_percent`` of the time with a shorter time headway than the real
        follower's, both moving (missing for itself); ``above_percent`` of the time above 5 m/s with a longer
        one than the 95th percentile of the real follower's; ``jerk_m_s3``, root mean square between means of
        a second; ``emergency_s`` with braking by the safety monitor; ``consumption_kwh_100_km``; savings of
        battery energy per distance (``energy_saving``) and capacity loss (``aging_saving``) at equal ends in
        percent of the real follower's; ``end_gap_m`` and ``end_kinetic_kj`` beyond the real follower's.
    """
    begin = scene.run_in_s
    speed, gap = run.speed_m_s[begin:], run.gap_m[begin:]
    real_speed, real_gap = real.speed_m_s[begin:], real.gap_m[begin:]
    fast = speed > HEADWAY_FROM_M_S
    both = (speed > MOVING_M_S) & (real_speed > MOVING_M_S)
    shorter = gap[both] / speed[both] < real_gap[both] / real_speed[both]
    own_metrics = compute_metrics(run, parameters)
    real_metrics = compute_metrics(real, parameters)
    ends = at_equal_end(own_metrics, real_metrics, parameters)
    energy_saving = aging_saving = math.nan
    if ends is not None:
        mine, theirs = ends
        energy_saving = _saving(mine.energy_per_distance_j_m, theirs.energy_per_distance_j_m)
        aging_saving = _saving(mine.capacity_loss, theirs.capacity_loss)
    headways_s = gap[fast] / speed[fast]
    is_real = run is real
    return {
        "collided": float(not is_real and np.nanmin(run.smallest_gap_m) <= 0.0),
        "smallest_gap_m": float(gap.min() if is_real else np.nanmin(run.smallest_gap_m[begin:])),
        "gap_m": float(np.median(gap)),
        "headway_s": float(np.median(headways_s)),
        "below_percent": math.nan if is_real else 100.0 * float(shorter.mean()),
        "above_percent": 100.0 * float((headways_s > scene.largest_headway_s).mean()),
        "jerk_m_s3": _jerk_m_s3(speed),
        "emergency_s": own_metrics.service_braking_s,
        "consumption_kwh_100_km": own_metrics.battery_energy_j / own_metrics.distance_m / 36.0,
        "energy_saving": energy_saving,
        "aging_saving": aging_saving,
        "end_gap_m": float(gap[-1] - real_gap[-1]),
        "end_kinetic_kj": 1e-3
        * (own_metrics.final_kinetic_energy_j - real_metrics.final_kinetic_energy_j),
    }


def _saving(own: float, real: float) -> float:
    return 100.0 * (1.0 - own / real)


def _jerk_m_s3(speeds_m_s: FloatArray) -> float:
    """Return the root mean square of second differences at steps of a second."""
    return float(np.sqrt(np.mean(np.diff(speeds_m_s, 2) ** 2)))


def spread(values: pd.Series, digits: int) -> str:
    """Return ``median (lower to upper quartile)`` of the known values."""
    known = values.dropna()
    if known.empty:
        return NO_VALUE
    lower, median, upper = np.percentile(known, (25.0, 50.0, 75.0))
    return f"{median:.{digits}f} ({lower:.{digits}f} to {upper:.{digits}f})"
