"""What a finished run achieved: energy, degradation, spacing, temperatures and kept limits."""

from iptm_core.metrics.concerns import Concern
from iptm_core.metrics.constraints import (
    ConstraintCheck,
    check_constraints,
    cold_compressor_energies_j,
    gap_margins_m,
)
from iptm_core.metrics.equal_end import CorrectedFigures, at_equal_end
from iptm_core.metrics.figures import FIGURES, PAPER_TABLE, TRIP_FIGURES, Figure, figure_values
from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics

__all__ = [
    "FIGURES",
    "PAPER_TABLE",
    "TRIP_FIGURES",
    "Concern",
    "ConstraintCheck",
    "CorrectedFigures",
    "Figure",
    "RunMetrics",
    "at_equal_end",
    "check_constraints",
    "cold_compressor_energies_j",
    "compute_metrics",
    "figure_values",
    "gap_margins_m",
]
