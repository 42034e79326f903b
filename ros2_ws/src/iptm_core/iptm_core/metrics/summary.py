"""All figures of a run, and as rows of a table."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.errors import StateError
from iptm_core.metrics.constraints import ConstraintCheck, check_constraints
from iptm_core.metrics.degradation import DegradationMetrics, degradation_metrics
from iptm_core.metrics.energy import EnergyMetrics, energy_metrics
from iptm_core.metrics.gap import GapMetrics, gap_metrics
from iptm_core.metrics.temperature import TemperatureMetrics, temperature_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.parameters.units import CELSIUS_ZERO_K
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
    """

    duration_s: float
    distance_m: float
    energy: EnergyMetrics
    degradation: DegradationMetrics
    gap: GapMetrics
    temperature: TemperatureMetrics
    constraints: tuple[ConstraintCheck, ...]

    @property
    def hard_violations(self) -> int:
        """Rows that break a hard limit, summed over the limits."""
        return sum(check.violations for check in self.constraints if check.hard)

    @property
    def soft_violations(self) -> int:
        """Rows that break a soft limit, summed over the limits."""
        return sum(check.violations for check in self.constraints if not check.hard)


@dataclass(frozen=True)
class MetricRow:
    """One row of a results table.

    Attributes:
        key: identifier, equal for the same row of every run.
        label: text of the row.
        value: the figure in ``unit``; None where it does not exist.
        unit: its unit.
        relative_change: value / reference - 1 for the rows the paper compares that way; None
            for other rows, without a reference run, or where the reference is 0.
    """

    key: str
    label: str
    value: float | None
    unit: str
    relative_change: float | None = None


def compute_metrics(trajectory: Trajectory, parameters: ModelParameters) -> RunMetrics:
    """Work out all figures of a run.

    Args:
        trajectory: the run, at least two rows.
        parameters: limits and spacing policy to judge it by.

    Returns:
        The figures.

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
    )


def metric_rows(metrics: RunMetrics, reference: RunMetrics | None = None) -> tuple[MetricRow, ...]:
    """Lay the figures out as a table: the paper's rows first, in its units and order.

    Args:
        metrics: figures of the run.
        reference: figures of the run to compare with.

    Returns:
        The rows; their keys and order do not depend on the run.
    """
    compared = _compared_rows(metrics)
    if reference is not None:
        compared = tuple(
            MetricRow(row.key, row.label, row.value, row.unit, _change(row.value, base.value))
            for row, base in zip(compared, _compared_rows(reference), strict=True)
        )
    return (*compared, *_other_rows(metrics))


def _change(value: float | None, base: float | None) -> float | None:
    if value is None or base is None or base == 0.0:
        return None
    return value / base - 1.0


def _compared_rows(metrics: RunMetrics) -> tuple[MetricRow, ...]:
    energy, loss = metrics.energy, metrics.degradation
    return (
        MetricRow("cooling_energy", "Cooling energy", 1e-3 * energy.cooling_j, "kJ"),
        MetricRow("traction_energy", "Traction energy", 1e-3 * energy.traction_j, "kJ"),
        MetricRow(
            "total_energy_printed",
            "Total energy (traction + cooling, as printed)",
            1e-3 * energy.total_printed_j,
            "kJ",
        ),
        MetricRow("battery_energy", "Battery energy", 1e-3 * energy.battery_j, "kJ"),
        MetricRow("cell_1_degradation", "Cell 1 degradation", 1e5 * loss.cell_1, "1e-5"),
        MetricRow("cell_n_degradation", "Cell N degradation", 1e5 * loss.cell_n, "1e-5"),
        MetricRow("inconsistency", "Degradation inconsistency", 1e7 * loss.inconsistency, "1e-7"),
    )


def _other_rows(metrics: RunMetrics) -> tuple[MetricRow, ...]:
    gap, heat = metrics.gap, metrics.temperature
    cells = (("1", heat.cell_1_k), ("N", heat.cell_n_k))
    return (
        MetricRow("mean_cop", "Mean coefficient of performance", metrics.energy.mean_cop, "1"),
        MetricRow("smallest_gap", "Smallest gap", gap.smallest_m, "m"),
        MetricRow("mean_gap", "Mean gap", gap.mean_m, "m"),
        MetricRow("largest_gap", "Largest gap", gap.largest_m, "m"),
        MetricRow("smallest_margin", "Smallest margin to s_min", gap.smallest_margin_m, "m"),
        *(
            MetricRow(
                f"cell_{cell.lower()}_temperature_{which}",
                f"Cell {cell} temperature, {which}",
                value - CELSIUS_ZERO_K,
                "degC",
            )
            for cell, span in cells
            for which, value in (
                ("min", span.minimum),
                ("mean", span.mean),
                ("max", span.maximum),
            )
        ),
        MetricRow("hard_violations", "Hard limits broken", float(metrics.hard_violations), "rows"),
        MetricRow("soft_violations", "Soft limits broken", float(metrics.soft_violations), "rows"),
        MetricRow("distance", "Distance", 1e-3 * metrics.distance_m, "km"),
        MetricRow("duration", "Duration", metrics.duration_s, "s"),
    )
