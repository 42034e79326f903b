"""What a finished run achieved: energy, degradation, spacing, temperatures and kept limits."""

from iptm_core.metrics.constraints import (
    Concern,
    ConstraintCheck,
    check_constraints,
    cold_compressor_energies_j,
    gap_margins_m,
)
from iptm_core.metrics.figures import FIGURES, PAPER_TABLE, SAVINGS, TRIP_FIGURES, figure_values
from iptm_core.metrics.run_metrics import Better, Figure, RunMetrics, compute_metrics
from iptm_core.metrics.saving import (
    CorrectedFigures,
    Judgement,
    SavedShare,
    Saving,
    TripEnd,
    at_equal_end,
    judge_saving,
)

__all__ = [
    "FIGURES",
    "PAPER_TABLE",
    "SAVINGS",
    "TRIP_FIGURES",
    "Better",
    "Concern",
    "ConstraintCheck",
    "CorrectedFigures",
    "Figure",
    "Judgement",
    "RunMetrics",
    "SavedShare",
    "Saving",
    "TripEnd",
    "at_equal_end",
    "check_constraints",
    "cold_compressor_energies_j",
    "compute_metrics",
    "figure_values",
    "gap_margins_m",
    "judge_saving",
]
