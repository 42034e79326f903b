"""What a run achieved, in physical units: energy, degradation, spacing and temperatures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iptm_core.decision_record import DecisionSeries, DecisionStatistics
from iptm_core.errors import StateError
from iptm_core.metrics.concerns import Concern, longest_times_s
from iptm_core.metrics.constraints import ConstraintCheck, check_constraints, gap_margins_m
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class EnergyMetrics:
    """Energies of a run in joules.

    Attributes:
        cooling_j: integral of abs(P_cp) + P_aux: a heater counts.
        traction_j: integral of P_tra, recuperation counted negative.
        total_printed_j: traction + cooling, which is what the six totals printed in the paper are.
        battery_j: integral of P_b, which is how the paper labels that row.
        peak_battery_power_w: largest P_b of an interval.
        lowest_battery_power_w: smallest P_b of an interval, negative when recuperating.
        mean_cop: heat taken from the coolant per compressor energy over the whole run; None if the
            compressor never ran.
    """

    cooling_j: float
    traction_j: float
    total_printed_j: float
    battery_j: float
    mean_battery_power_w: float
    peak_battery_power_w: float
    lowest_battery_power_w: float
    mean_cop: float | None


@dataclass(frozen=True)
class DegradationMetrics:
    """Capacity lost during a run, as fractions of nominal capacity."""

    cell_1: float
    cell_n: float

    @property
    def inconsistency(self) -> float:
        """Growth of Q_loss,Nc - Q_loss,1; the paper prints this difference, as both cells start alike."""
        return self.cell_n - self.cell_1

    @property
    def total(self) -> float:
        """Capacity lost by both cells together, the paper's J4."""
        return self.cell_1 + self.cell_n


@dataclass(frozen=True)
class GapMetrics:
    """Spacing of a run.

    Attributes:
        smallest_margin_m: smallest distance to the safety limit, min(p_PV - p - s_min); the paper
            prints it as 5.904 m for its proposed strategy.
    """

    smallest_m: float
    mean_m: float
    largest_m: float
    smallest_margin_m: float
    smallest_margin_time_s: float


@dataclass(frozen=True)
class ValueRange:
    """Smallest, time-averaged and largest value of a quantity, in its unit."""

    minimum: float
    mean: float
    maximum: float


@dataclass(frozen=True)
class EndState:
    """The vehicle at the end of a run.

    Attributes:
        kinetic_energy_j: energy of the motion, rotating parts included.
        temperature_k: mean of the first and the last cell.
        cell_1_capacity_loss: of the first cell, as a fraction of nominal.
        state_of_charge: charge left in the pack; NaN where it is not known.
    """

    speed_m_s: float
    kinetic_energy_j: float
    temperature_k: float
    cell_1_capacity_loss: float
    cell_n_capacity_loss: float
    state_of_charge: float = math.nan


@dataclass(frozen=True)
class RunMetrics:
    """What a run achieved.

    Attributes:
        interventions: how often the safety monitor braked.
        longest_s: for how long in a row each concern of an operator lasted at most.
        decisions: how the decisions came about; None where none were taken or recorded.
    """

    duration_s: float
    distance_m: float
    energy: EnergyMetrics
    degradation: DegradationMetrics
    gap: GapMetrics
    cell_1_k: ValueRange
    cell_n_k: ValueRange
    constraints: tuple[ConstraintCheck, ...]
    interventions: int
    service_braking_s: float
    longest_s: Mapping[Concern, float]
    end: EndState
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
    """Work out what a run of two rows or more achieved."""
    run = trajectory
    if len(run) < 2:
        raise StateError(f"run of {len(run)} row; allowed: at least 2 rows")
    braked = run.service_braking_s > 0.0
    return RunMetrics(
        duration_s=_duration_s(run),
        distance_m=float(run.position_m[-1] - run.position_m[0]),
        energy=_energy(run),
        degradation=DegradationMetrics(
            cell_1=float(run.cell_1_capacity_loss[-1] - run.cell_1_capacity_loss[0]),
            cell_n=float(run.cell_n_capacity_loss[-1] - run.cell_n_capacity_loss[0]),
        ),
        gap=_gap(run, parameters),
        cell_1_k=_range(run, run.cell_1_temperature_k),
        cell_n_k=_range(run, run.cell_n_temperature_k),
        constraints=check_constraints(run, parameters),
        interventions=int(np.count_nonzero(braked & ~np.concatenate(([False], braked[:-1])))),
        service_braking_s=float(run.service_braking_s.sum()),
        longest_s=longest_times_s(run, parameters),
        end=_end(run, parameters),
        decisions=None if decisions is None else DecisionStatistics.of(decisions),
    )


