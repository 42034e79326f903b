"""Distance to the leader during a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.metrics.time_integrals import mean_of_states
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.gap_policy import minimum_gap_m
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class GapMetrics:
    """Spacing of a run.

    Attributes:
        smallest_m: smallest gap.
        mean_m: mean gap over time.
        largest_m: largest gap.
        smallest_margin_m: smallest distance to the safety limit, min(p_PV - p - s_min); the paper
            prints it as 5.904 m for its proposed strategy.
        smallest_margin_time_s: when that happened.
    """

    smallest_m: float
    mean_m: float
    largest_m: float
    smallest_margin_m: float
    smallest_margin_time_s: float


def gap_margins_m(trajectory: Trajectory, parameters: ModelParameters) -> FloatArray:
    """Distance between the gap and its lower limit s_min at every instant.

    Args:
        trajectory: the run, n rows.
        parameters: spacing policy and acceleration limits.

    Returns:
        Margins in m, shape (n,); negative where the limit is violated.
    """
    smallest = minimum_gap_m(
        trajectory.speed_m_s, trajectory.leader_speed_m_s, parameters.gap, parameters.limits
    )
    margins: FloatArray = trajectory.gap_m - smallest
    return margins


def gap_metrics(trajectory: Trajectory, parameters: ModelParameters) -> GapMetrics:
    """Summarise the spacing of a run.

    Args:
        trajectory: the run.
        parameters: spacing policy and acceleration limits.

    Returns:
        Its spacing.
    """
    gaps = trajectory.gap_m
    margins = gap_margins_m(trajectory, parameters)
    tightest = int(np.argmin(margins))
    return GapMetrics(
        smallest_m=float(np.min(gaps)),
        mean_m=mean_of_states(trajectory, gaps),
        largest_m=float(np.max(gaps)),
        smallest_margin_m=float(margins[tightest]),
        smallest_margin_time_s=float(trajectory.time_s[tightest]),
    )
