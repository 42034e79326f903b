"""Metrics of a run in physical units, and the definition, computation and format of its figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from iptm_core.aging_laws.judging import Exposure, losses_of_cells
from iptm_core.decision_record import DecisionSeries, DecisionStatistics
from iptm_core.declaration import TextEnum
from iptm_core.errors import StateError
from iptm_core.metrics.constraints import (
    Concern,
    ConstraintCheck,
    check_constraints,
    gap_margins_m,
    longest_times_s,
)
from iptm_core.metrics.following import Following
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class RunMetrics:
    """What a run achieved; unknown figures are NaN.

    Attributes:
        cooling_energy_j: integral of abs(P_cp) + P_aux: a heater counts.
        traction_energy_j: integral of P_tra, recuperation counted negative.
        total_printed_energy_j: traction + cooling, which is what the six totals printed in the paper are.
        battery_energy_j: integral of P_b, the power at the terminals.
        cell_heat_j: heat of the cells, ohmic and entropic; with that of P_b, current times open-circuit
            voltage.
        peak_battery_power_w: largest P_b of an interval.
        lowest_battery_power_w: smallest P_b of an interval, negative when recuperating.
        unbalanced_heat_j: heat made in the cells and taken from the air, less heat taken by the chiller and
            stored at the mean of both cells. Two cells in the place of a channel do not keep it at zero.
        chiller_heat_j: heat taken from the coolant.
        mean_cop: heat taken from the coolant per compressor energy over the whole run; None if the
            compressor never ran.
        cell_1_degradation: capacity lost by cell 1 during the run, as a fraction of nominal capacity.
        cell_n_degradation: the same of cell N.
        smallest_margin_m: smallest distance to the safety limit, min(p_PV - p - s_min); the paper
            prints it as 5.904 m for its proposed strategy.
        cell_1_k: lowest, mean and highest temperature of cell 1.
        cell_n_k: the same of cell N.
        interventions: how often the safety monitor braked.
        longest_s: for how long in a row each concern of an operator lasted at most.
        final_kinetic_energy_j: energy of the motion at the end, rotating parts included.
        final_temperature_k: mean of the first and the last cell at the end.
        final_cell_losses: capacity losses of the first and the last cell at the end, as fractions of nominal.
        final_charge: state of charge at the end.
        following: headway, and time and distance below s_min.
        cell_losses: capacity that the laws of measured cells lose by the trip and its charging, by name, see
            `iptm_core.aging_laws.judging`; empty where current or temperature is not known throughout.
        decisions: how the decisions came about; None where none were taken or recorded.
    """

    duration_s: float
    distance_m: float
    cooling_energy_j: float
    traction_energy_j: float
    total_printed_energy_j: float
    battery_energy_j: float
    mean_battery_power_w: float
    peak_battery_power_w: float
    lowest_battery_power_w: float
    unbalanced_heat_j: float
    mean_cop: float | None
    cell_1_degradation: float
    cell_n_degradation: float
    smallest_gap_m: float
    mean_gap_m: float
    largest_gap_m: float
    smallest_margin_m: float
    smallest_margin_time_s: float
    cell_1_k: tuple[float, float, float]
    cell_n_k: tuple[float, float, float]
    constraints: tuple[ConstraintCheck, ...]
    interventions: int
    service_braking_s: float
    longest_s: Mapping[Concern, float]
    final_speed_m_s: float
    final_kinetic_energy_j: float
    final_temperature_k: float
    final_cell_losses: tuple[float, float]
    final_charge: float
    chiller_heat_j: float = math.nan
    cell_heat_j: float = math.nan
    following: Following = field(default_factory=Following)
    cell_losses: Mapping[str, float] = field(default_factory=dict)
    decisions: DecisionStatistics | None = None

    @property
    def inconsistency(self) -> float:
        """Growth of Q_loss,Nc - Q_loss,1; the paper prints this difference, as both cells start alike."""
        return self.cell_n_degradation - self.cell_1_degradation

    @property
    def degradation(self) -> float:
        """Capacity lost by both cells together, the paper's J4."""
        return self.cell_1_degradation + self.cell_n_degradation

    @property
    def unbalanced_heat_share(self) -> float:
        """Heat that the two cells leave unbalanced, over the heat taken by the chiller; NaN without any."""
        return self.unbalanced_heat_j / self.chiller_heat_j if self.chiller_heat_j else math.nan

    @property
    def hard_violations(self) -> int:
        """Rows that break a hard limit, summed over the limits."""
        return sum(check.violations for check in self.constraints if check.hard)

    @property
    def soft_violations(self) -> int:
        """Rows that break a soft limit, summed over the limits."""
        return sum(check.violations for check in self.constraints if not check.hard)

    @property
    def broken_limits(self) -> tuple[ConstraintCheck, ...]:
        """Limits that were broken by more than their tolerance, hard ones first."""
        return tuple(check for check in self.constraints if check.violations)

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
    """Work out what a run of two rows or more achieved."""
    run = trajectory
    if len(run) < 2:
        raise StateError(f"run of {len(run)} row; allowed: at least 2 rows")
    thermal_j = _integral(run, np.abs(run.compressor_power_w))
    compressor_j = _integral(run, np.maximum(run.compressor_power_w, 0.0))
    auxiliary_j = _integral(run, run.auxiliary_power_w)
    traction_j = _integral(run, run.traction_power_w)
    battery_j = _integral(run, run.battery_power_w)
    heat_j = _integral(run, np.maximum(run.chiller_heat_w, 0.0))
    duration_s = float(run.time_s[-1] - run.time_s[0])
    smallest_m, mean_m, largest_m = _range(run, run.gap_m)
    margins = gap_margins_m(run, parameters)
    tightest = int(np.argmin(np.where(np.isnan(margins), np.inf, margins)))
    losses = run.cell_1_capacity_loss, run.cell_n_capacity_loss
    braked = run.service_braking_s > 0.0
    speed_m_s = float(run.speed_m_s[-1])
    mass_kg = parameters.body.rotational_inertia_factor * parameters.body.mass_kg
    return RunMetrics(
        duration_s=duration_s,
        distance_m=float(run.position_m[-1] - run.position_m[0]),
        cooling_energy_j=thermal_j + auxiliary_j,
        traction_energy_j=traction_j,
        total_printed_energy_j=traction_j + thermal_j + auxiliary_j,
        battery_energy_j=battery_j,
        mean_battery_power_w=battery_j / duration_s,
        peak_battery_power_w=float(run.battery_power_w[1:].max()),
        lowest_battery_power_w=float(run.battery_power_w[1:].min()),
        unbalanced_heat_j=_unbalanced_heat_j(run, parameters),
        mean_cop=heat_j / compressor_j if compressor_j > 0.0 else None,
        cell_1_degradation=float(losses[0][-1] - losses[0][0]),
        cell_n_degradation=float(losses[1][-1] - losses[1][0]),
        smallest_gap_m=smallest_m,
        mean_gap_m=mean_m,
        largest_gap_m=largest_m,
        smallest_margin_m=float(margins[tightest]),
        smallest_margin_time_s=float(run.time_s[tightest]),
        cell_1_k=_range(run, run.cell_1_temperature_k),
        cell_n_k=_range(run, run.cell_n_temperature_k),
        constraints=check_constraints(run, parameters),
        interventions=int(np.count_nonzero(braked & ~np.concatenate(([False], braked[:-1])))),
        service_braking_s=float(run.service_braking_s.sum()),
        longest_s=longest_times_s(run, parameters),
        final_speed_m_s=speed_m_s,
        final_kinetic_energy_j=0.5 * mass_kg * speed_m_s**2,
        final_temperature_k=0.5
        * float(run.cell_1_temperature_k[-1] + run.cell_n_temperature_k[-1]),
        final_cell_losses=(float(losses[0][-1]), float(losses[1][-1])),
        final_charge=float(run.state_of_charge[-1]),
        chiller_heat_j=heat_j,
        cell_heat_j=_integral(run, run.battery_heat_w),
        following=Following.of(run.time_s, run.speed_m_s, run.gap_m, margins),
        cell_losses=_cell_losses(run),
        decisions=None if decisions is None else DecisionStatistics.of(decisions, run),
    )


