"""Which limits of the paper's problem (eq_cons1 to eq_cons8) a run kept.

The bounds and rates of the two inputs are hard: no command may ever break them. Speed, spacing and
temperatures are soft: the controller pays for breaking them but may have to. A collision, which no
soft limit may be traded for, counts as hard.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.metrics.gap import gap_margins_m
from iptm_core.parameters.model import LimitParameters, ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory

ACCELERATION_TOLERANCE_M_S2 = 1e-6
POWER_TOLERANCE_W = 1e-3
SPEED_TOLERANCE_M_S = 1e-3
GAP_TOLERANCE_M = 0.01
TEMPERATURE_TOLERANCE_K = 0.01


@dataclass(frozen=True)
class ConstraintCheck:
    """How well a run kept one limit.

    Attributes:
        key: identifier.
        label: what is limited, for tables.
        unit: unit of ``worst_excess`` and ``tolerance``.
        hard: True if the limit may never be broken.
        violations: number of rows where the excess is larger than ``tolerance``.
        worst_excess: largest amount by which the limit was exceeded, 0 if it never was.
        worst_time_s: when that happened; None if the limit was never exceeded.
        tolerance: excess that does not count as a violation.
    """

    key: str
    label: str
    unit: str
    hard: bool
    violations: int
    worst_excess: float
    worst_time_s: float | None
    tolerance: float


def check_constraints(
    trajectory: Trajectory, parameters: ModelParameters
) -> tuple[ConstraintCheck, ...]:
    """Check every limit on every row of a run.

    Rates are checked from row to row, so that row 0 counts as the input before the run.

    Args:
        trajectory: the run.
        parameters: limits and spacing policy.

    Returns:
        One check per limit, hard ones first.
    """
    return (*_hard(trajectory, parameters.limits), *_soft(trajectory, parameters))


def _hard(run: Trajectory, limits: LimitParameters) -> tuple[ConstraintCheck, ...]:
    acceleration_steps = np.abs(np.diff(run.acceleration_m_s2, prepend=run.acceleration_m_s2[:1]))
    power_steps = np.abs(np.diff(run.compressor_power_w, prepend=run.compressor_power_w[:1]))
    intervals = np.diff(run.time_s, prepend=run.time_s[:1])
    return (
        _check(
            run,
            "acceleration",
            "acceleration",
            "m/s^2",
            _outside(
                run.acceleration_m_s2, limits.min_acceleration_m_s2, limits.max_acceleration_m_s2
            ),
            ACCELERATION_TOLERANCE_M_S2,
            hard=True,
        ),
        _check(
            run,
            "acceleration_step",
            "change of acceleration in one interval",
            "m/s^2",
            acceleration_steps - limits.max_jerk_m_s3 * intervals,
            ACCELERATION_TOLERANCE_M_S2,
            hard=True,
        ),
        _check(
            run,
            "compressor_power",
            "compressor power",
            "W",
            _outside(
                run.compressor_power_w, limits.min_compressor_power_w, limits.max_compressor_power_w
            ),
            POWER_TOLERANCE_W,
            hard=True,
        ),
        _check(
            run,
            "compressor_power_step",
            "change of compressor power in one interval",
            "W",
            power_steps - limits.max_compressor_rate_w_s * intervals,
            POWER_TOLERANCE_W,
            hard=True,
        ),
        _check(run, "collision", "collision", "m", -run.gap_m, 0.0, hard=True),
    )


def _soft(run: Trajectory, parameters: ModelParameters) -> tuple[ConstraintCheck, ...]:
    limits = parameters.limits
    temperatures = {
        "cell_1_temperature": ("temperature of cell 1", run.cell_1_temperature_k),
        "cell_n_temperature": ("temperature of cell N", run.cell_n_temperature_k),
        "coolant_outlet_temperature": (
            "coolant outlet temperature",
            run.coolant_outlet_temperature_k,
        ),
    }
    return (
        _check(
            run,
            "speed",
            "speed",
            "m/s",
            _outside(run.speed_m_s, limits.min_speed_m_s, limits.max_speed_m_s),
            SPEED_TOLERANCE_M_S,
        ),
        _check(
            run,
            "smallest_gap",
            "gap below s_min",
            "m",
            -gap_margins_m(run, parameters),
            GAP_TOLERANCE_M,
        ),
        _check(
            run,
            "largest_gap",
            "gap above s_max",
            "m",
            run.gap_m - parameters.gap.max_gap_m,
            GAP_TOLERANCE_M,
        ),
        *(
            _check(
                run,
                key,
                label,
                "K",
                _outside(values, limits.min_temperature_k, limits.max_temperature_k),
                TEMPERATURE_TOLERANCE_K,
            )
            for key, (label, values) in temperatures.items()
        ),
    )


def _outside(values: FloatArray, lower: float, upper: float) -> FloatArray:
    """Distance to the permitted interval, negative inside."""
    return np.maximum(lower - values, values - upper)


def _check(
    run: Trajectory,
    key: str,
    label: str,
    unit: str,
    excess: FloatArray,
    tolerance: float,
    *,
    hard: bool = False,
) -> ConstraintCheck:
    worst = int(np.argmax(excess))
    exceeded = bool(excess[worst] > 0.0)
    return ConstraintCheck(
        key=key,
        label=label,
        unit=unit,
        hard=hard,
        violations=int(np.count_nonzero(excess > tolerance)),
        worst_excess=float(excess[worst]) if exceeded else 0.0,
        worst_time_s=float(run.time_s[worst]) if exceeded else None,
        tolerance=tolerance,
    )
