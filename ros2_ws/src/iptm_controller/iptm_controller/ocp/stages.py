"""One step of the horizon as a function: a motion step of any length, or a thermal step.

Inside a motion step the acceleration and the compressor power are constant, so position and speed are exact.
Powers, heat and ageing are integrated by Gauss-Legendre quadrature over the moving speed and slope: one
sample (the midpoint) for steps up to 1 s, more for long ones. That keeps a 5 s step as accurate as five 1 s
steps at less than half of their cost. In steps beyond ``LONGEST_STEP_WITHOUT_SAMPLED_GAP_S`` the gap is also
constrained at the samples: a leader can stop and drive off again within them.

Beyond some tens of seconds only the load on the pack matters, not the motion of the car: the traction power
is a parameter of a thermal step, given as a few levels that each hold for an equal share of it. Powers and
aging rates are averaged over the levels and not computed from a mean, because both are convex in the
current. Position and speed go on at constant speed, so that all stages of a horizon are alike; nothing
depends on them, and the rows that limit the motion are constants.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import quadrature
from iptm_controller.ocp.layout import (
    GlobalIndex,
    InputIndex,
    LimitIndex,
    SampleIndex,
    StateIndex,
    StepIndex,
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
from iptm_core.declaration import has_effect
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import (
    braking_reserve_m,
    desired_gap_m,
    emergency_reserve_m,
    maximum_gap_m,
    minimum_gap_m,
)
from iptm_core.physics.model_numbers import SymbolicModel
from iptm_core.physics.ops import maximum
from iptm_core.physics.power_thermal import (
    CellPair,
    PowerThermalRates,
    Smoothing,
    power_thermal_rates,
    rates_at_traction_power,
)
from iptm_core.physics.powertrain import advance_position_m, advance_speed_m_s

LONGEST_STEP_WITHOUT_SAMPLED_GAP_S = 2.5
GAP_SMOOTHING_M = 0.3
NEARLY_DESIRED_M = 20.0
"""Deviation from the desired gap up to which its cost is quadratic; beyond it grows linearly, so that a
distant lead vehicle is caught up with without haste."""


def build_stage(
    step_s: float,
    samples: int,
    model: SymbolicModel,
    smoothing: Smoothing = DEFAULT_SMOOTHING,
    penalties: PenaltyWeights = DEFAULT_PENALTIES,
) -> StageExpressions:
    """Write down one step of the optimal control problem (paper eqs. 16 to 19)."""
    symbols, parameters = StageSymbols.of(samples), model.parameters
    state, inputs = symbols.state, symbols.inputs
    step = _integrate(step_s, samples, smoothing, model, symbols)
    acceleration = inputs[InputIndex.ACCELERATION]
    position, speed = state[StateIndex.POSITION], state[StateIndex.SPEED]
    next_state = {
        StateIndex.POSITION: advance_position_m(position, speed, acceleration, step_s),
        StateIndex.SPEED: advance_speed_m_s(speed, acceleration, step_s),
        StateIndex.CELL_1_TEMPERATURE: step.cell_1_k,
        StateIndex.CELL_N_TEMPERATURE: step.cell_n_k,
        StateIndex.LAST_ACCELERATION: acceleration,
        StateIndex.LAST_COMPRESSOR_POWER: inputs[InputIndex.COMPRESSOR_POWER],
    }
    limits = _limits(parameters, symbols, next_state, step)
    cost = step.cost
    if has_effect(parameters.gap.desired_time_headway_s):
        gap = symbols.p[StepIndex.LEADER_POSITION] - next_state[StateIndex.POSITION]
        error = (
            gap - desired_gap_m(next_state[StateIndex.SPEED], parameters.gap)
        ) / NEARLY_DESIRED_M
        squared_m2 = 2.0 * NEARLY_DESIRED_M**2 * (ca.sqrt(1.0 + error * error) - 1.0)
        cost += step_s * symbols.g[GlobalIndex.HEADWAY_PRICE] * squared_m2
    return symbols.stage(step_s, cost, next_state, limits, model, smoothing, penalties)


@dataclass(frozen=True)
class _StepIntegrals:
    """Integrals over a step: cell temperatures at its end, outlet temperature, cost of J1 to J4.

    ``gaps_m`` are gap and s_min at the samples inside a step that is too long to look at its end only.
    """

    cell_1_k: ca.SX
    cell_n_k: ca.SX
    outlet_k: ca.SX
    cost: ca.SX
    gaps_m: list[tuple[ca.SX, ca.SX]]


def _integrate(
    step_s: float,
    samples: int,
    smoothing: Smoothing,
    model: SymbolicModel,
    symbols: StageSymbols,
) -> _StepIntegrals:
    state, inputs, p, g = symbols.state, symbols.inputs, symbols.p, symbols.g
    parameters, body = model.parameters, model.parameters.body
    inertia_kg = body.mass_kg * body.rotational_inertia_factor
    nodes, weights = quadrature(samples)
    position, speed = state[StateIndex.POSITION], state[StateIndex.SPEED]
    start_1 = state[StateIndex.CELL_1_TEMPERATURE]
    start_n = state[StateIndex.CELL_N_TEMPERATURE]
    acceleration = inputs[InputIndex.ACCELERATION]
    sample_1, sample_n = start_1, start_n
    end_1, end_n, cost = start_1, start_n, ca.SX(0.0)
    gaps_m: list[tuple[ca.SX, ca.SX]] = []
    rates: PowerThermalRates | None = None
    for index, (node, weight) in enumerate(zip(nodes, weights, strict=True)):
        elapsed_s, share_s = float(node) * step_s, float(weight) * step_s
        if rates is not None:
            sample_1 = start_1 + elapsed_s * rates.cell_1_temperature_rate_k_s
            sample_n = start_n + elapsed_s * rates.cell_n_temperature_rate_k_s
        offset = layout.STEP_PARAMETERS + index * layout.SAMPLE_PARAMETERS
        sample = p[offset : offset + layout.SAMPLE_PARAMETERS]
        sample_position = advance_position_m(position, speed, acceleration, elapsed_s)
        sample_speed = advance_speed_m_s(speed, acceleration, elapsed_s)
        ahead = sample_position - sample[SampleIndex.POSITION]
        slope = sample[SampleIndex.SLOPE] + ahead * (
            sample[SampleIndex.SLOPE_GRADIENT] + 0.5 * ahead * sample[SampleIndex.SLOPE_CURVATURE]
        )
        cells = CellPair(sample_1, sample_n, g[GlobalIndex.CELL_1_LOSS], g[GlobalIndex.CELL_N_LOSS])
        rates = power_thermal_rates(
            sample_speed,
            acceleration,
            slope,
            inputs[InputIndex.COMPRESSOR_POWER],
            cells,
            parameters,
            model.channel,
            smoothing,
            charge_limit_w(parameters, g),
        )
        speed_error = sample_speed - sample[SampleIndex.SPEED_REFERENCE]
        motion_w = inertia_kg * sample_speed * acceleration
        cost += share_s * cost_rate(rates, speed_error, sample_1, sample_n, motion_w, g)
        end_1 += share_s * rates.cell_1_temperature_rate_k_s
        end_n += share_s * rates.cell_n_temperature_rate_k_s
        if step_s > LONGEST_STEP_WITHOUT_SAMPLED_GAP_S:
            leader_speed = sample[SampleIndex.LEADER_SPEED]
            shortest = minimum_gap_m(sample_speed, leader_speed, parameters.gap, parameters.limits)
            gaps_m.append((sample[SampleIndex.LEADER_POSITION] - sample_position, shortest))
    if rates is None:
        raise AssertionError("a step has at least one sample")
    return _StepIntegrals(end_1, end_n, rates.coolant.outlet_k, cost, gaps_m)


def _limits(
    parameters: ModelParameters,
    symbols: StageSymbols,
    next_state: Mapping[StateIndex, ca.SX],
    step: _StepIntegrals,
) -> dict[LimitIndex, ca.SX]:
    """Return the inequality rows at the end of the step: paper eqs. 16b to 16i, and the braking reserve."""
    state, inputs, p = symbols.state, symbols.inputs, symbols.p
    bounds, gap_policy = parameters.limits, parameters.gap
    speed = next_state[StateIndex.SPEED]
    gap = p[StepIndex.LEADER_POSITION] - next_state[StateIndex.POSITION]
    leader_speed = p[StepIndex.LEADER_SPEED]
    shortest = minimum_gap_m(speed, leader_speed, gap_policy, bounds)
    at_end = p[StepIndex.END_OF_PREVIEW]
    if has_effect(gap_policy.desired_time_headway_s):
        reserve = emergency_reserve_m(gap, speed, leader_speed, parameters.brakes)
    else:
        # Asked for where the preview ends. At other nodes the row is a number that solvers need not heed.
        reserve = at_end * braking_reserve_m(
            gap, speed, next_state[StateIndex.LAST_ACCELERATION], leader_speed, gap_policy, bounds
        )
        reserve += (1.0 - at_end) * INACTIVE_ROW_M
    margin, floor = gap - shortest, gap - gap_policy.standstill_gap_m
    for gap_inside, shortest_inside in step.gaps_m:
        margin = -maximum(-margin, shortest_inside - gap_inside, GAP_SMOOTHING_M)
        floor = -maximum(-floor, gap_policy.standstill_gap_m - gap_inside, GAP_SMOOTHING_M)
    speed_slack = inputs[InputIndex.SPEED_EXCESS]
    acceleration_change = inputs[InputIndex.ACCELERATION] - state[StateIndex.LAST_ACCELERATION]
    largest_change = bounds.max_jerk_m_s3 * p[StepIndex.ACCELERATION_INTERVAL]
    largest_gap = maximum_gap_m(speed, gap_policy, smoothing_m=GAP_SMOOTHING_M)
    return {
        LimitIndex.ACCELERATION_RATE: acceleration_change / largest_change,
        LimitIndex.COMPRESSOR_RATE: compressor_rate_row(symbols, bounds),
        LimitIndex.GAP_MIN: margin + inputs[InputIndex.GAP_SHORT],
        # The printed s_min turns negative while the leader pulls away; the gap must not.
        LimitIndex.GAP_FLOOR: floor + inputs[InputIndex.GAP_SHORT],
        LimitIndex.GAP_BRAKING: reserve + inputs[InputIndex.GAP_SHORT],
        LimitIndex.GAP_MAX: largest_gap - gap + inputs[InputIndex.GAP_LONG],
        LimitIndex.SPEED_MIN: speed - bounds.min_speed_m_s + speed_slack,
        LimitIndex.SPEED_MAX: p[StepIndex.MAX_SPEED] - speed + speed_slack,
        **temperature_rows(next_state, step.outlet_k, inputs, bounds),
    }


def build_thermal_stage(
    step_s: float,
    levels: int,
    model: SymbolicModel,
    smoothing: Smoothing = DEFAULT_SMOOTHING,
    penalties: PenaltyWeights = DEFAULT_PENALTIES,
) -> StageExpressions:
    """Write down a thermal step: the explicit midpoint rule on the rates averaged over the levels.

    Args:
        levels: number of traction powers.
    """
    symbols, parameters = StageSymbols.of(levels), model.parameters
    state, inputs, g = symbols.state, symbols.inputs, symbols.g
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
            traction_w, speed, power, cells, parameters, model.channel, smoothing, limit_w
        )

    first = rates(ca.sum2(traction) / levels, start_1, start_n)
    middle_1 = start_1 + 0.5 * step_s * first.cell_1_temperature_rate_k_s
    middle_n = start_n + 0.5 * step_s * first.cell_n_temperature_rate_k_s
    each = [rates(traction[level], middle_1, middle_n) for level in range(levels)]
    share_s = step_s / levels
    none = ca.SX(0.0)  # the motion is not optimised
    cost = share_s * sum(cost_rate(one, none, middle_1, middle_n, none, g) for one in each)
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
    return symbols.stage(step_s, cost, next_state, limits, model, smoothing, penalties)