def _cell_losses(run: Trajectory) -> Mapping[str, float]:
    try:
        return losses_of_cells(Exposure.of(run))
    except StateError:
        return {}


def _unbalanced_heat_j(run: Trajectory, parameters: ModelParameters) -> float:
    mean_k = 0.5 * (run.cell_1_temperature_k + run.cell_n_temperature_k)
    stored_j = parameters.pack_heat_capacity_j_k * float(mean_k[-1] - mean_k[0])
    warmer_k = parameters.environment.ambient_temperature_k - 0.5 * (mean_k[1:] + mean_k[:-1])
    from_air_j = parameters.cooling.air_exchange_w_k * float(np.dot(warmer_k, run.intervals_s))
    return _integral(run, run.battery_heat_w - run.chiller_heat_w) + from_air_j - stored_j


def _integral(run: Trajectory, means: FloatArray) -> float:
    """Integrate means over the interval that ended at each row; row 0 ends none and does not count."""
    return float(np.dot(means[1:], run.intervals_s))


def _range(run: Trajectory, states: FloatArray) -> tuple[float, float, float]:
    """Return lowest, mean and highest value of a quantity, taken as linear between the instants.

    Instants at which it is NaN are left out, and so are the intervals that they bound; NaN where all are.
    """
    means = 0.5 * (states[1:] + states[:-1])
    known, intervals_s = np.isfinite(means), run.intervals_s
    if not np.any(np.isfinite(states)):
        return math.nan, math.nan, math.nan
    whole_s = float(run.time_s[-1] - run.time_s[0])
    duration_s = whole_s if known.all() else float(intervals_s[known].sum())
    integral = np.dot(means[known], intervals_s[known])
    mean = float(integral / duration_s) if duration_s > 0.0 else math.nan
    return float(np.nanmin(states)), mean, float(np.nanmax(states))


