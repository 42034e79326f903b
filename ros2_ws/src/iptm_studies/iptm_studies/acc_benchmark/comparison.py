"""Spacing, comfort, energy and ageing of a run compared with those of the real follower."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.metrics import at_equal_end, compute_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_studies.acc_benchmark.scenes import HEADWAY_FROM_M_S, Scene

MOVING_M_S = 1.0


@dataclass(frozen=True)
class Figures:
    """One vehicle behind one lead vehicle.

    Gap, time headway and jerk are those of the measured seconds; energy and ageing count from standstill.

    Attributes:
        collided: whether the lead vehicle was touched.
        smallest_gap_m: smallest gap.
        gap_m: median gap.
        headway_s: median time headway above 5 m/s.
        below_share: share of the time with a shorter time headway than the real follower's, both moving;
            NaN for the real follower itself.
        above_share: share of the time above 5 m/s with a longer time headway than the 95th percentile of the
            real follower's.
        jerk_m_s3: root mean square of the jerk between means of a second.
        emergency_s: time with braking beyond the limits of comfort by the safety monitor.
        consumption_kwh_100_km: battery energy per distance.
        energy_saving: saving of battery energy per distance in percent of the real follower's, at equal ends.
        aging_saving: the same of capacity loss.
        end_gap_m: gap at the end less that of the real follower.
        end_kinetic_j: kinetic energy at the end less that of the real follower.
    """

    collided: bool
    smallest_gap_m: float
    gap_m: float
    headway_s: float
    below_share: float
    above_share: float
    jerk_m_s3: float
    emergency_s: float
    consumption_kwh_100_km: float
    energy_saving: float
    aging_saving: float
    end_gap_m: float
    end_kinetic_j: float


def figures_of(
    run: Trajectory, real: Trajectory, scene: Scene, parameters: ModelParameters
) -> Figures:
    """Compare a run with the real follower; the real follower itself with itself.

    Args:
        run: the run.
        real: the run of the real follower, see `real_follower`.
        scene: the measured scene.
        parameters: of the vehicle.
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
        energy_saving = _saving(
            ends.own.energy_per_distance_j_m, ends.other.energy_per_distance_j_m
        )
        aging_saving = _saving(ends.own.capacity_loss, ends.other.capacity_loss)
    headways_s = gap[fast] / speed[fast]
    smallest_m = float(np.nanmin(run.smallest_gap_m[begin:])) if run is not real else gap.min()
    return Figures(
        collided=bool(np.nanmin(run.smallest_gap_m) <= 0.0) if run is not real else False,
        smallest_gap_m=float(smallest_m),
        gap_m=float(np.median(gap)),
        headway_s=float(np.median(headways_s)),
        below_share=math.nan if run is real else float(shorter.mean()),
        above_share=float((headways_s > scene.largest_headway_s).mean()),
        jerk_m_s3=_jerk_m_s3(speed),
        emergency_s=own_metrics.service_braking_s,
        consumption_kwh_100_km=own_metrics.energy.battery_j / own_metrics.distance_m / 36.0,
        energy_saving=energy_saving,
        aging_saving=aging_saving,
        end_gap_m=float(gap[-1] - real_gap[-1]),
        end_kinetic_j=own_metrics.end.kinetic_energy_j - real_metrics.end.kinetic_energy_j,
    )


def _saving(own: float, real: float) -> float:
    return 100.0 * (1.0 - own / real)


def _jerk_m_s3(speeds_m_s: FloatArray) -> float:
    """Return the root mean square of second differences at steps of a second."""
    return float(np.sqrt(np.mean(np.diff(speeds_m_s, 2) ** 2)))


@dataclass(frozen=True)
class Spread:
    """Median and quartiles over lead vehicles; NaN where nothing is known."""

    median: float
    lower: float
    upper: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Summarise the known values."""
        known = np.array([value for value in values if math.isfinite(value)])
        if known.size == 0:
            return cls(math.nan, math.nan, math.nan)
        lower, median, upper = np.percentile(known, (25.0, 50.0, 75.0))
        return cls(float(median), float(lower), float(upper))

    def text(self, digits: int) -> str:
        """Return ``median (lower to upper)``."""
        if math.isnan(self.median):
            return "–"
        return f"{self.median:.{digits}f} ({self.lower:.{digits}f} to {self.upper:.{digits}f})"


def column(rows: Sequence[Figures], name: str) -> list[float]:
    """Return one figure of all lead vehicles."""
    return [float(getattr(row, name)) for row in rows]


Found = Mapping[str, Sequence[Figures]]
"""Figures of all lead vehicles by way of driving."""
