"""What a run achieved, in physical units."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.decision_record import DecisionSeries, DecisionStatistics
from iptm_core.errors import StateError
from iptm_core.metrics.constraints import ConstraintCheck, check_constraints
from iptm_core.metrics.degradation import DegradationMetrics, degradation_metrics
from iptm_core.metrics.energy import EnergyMetrics, energy_metrics
from iptm_core.metrics.gap import GapMetrics, gap_metrics
from iptm_core.metrics.temperature import TemperatureMetrics, temperature_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class RunMetrics:
    """What a run achieved.

    Attributes:
        duration_s: from the first to the last row.
        distance_m: distance driven by the host.
        energy: energies and mean coefficient of performance.
        degradation: capacity lost by the first and last cell, and its inconsistency.
        gap: spacing.
        temperature: temperatures.
        constraints: one check per limit.
        decisions: how the decisions came about; None where none were taken or recorded.
    """

    duration_s: float
    distance_m: float
    energy: EnergyMetrics
    degradation: DegradationMetrics
    gap: GapMetrics
    temperature: TemperatureMetrics
    constraints: tuple[ConstraintCheck, ...]
    decisions: DecisionStatistics | None = None

    @property
    def hard_violations(self) -> int:
        """Rows that break a hard limit, summed over the limits."""
        return sum(check.violations for check in self.constraints if check.hard)

    @property
    def soft_violations(self) -> int:
        """Rows that break a soft limit, summed over the limits."""
        return sum(check.violations for check in self.constraints if not check.hard)

    @property
    def gap_violations(self) -> int:
        """Rows with a gap below its lower limit, or with a collision."""
        return sum(
            check.violations
            for check in self.constraints
            if check.key in {"smallest_gap", "collision"}
        )


def compute_metrics(
    trajectory: Trajectory,
    parameters: ModelParameters,
    decisions: DecisionSeries | None = None,
) -> RunMetrics:
    """Work out what a run achieved.

    Args:
        trajectory: the run, at least two rows.
        parameters: limits and spacing policy to judge it by.
        decisions: how the decisions came about, where that is known.

    Raises:
        StateError: the run has a single row.
    """
    if len(trajectory) < 2:
        raise StateError(f"run of {len(trajectory)} row; at least 2 are needed for its metrics")
    return RunMetrics(
        duration_s=float(trajectory.time_s[-1] - trajectory.time_s[0]),
        distance_m=float(trajectory.position_m[-1] - trajectory.position_m[0]),
        energy=energy_metrics(trajectory),
        degradation=degradation_metrics(trajectory),
        gap=gap_metrics(trajectory, parameters),
        temperature=temperature_metrics(trajectory),
        constraints=check_constraints(trajectory, parameters),
        decisions=None if decisions is None else DecisionStatistics.of(decisions),
    )
