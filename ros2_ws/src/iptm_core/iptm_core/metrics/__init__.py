"""What a finished run achieved: energy, degradation, spacing, temperatures and kept limits."""

from iptm_core.metrics.constraints import ConstraintCheck, check_constraints
from iptm_core.metrics.degradation import DegradationMetrics, degradation_metrics
from iptm_core.metrics.energy import EnergyMetrics, energy_metrics
from iptm_core.metrics.gap import GapMetrics, gap_metrics
from iptm_core.metrics.summary import MetricRow, RunMetrics, compute_metrics, metric_rows
from iptm_core.metrics.temperature import TemperatureMetrics, ValueRange, temperature_metrics

__all__ = [
    "ConstraintCheck",
    "DegradationMetrics",
    "EnergyMetrics",
    "GapMetrics",
    "MetricRow",
    "RunMetrics",
    "TemperatureMetrics",
    "ValueRange",
    "check_constraints",
    "compute_metrics",
    "degradation_metrics",
    "energy_metrics",
    "gap_metrics",
    "metric_rows",
    "temperature_metrics",
]
