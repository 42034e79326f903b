"""What a finished run achieved: energy, degradation, spacing, temperatures and kept limits."""

from iptm_core.metrics.concerns import Concern
from iptm_core.metrics.constraints import (
    ConstraintCheck,
    check_constraints,
    cold_compressor_energies_j,
    gap_margins_m,
)
from iptm_core.metrics.equal_end import CorrectedFigures, TripEnd, at_equal_end
from iptm_core.metrics.figure import Better, Figure
from iptm_core.metrics.figures import FIGURES, PAPER_TABLE, SAVINGS, figure_values
from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics
from iptm_core.metrics.saving import Judgement, SavedShare, Saving, judge_saving
from iptm_core.metrics.trip_figures import TRIP_FIGURES

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
