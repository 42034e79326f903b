"""How disturbances travel along a string of vehicles: deviations from vehicle to vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.metrics import gap_margins_m
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class Deviations:
    """How far one member of a string departs from steady driving; NaN where it has no such quantity.

    Attributes:
        speed_m_s: standard deviation of the speed.
        acceleration_m_s2: root mean square of the acceleration.
        peak_acceleration_m_s2: largest magnitude of the acceleration.
        gap_m: standard deviation of the gap.
        smallest_margin_m: smallest distance of the gap from its lower limit s_min.
        largest_gap_m: largest gap.
    """

    speed_m_s: float
    acceleration_m_s2: float
    peak_acceleration_m_s2: float
    gap_m: float = math.nan
    smallest_margin_m: float = math.nan
    largest_gap_m: float = math.nan

    def amplification(self, ahead: Deviations) -> Deviations:
        """Return the ratios to the member ahead: below 1 a disturbance fades, above 1 it grows.

        A ratio is NaN where the member ahead does not deviate at all.
        """
        return Deviations(
            *(
                own / other if other else math.nan
                for own, other in (
                    (self.speed_m_s, ahead.speed_m_s),
                    (self.acceleration_m_s2, ahead.acceleration_m_s2),
                    (self.peak_acceleration_m_s2, ahead.peak_acceleration_m_s2),
                    (self.gap_m, ahead.gap_m),
                )
            )
        )


def deviations_along(
    trajectories: Sequence[Trajectory], parameters: ModelParameters
) -> tuple[Deviations, ...]:
    """Return the deviations of the leader of the first vehicle and of every vehicle.

    Args:
        trajectories: of the vehicles, the first one first; at least one.
        parameters: of every vehicle.
    """
    first = trajectories[0]
    leader = _of_motion(
        first.leader_speed_m_s, np.diff(first.leader_speed_m_s) / np.diff(first.time_s)
    )
    vehicles = (
        Deviations(
            *_of_motion(run.speed_m_s, run.acceleration_m_s2[1:]),
            gap_m=float(np.std(run.gap_m[run.has_leader])),
            smallest_margin_m=float(np.nanmin(gap_margins_m(run, parameters))),
            largest_gap_m=float(np.nanmax(run.gap_m)),
        )
        for run in trajectories
    )
    return (Deviations(*leader), *vehicles)


def _of_motion(
    speeds_m_s: FloatArray, accelerations_m_s2: FloatArray
) -> tuple[float, float, float]:
    return (
        float(np.std(speeds_m_s)),
        float(np.sqrt(np.mean(accelerations_m_s2**2))),
        float(np.max(np.abs(accelerations_m_s2))),
    )