def _end(run: Trajectory, parameters: ModelParameters) -> EndState:
    speed_m_s = float(run.speed_m_s[-1])
    mass_kg = parameters.body.rotational_inertia_factor * parameters.body.mass_kg
    return EndState(
        speed_m_s=speed_m_s,
        kinetic_energy_j=0.5 * mass_kg * speed_m_s**2,
        temperature_k=0.5 * float(run.cell_1_temperature_k[-1] + run.cell_n_temperature_k[-1]),
        cell_1_capacity_loss=float(run.cell_1_capacity_loss[-1]),
        cell_n_capacity_loss=float(run.cell_n_capacity_loss[-1]),
        state_of_charge=float(run.state_of_charge[-1]),
    )


def _energy(run: Trajectory) -> EnergyMetrics:
    thermal = _integral(run, np.abs(run.compressor_power_w))
    compressor = _integral(run, np.maximum(run.compressor_power_w, 0.0))
    auxiliary = _integral(run, run.auxiliary_power_w)
    traction = _integral(run, run.traction_power_w)
    battery = _integral(run, run.battery_power_w)
    heat = _integral(run, np.maximum(run.chiller_heat_w, 0.0))
    return EnergyMetrics(
        cooling_j=thermal + auxiliary,
        traction_j=traction,
        total_printed_j=traction + thermal + auxiliary,
        battery_j=battery,
        mean_battery_power_w=battery / _duration_s(run),
        peak_battery_power_w=float(run.battery_power_w[1:].max()),
        lowest_battery_power_w=float(run.battery_power_w[1:].min()),
        mean_cop=heat / compressor if compressor > 0.0 else None,
    )


def _gap(run: Trajectory, parameters: ModelParameters) -> GapMetrics:
    gaps = _range(run, run.gap_m)
    margins = gap_margins_m(run, parameters)
    tightest = int(np.argmin(np.where(np.isnan(margins), np.inf, margins)))
    return GapMetrics(
        smallest_m=gaps.minimum,
        mean_m=gaps.mean,
        largest_m=gaps.maximum,
        smallest_margin_m=float(margins[tightest]),
        smallest_margin_time_s=float(run.time_s[tightest]),
    )


def _duration_s(run: Trajectory) -> float:
    return float(run.time_s[-1] - run.time_s[0])


def _integral(run: Trajectory, means: FloatArray) -> float:
    """Integrate means over the interval that ended at each row; row 0 ends none and does not count."""
    return float(np.dot(means[1:], run.intervals_s))


def _range(run: Trajectory, states: FloatArray) -> ValueRange:
    """Summarise a quantity recorded at the instants, taken as linear between them for its mean.

    Instants at which it is NaN are left out, and so are the intervals that they bound; NaN where all are.
    """
    means = 0.5 * (states[1:] + states[:-1])
    known, intervals_s = np.isfinite(means), run.intervals_s
    if not np.any(np.isfinite(states)):
        return ValueRange(*[math.nan] * 3)
    duration_s = _duration_s(run) if known.all() else float(intervals_s[known].sum())
    integral = np.dot(means[known], intervals_s[known])
    return ValueRange(
        minimum=float(np.nanmin(states)),
        mean=float(integral / duration_s) if duration_s > 0.0 else math.nan,
        maximum=float(np.nanmax(states)),
    )
