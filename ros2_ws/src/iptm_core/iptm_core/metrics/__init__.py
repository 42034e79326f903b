"""What a finished run achieved: energy, degradation, spacing, temperatures and kept limits."""

from iptm_core.metrics.constraints import ConstraintCheck, check_constraints
from iptm_core.metrics.degradation import DegradationMetrics, degradation_metrics
from iptm_core.metrics.energy import EnergyMetrics, energy_metrics
from iptm_core.metrics.figures import FIGURES, PAPER_TABLE, TRIP_FIGURES, Figure, figure_values
from iptm_core.metrics.gap import GapMetrics, gap_metrics
from iptm_core.metrics.summary import RunMetrics, compute_metrics
from iptm_core.metrics.temperature import TemperatureMetrics, ValueRange, temperature_metrics

__all__ = [
    "FIGURES",
    "PAPER_TABLE",
    "TRIP_FIGURES",
    "ConstraintCheck",
    "DegradationMetrics",
    "EnergyMetrics",
    "Figure",
    "GapMetrics",
    "RunMetrics",
    "TemperatureMetrics",
    "ValueRange",
    "check_constraints",
    "compute_metrics",
    "degradation_metrics",
    "energy_metrics",
    "figure_values",
    "gap_metrics",
    "temperature_metrics",
]
