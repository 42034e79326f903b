"""Which limits of the paper's problem (eq_cons1 to eq_cons8) a run kept.

The bounds and rates of the two inputs are hard: no command may ever break them. Speed, spacing and
temperatures are soft: the controller pays for breaking them but may have to. A collision, which no
soft limit may be traded for, is a hard violation, and so is a charge that no pack can hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import maximum_gap_m, minimum_gap_m
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory

ACCELERATION_TOLERANCE_M_S2 = 1e-6
POWER_TOLERANCE_W = 1e-3
SPEED_TOLERANCE_M_S = 1e-3
GAP_TOLERANCE_M = 0.01
TEMPERATURE_TOLERANCE_K = 0.01
CHARGE_TOLERANCE = 1e-6

_Row = tuple[str, str, str, FloatArray, float]
"""One limit: key, label, unit, excess at every instant (negative inside the limit), tolerance."""


@dataclass(frozen=True)
class ConstraintCheck:
    """How well a run kept one limit.

    Attributes:
        unit: unit of ``worst_excess`` and ``tolerance``.
        violations: number of rows where the excess is larger than ``tolerance``.
        worst_excess: largest amount by which the limit was exceeded, 0 if it never was.
        worst_time_s: when that happened; None if the limit was never exceeded.
        first_time_s: when it was first exceeded by more than ``tolerance``; None if it never was.
    """

    key: str
    label: str
    unit: str
    hard: bool
    violations: int
    worst_excess: float
    worst_time_s: float | None
    tolerance: float
    first_time_s: float | None = None

    @property
    def text(self) -> str:
        """One line about a broken limit: which, how far, how often and when first."""
        kind = "hard" if self.hard else "soft"
        plural = "" if self.violations == 1 else "s"
        amount = (
            ""
            if self.worst_time_s is None
            else (f", worst by {self.worst_excess:.3g} {self.unit} at {self.worst_time_s:g} s")
        )
        since = "" if self.first_time_s is None else f", first at {self.first_time_s:g} s"
        return f"{self.label} ({kind} limit): {self.violations} tick{plural}{since}{amount}"


def check_constraints(
    trajectory: Trajectory, parameters: ModelParameters
) -> tuple[ConstraintCheck, ...]:
    """Check every limit on every row of a run.

    Rates are checked from row to row, so that row 0 serves as the input before the run. Where a vehicle comes
    to rest its deceleration ends with the motion, and where it meets its top speed its acceleration: no
    command does that, and it breaks no limit. Service braking keeps to the brakes of the vehicle, not to the
    limits of comfort. Collisions are looked for inside the intervals as well.

    Returns:
        One check per limit, hard ones first; none of what is not known in any row.
    """
    limits, gap = parameters.limits, parameters.gap
    run = trajectory
    intervals = np.diff(run.time_s, prepend=run.time_s[:1])
    braked = run.service_braking_s > 0.0
    hardest = np.where(
        braked, -parameters.brakes.max_deceleration_m_s2, limits.min_acceleration_m_s2
    )
    acceleration = _outside(run.acceleration_m_s2, hardest, limits.max_acceleration_m_s2)
    jerk = _steps(run.acceleration_m_s2) - limits.max_jerk_m_s3 * intervals
    free = _speed_ends_acceleration(run, limits.max_speed_m_s)
    free |= braked | np.concatenate(([False], braked[:-1]))
    jerk = np.where(free, -limits.max_jerk_m_s3 * intervals, jerk)
    compressor = _outside(
        run.compressor_power_w, limits.lowest_thermal_power_w, limits.max_compressor_power_w
    )
    ramp = _steps(run.compressor_power_w) - limits.max_compressor_rate_w_s * intervals
    speed = _outside(run.speed_m_s, limits.min_speed_m_s, limits.max_speed_m_s)
    cell_1, cell_n, outlet = (
        _outside(values, limits.min_temperature_k, limits.max_temperature_k)
        for values in (
            run.cell_1_temperature_k,
            run.cell_n_temperature_k,
            run.coolant_outlet_temperature_k,
        )
    )
    largest_m = maximum_gap_m(run.speed_m_s, gap)
    impossible = _outside(run.state_of_charge, 0.0, 1.0)
    low_charge = parameters.charge.min_charge - run.state_of_charge
    m_s2, watt, kelvin = ACCELERATION_TOLERANCE_M_S2, POWER_TOLERANCE_W, TEMPERATURE_TOLERANCE_K
    # fmt: off
    hard: tuple[_Row, ...] = (
        ("acceleration", "acceleration", "m/s^2", acceleration, m_s2),
        ("acceleration_step", "change of acceleration in one interval", "m/s^2", jerk, m_s2),
        ("compressor_power", "compressor power", "W", compressor, watt),
        ("compressor_power_step", "change of compressor power in one interval", "W", ramp, watt),
        ("collision", "collision", "m", -run.closest_m, 0.0),
        ("charge", "charge outside of 0 to 100 %", "1", impossible, CHARGE_TOLERANCE),
    )
    soft: tuple[_Row, ...] = (
        ("speed", "speed", "m/s", speed, SPEED_TOLERANCE_M_S),
        ("smallest_gap", "gap below s_min", "m", -gap_margins_m(run, parameters), GAP_TOLERANCE_M),
        ("largest_gap", "gap above s_max", "m", run.gap_m - largest_m, GAP_TOLERANCE_M),
        ("cell_1_temperature", "temperature of cell 1", "K", cell_1, kelvin),
        ("cell_n_temperature", "temperature of cell N", "K", cell_n, kelvin),
        ("coolant_outlet_temperature", "coolant outlet temperature", "K", outlet, kelvin),
        ("state_of_charge", "state of charge below soc_min", "1", low_charge, CHARGE_TOLERANCE),
    )
    # fmt: on
    rows = [*((row, True) for row in hard), *((row, False) for row in soft)]
    return tuple(
        _check(run, row, hard=is_hard) for row, is_hard in rows if not np.all(np.isnan(row[3]))
    )


def gap_margins_m(trajectory: Trajectory, parameters: ModelParameters) -> FloatArray:
    """Return gap less s_min at every instant, shape (n,); negative where violated, NaN without a leader."""
    smallest = minimum_gap_m(
        trajectory.speed_m_s, trajectory.leader_speed_m_s, parameters.gap, parameters.limits
    )
    margins: FloatArray = trajectory.gap_m - smallest
    return margins


def cold_compressor_energies_j(trajectory: Trajectory, parameters: ModelParameters) -> FloatArray:
    """Return what the compressor took in intervals begun with both cells below T_b,min, J, shape (n,)."""
    warmest_k = np.maximum(trajectory.cell_1_temperature_k, trajectory.cell_n_temperature_k)
    energies: FloatArray = np.zeros(warmest_k.size)
    cold = warmest_k[:-1] < parameters.limits.min_temperature_k
    compressor_w = np.maximum(trajectory.compressor_power_w[1:], 0.0)
    energies[1:] = compressor_w * trajectory.intervals_s * cold
    return energies


def _steps(values: FloatArray) -> FloatArray:
    """Return the magnitude of the change from the row before, shape (n,), 0 in row 0."""
    steps: FloatArray = np.abs(np.diff(values, prepend=values[:1]))
    return steps


def _speed_ends_acceleration(run: Trajectory, top_speed_m_s: float) -> NDArray[np.bool_]:
    """Return the rows in which braking ended at standstill or speeding up at the top speed, shape (n,)."""
    before = np.concatenate(([0.0], run.acceleration_m_s2[:-1]))
    halts = (before < 0.0) & (run.speed_m_s == 0.0)
    tops = (before > 0.0) & (run.speed_m_s == top_speed_m_s)
    ends: NDArray[np.bool_] = (halts | tops) & (run.acceleration_m_s2 == 0.0)
    return ends


def _outside(values: FloatArray, lower: float | FloatArray, upper: float) -> FloatArray:
    """Return the distance to the permitted interval, negative inside."""
    return np.maximum(lower - values, values - upper)


def _check(run: Trajectory, row: _Row, *, hard: bool) -> ConstraintCheck:
    key, label, unit, excess, tolerance = row
    worst = int(np.nanargmax(excess))
    exceeded = bool(excess[worst] > 0.0)
    beyond = np.flatnonzero(excess > tolerance)
    return ConstraintCheck(
        key=key,
        label=label,
        unit=unit,
        hard=hard,
        violations=int(beyond.size),
        worst_excess=float(excess[worst]) if exceeded else 0.0,
        worst_time_s=float(run.time_s[worst]) if exceeded else None,
        tolerance=tolerance,
        first_time_s=float(run.time_s[beyond[0]]) if beyond.size else None,
    )
