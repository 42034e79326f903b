"""Degradation rows of the paper's results table."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class DegradationMetrics:
    """Capacity lost during a run, as fractions of nominal capacity.

    Attributes:
        cell_1: increment of Q_loss,1.
        cell_n: increment of Q_loss,Nc.
        inconsistency: increment of Q_loss,Nc - Q_loss,1. The paper prints the difference of the
            losses; as both cells start alike there, that is the same.
    """

    cell_1: float
    cell_n: float
    inconsistency: float

    @property
    def total(self) -> float:
        """Capacity lost by both cells together, the paper's J4."""
        return self.cell_1 + self.cell_n


def degradation_metrics(trajectory: Trajectory) -> DegradationMetrics:
    """Compare the capacity losses at the end of a run with those at its start.

    Args:
        trajectory: the run.

    Returns:
        Its degradation.
    """
    cell_1 = float(trajectory.cell_1_capacity_loss[-1] - trajectory.cell_1_capacity_loss[0])
    cell_n = float(trajectory.cell_n_capacity_loss[-1] - trajectory.cell_n_capacity_loss[0])
    return DegradationMetrics(cell_1=cell_1, cell_n=cell_n, inconsistency=cell_n - cell_1)