NO_VALUE = "–"


class Better(TextEnum):
    """Which way a figure should go."""

    MORE = "more"
    LESS = "less"
    NEITHER = "-"


@dataclass(frozen=True)
class Figure:
    """One figure of a run.

    Attributes:
        key: identifier, in files and on command lines.
        unit: unit of the value, empty for a pure number.
        decimals: digits after the point that are worth printing; a value below two more prints as 0.
        definition: what it is, in one sentence.
        compute: the value from the metrics of a run; None where it does not exist.
        symbol: symbol of the paper, empty where it has none.
        compared: whether its change relative to a reference run is meaningful.
        better: which way it should go.
    """

    key: str
    label: str
    unit: str
    decimals: int
    definition: str
    compute: Callable[[RunMetrics], float | None]
    symbol: str = ""
    compared: bool = False
    better: Better = Better.NEITHER

    @property
    def title(self) -> str:
        """Label with unit, for column heads and axes."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def about(self) -> str:
        """The definition, and which way the figure should go."""
        return self.definition + (
            "" if self.better is Better.NEITHER else f" {self.better.capitalize()} is better."
        )

    def precise_text(self, value: float | None) -> str:
        """Print a value without its unit, with three significant digits."""
        if value is None or not math.isfinite(value):
            return NO_VALUE
        if self.decimals == 0:
            return f"{value:.0f}"
        return significant(value, 10.0 ** -(self.decimals + 2))


def significant(value: float, least: float = 0.0) -> str:
    """Print a value with three significant digits, all before the point, and 0 where it is below `least`."""
    if not math.isfinite(value):
        return NO_VALUE
    if value == 0.0 or abs(value) < least:
        return "0"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:#.3g}".rstrip(".")
