"""One thermal step: cell temperatures and compressor power at predicted traction powers.

Beyond some tens of seconds only the load on the pack matters, not the motion of the car: the traction
power is a parameter of the step, given as a few levels that each hold for an equal share of it. Powers
and aging rates are averaged over the levels and not computed from a mean, because both are convex in the
current. Position and speed go on at constant speed, so that all stages of a horizon are alike; nothing
depends on them, and the rows that limit the motion are constants.
"""

from __future__ import annotations

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import (
    GlobalIndex,
    InputIndex,
    LimitIndex,
    StateIndex,
    ThermalSampleIndex,
)
from iptm_controller.ocp.stage import (
    DEFAULT_PENALTIES,
    DEFAULT_SMOOTHING,
    INACTIVE_ROW_M,
    PenaltyWeights,
    StageExpressions,
    StageSymbols,
    charge_limit_w,
    compressor_rate_row,
    cost_rate,
    temperature_rows,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.power_thermal import (
    CellPair,
    PowerThermalRates,
    Smoothing,
    rates_at_traction_power,
)
from iptm_core.physics.thermal_loop import reduce_channel


def build_thermal_stage(
    step_s: float,
    levels: int,
    parameters: ModelParameters,
    smoothing: Smoothing = DEFAULT_SMOOTHING,
    penalties: PenaltyWeights = DEFAULT_PENALTIES,
) -> StageExpressions:
    """Write down a thermal step: the explicit midpoint rule on the rates averaged over the levels.

    Args:
        levels: number of traction powers.
    """
    symbols = StageSymbols.of(levels)
    state, inputs, g = symbols.state, symbols.inputs, symbols.g
    channel = reduce_channel(parameters.cooling, parameters.pack)
    power = inputs[InputIndex.COMPRESSOR_POWER]
    start_1 = state[StateIndex.CELL_1_TEMPERATURE]
    start_n = state[StateIndex.CELL_N_TEMPERATURE]
    samples = ca.reshape(symbols.p[layout.STEP_PARAMETERS :], layout.SAMPLE_PARAMETERS, levels)
    traction = samples[ThermalSampleIndex.TRACTION_POWER, :]
    speed = ca.sum2(samples[ThermalSampleIndex.SPEED, :]) / levels

    def rates(traction_w: ca.SX, cell_1_k: ca.SX, cell_n_k: ca.SX) -> PowerThermalRates:
        losses = g[GlobalIndex.CELL_1_LOSS], g[GlobalIndex.CELL_N_LOSS]
        cells = CellPair(cell_1_k, cell_n_k, *losses)
        limit_w = charge_limit_w(parameters, g)
        return rates_at_traction_power(
            traction_w, speed, power, cells, parameters, channel, smoothing, limit_w
        )

    first = rates(ca.sum2(traction) / levels, start_1, start_n)
    middle_1 = start_1 + 0.5 * step_s * first.cell_1_temperature_rate_k_s
    middle_n = start_n + 0.5 * step_s * first.cell_n_temperature_rate_k_s
    each = [rates(traction[level], middle_1, middle_n) for level in range(levels)]
    share_s = step_s / levels
    no_error = ca.SX(0.0)  # of the speed: the motion is not optimised
    cost = share_s * sum(cost_rate(one, no_error, middle_1, middle_n, g) for one in each)
    # The motion has no meaning here: its input is held at zero.
    cost += 0.5 * step_s * symbols.u[InputIndex.ACCELERATION] ** 2
    acceleration = inputs[InputIndex.ACCELERATION]
    next_state = {
        StateIndex.POSITION: state[StateIndex.POSITION] + step_s * state[StateIndex.SPEED],
        StateIndex.SPEED: state[StateIndex.SPEED],
        StateIndex.CELL_1_TEMPERATURE: start_1
        + share_s * sum(one.cell_1_temperature_rate_k_s for one in each),
        StateIndex.CELL_N_TEMPERATURE: start_n
        + share_s * sum(one.cell_n_temperature_rate_k_s for one in each),
        StateIndex.LAST_ACCELERATION: acceleration,
        StateIndex.LAST_COMPRESSOR_POWER: power,
    }
    bounds = parameters.limits
    gap_rows = (LimitIndex.GAP_MIN, LimitIndex.GAP_FLOOR, LimitIndex.GAP_BRAKING)
    speed_rows = (LimitIndex.SPEED_MIN, LimitIndex.SPEED_MAX)
    limits = {
        LimitIndex.ACCELERATION_RATE: acceleration,
        LimitIndex.COMPRESSOR_RATE: compressor_rate_row(symbols, bounds),
        **dict.fromkeys(gap_rows, INACTIVE_ROW_M + inputs[InputIndex.GAP_SHORT]),
        LimitIndex.GAP_MAX: INACTIVE_ROW_M + inputs[InputIndex.GAP_LONG],
        **dict.fromkeys(speed_rows, INACTIVE_ROW_M + inputs[InputIndex.SPEED_EXCESS]),
        **temperature_rows(next_state, each[-1].coolant.outlet_k, inputs, bounds),
    }
    return symbols.stage(step_s, cost, next_state, limits, parameters, smoothing, penalties)
