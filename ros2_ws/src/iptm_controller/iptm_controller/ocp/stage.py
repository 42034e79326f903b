"""One step of the horizon as a function: next state, cost and limits, for any step length.

Inside a step the acceleration and the compressor power are constant, so position and speed are exact.
Powers, heat and ageing are integrated by Gauss-Legendre quadrature over the moving speed and slope:
one sample (the midpoint) for steps up to 1 s, more for long ones. That keeps a 5 s step as accurate as
five 1 s steps at less than half of their cost. In steps beyond
``LONGEST_STEP_WITHOUT_SAMPLED_GAP_S`` the gap is also constrained at the samples: a leader can stop and drive
off again within them.
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
)
from iptm_controller.strategy import COST_TERMS, CostPoint
from iptm_core.parameters.model import LimitParameters, ModelParameters
from iptm_core.physics.car_following import braking_reserve_m, maximum_gap_m, minimum_gap_m
from iptm_core.physics.coolant import reduce_channel
from iptm_core.physics.ops import absolute, maximum
from iptm_core.physics.power_thermal import (
    CellPair,
    PowerThermalRates,
    Smoothing,
    power_thermal_rates,
)
from iptm_core.physics.traction import advance_position_m, advance_speed_m_s

DEFAULT_SMOOTHING = Smoothing(
    force_n=150.0,
    power_w=500.0,
    c_rate_1_h=0.05 / 5.019,  # 0.05 A of the paper's cell
    speed_m_s=0.3,
    cooling_w=50.0,
    actuator_w=20.0,
    deliverable_margin=0.02,
    torque_nm=5.0,
    blend_m_s=0.5,
)
LONGEST_STEP_WITHOUT_SAMPLED_GAP_S = 2.5
GAP_SMOOTHING_M = 0.3
COLD_PRICE_1_K_S = 1.0
COLD_PRICE_SHARE_1_S = 0.5
"""Cost per second of a kelvin below the lowest temperature: a base, and a share of the marginal cost."""
COLD_SMOOTHING_K = 0.02
INACTIVE_ROW_M = 1.0
"""Value of the row of the braking reserve where it is not asked for: satisfied, and of order one."""


@dataclass(frozen=True)
class PenaltyWeights:
    """Exact (linear) penalties of the soft limits, cost per unit and second of violation.

    They are ordered: no cost of driving or cooling outbids a limit, and no limit one of a higher rank.
    First the smallest distance to the leader, then the speed, then temperatures, then the largest
    distance. ``Strategy.scale`` keeps the cost small enough for that, whatever its weights.
    """

    gap_short_1_m: float = 1e4
    gap_long_1_m: float = 20.0
    speed_1_m_s: float = 2000.0
    temperature_1_k: float = 200.0


DEFAULT_PENALTIES = PenaltyWeights()


@dataclass(frozen=True)
class StageExpressions:
    """Symbolic stage: scaled symbols in, scaled expressions out.

    Attributes:
        state: symbol, shape (STATES,), order of ``StateIndex``.
        inputs: symbol, shape (INPUTS,), order of ``InputIndex``.
        step_parameters: symbol of this step.
        global_parameters: symbol shared by all steps, shape (GLOBALS,).
        next_state: expression, shape (STATES,).
        cost: scalar expression.
        limits: expression, shape (LIMITS,), order of ``LimitIndex``.
    """

    state: ca.SX
    inputs: ca.SX
    step_parameters: ca.SX
    global_parameters: ca.SX
    next_state: ca.SX
    cost: ca.SX
    limits: ca.SX


def build_stage(
    step_s: float,
    samples: int,
    parameters: ModelParameters,
    smoothing: Smoothing = DEFAULT_SMOOTHING,
    penalties: PenaltyWeights = DEFAULT_PENALTIES,
) -> StageExpressions:
    """Write down one step of the optimal control problem (paper eqs. 16 to 19).

    Args:
        step_s: step length.
        samples: quadrature samples.
        parameters: vehicle, pack and limits.
        smoothing: widths of the smoothed kinks of the model.
        penalties: prices of the soft limits.
    """
    symbols = StageSymbols.of(samples)
    state, inputs = symbols.state, symbols.inputs
    step = _integrate(step_s, samples, smoothing, parameters, symbols)
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
    return symbols.stage(step_s, step.cost, next_state, limits, parameters, smoothing, penalties)


@dataclass(frozen=True)
class StageSymbols:
    """Symbols of a stage in scaled units, and its states and inputs in physical ones.

    Attributes:
        x: states, shape (STATES,).
        u: inputs, shape (INPUTS,).
        p: parameters of the step.
        g: parameters shared by all steps, shape (GLOBALS,).
        state: states in physical units.
        inputs: inputs in physical units.
    """

    x: ca.SX
    u: ca.SX
    p: ca.SX
    g: ca.SX
    state: ca.SX
    inputs: ca.SX

    @classmethod
    def of(cls, samples: int) -> StageSymbols:
        """Return the symbols of a stage with a number of samples."""
        x, u = ca.SX.sym("x", layout.STATES), ca.SX.sym("u", layout.INPUTS)
        p = ca.SX.sym("p", layout.step_parameter_count(samples))
        g = ca.SX.sym("g", layout.GLOBALS)
        state, inputs = x * layout.STATE_SCALE + layout.STATE_OFFSET, u * layout.INPUT_SCALE
        return cls(x, u, p, g, state, inputs)

    def stage(
        self,
        step_s: float,
        cost: ca.SX,
        next_state: Mapping[StateIndex, ca.SX],
        limits: Mapping[LimitIndex, ca.SX],
        parameters: ModelParameters,
        smoothing: Smoothing,
        penalties: PenaltyWeights,
    ) -> StageExpressions:
        """Return a stage: what it is given, and the costs that all stages have.

        Args:
            step_s: step length.
            cost: running cost of the step.
            next_state: physical units.
            limits: rows of the limits.
            parameters: vehicle, pack and limits.
            smoothing: widths of the smoothed kinks of the model.
            penalties: prices of the soft limits.
        """
        end_1_k = next_state[StateIndex.CELL_1_TEMPERATURE]
        change_1_k = end_1_k - self.state[StateIndex.CELL_1_TEMPERATURE]
        end_n_k = next_state[StateIndex.CELL_N_TEMPERATURE]
        change_n_k = end_n_k - self.state[StateIndex.CELL_N_TEMPERATURE]
        power = self.inputs[InputIndex.COMPRESSOR_POWER]
        cost += _price_cost(
            step_s, change_1_k, change_n_k, power, self.g, parameters.limits, smoothing
        )
        cost += _cold_cost(step_s, end_1_k, self.g)
        cost += _slack_cost(step_s, self.inputs, penalties)
        end = ca.vertcat(*layout.in_order(StateIndex, next_state))
        return StageExpressions(
            state=self.x,
            inputs=self.u,
            step_parameters=self.p,
            global_parameters=self.g,
            next_state=(end - layout.STATE_OFFSET) / layout.STATE_SCALE,
            cost=cost,
            limits=ca.vertcat(*layout.in_order(LimitIndex, limits)),
        )


def _slack_cost(step_s: float, inputs: ca.SX, penalties: PenaltyWeights) -> ca.SX:
    """Return what the slacks of a step cost."""
    rate: ca.SX = (
        penalties.gap_short_1_m * inputs[InputIndex.GAP_SHORT]
        + penalties.gap_long_1_m * inputs[InputIndex.GAP_LONG]
        + penalties.speed_1_m_s * inputs[InputIndex.SPEED_EXCESS]
        + penalties.temperature_1_k * inputs[InputIndex.TEMPERATURE_EXCESS]
    )
    return step_s * rate


def _price_cost(
    step_s: float,
    change_1_k: ca.SX,
    change_n_k: ca.SX,
    power_w: ca.SX,
    g: ca.SX,
    bounds: LimitParameters,
    smoothing: Smoothing,
) -> ca.SX:
    """Return the share of a step in the cost to go, and the prices of thermal energy and of cold cooling.

    The price of a temperature at the end of the horizon is, up to a constant, the sum of the prices of its
    changes: so all stages are alike. With a heater the compressor is priced by the square of its power,
    which leaves heating alone without a kink where the actuator is off.
    """
    kilowatts = power_w / layout.INPUT_SCALE[InputIndex.COMPRESSOR_POWER]
    drawn_w = power_w
    if bounds.max_heater_power_w > 0.0:
        kilowatts = maximum(kilowatts, 0.0) ** 2
        drawn_w = absolute(power_w, smoothing.actuator_w)
    cost: ca.SX = (
        g[GlobalIndex.CELL_1_PRICE] * change_1_k
        + g[GlobalIndex.CELL_N_PRICE] * change_n_k
        + step_s * g[GlobalIndex.COMPRESSOR_PRICE] * kilowatts
        + step_s * g[GlobalIndex.THERMAL_ENERGY_PRICE] * drawn_w
    )
    return cost


def _cold_cost(step_s: float, end_1_k: ca.SX, g: ca.SX) -> ca.SX:
    """Return what it costs to plan cell 1, which cooling reaches first, below its lowest temperature.

    Just enough that no cooling pays there: over a few seconds more than the marginal cost at the end of the
    horizon. To heat the cells for it never pays.
    """
    worth_1_k = g[GlobalIndex.CELL_1_PRICE] + g[GlobalIndex.CELL_N_PRICE]
    price_1_k_s = COLD_PRICE_1_K_S + COLD_PRICE_SHARE_1_S * worth_1_k
    below_k = maximum(g[GlobalIndex.LOWEST_TEMPERATURE] - end_1_k, 0.0, COLD_SMOOTHING_K)
    cost: ca.SX = step_s * price_1_k_s * below_k
    return cost


def temperature_rows(
    next_state: Mapping[StateIndex, ca.SX],
    outlet_k: ca.SX,
    inputs: ca.SX,
    bounds: LimitParameters,
) -> dict[LimitIndex, ca.SX]:
    """Return the rows that limit the temperatures at the end of a step (paper eqs. 16g to 16i)."""
    slack = inputs[InputIndex.TEMPERATURE_EXCESS]
    temperatures_k = {
        LimitIndex.CELL_1_MAX: next_state[StateIndex.CELL_1_TEMPERATURE],
        LimitIndex.CELL_N_MAX: next_state[StateIndex.CELL_N_TEMPERATURE],
        LimitIndex.OUTLET_MAX: outlet_k,
    }
    return {
        row: bounds.max_temperature_k - each_k + slack for row, each_k in temperatures_k.items()
    }


def compressor_rate_row(symbols: StageSymbols, bounds: LimitParameters) -> ca.SX:
    """Return the change of the compressor power relative to the largest one, from -1 to 1 (eq. 16c)."""
    change = (
        symbols.inputs[InputIndex.COMPRESSOR_POWER]
        - symbols.state[StateIndex.LAST_COMPRESSOR_POWER]
    )
    row: ca.SX = change / (
        bounds.max_compressor_rate_w_s * symbols.p[StepIndex.COMPRESSOR_INTERVAL]
    )
    return row


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
    parameters: ModelParameters,
    symbols: StageSymbols,
) -> _StepIntegrals:
    state, inputs, p, g = symbols.state, symbols.inputs, symbols.p, symbols.g
    channel = reduce_channel(parameters.cooling, parameters.pack)
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
            channel,
            smoothing,
        )
        speed_error = sample_speed - sample[SampleIndex.SPEED_REFERENCE]
        cost += share_s * cost_rate(rates, speed_error, sample_1, sample_n, g)
        end_1 += share_s * rates.cell_1_temperature_rate_k_s
        end_n += share_s * rates.cell_n_temperature_rate_k_s
        if step_s > LONGEST_STEP_WITHOUT_SAMPLED_GAP_S:
            leader_speed = sample[SampleIndex.LEADER_SPEED]
            shortest = minimum_gap_m(sample_speed, leader_speed, parameters.gap, parameters.limits)
            gaps_m.append((sample[SampleIndex.LEADER_POSITION] - sample_position, shortest))
    if rates is None:
        raise AssertionError("a step has at least one sample")
    return _StepIntegrals(end_1, end_n, rates.coolant.outlet_k, cost, gaps_m)


def cost_rate(
    rates: PowerThermalRates, speed_error: ca.SX, cell_1_k: ca.SX, cell_n_k: ca.SX, g: ca.SX
) -> ca.SX:
    """Return the sum of all cost terms per second (paper eq. 17)."""
    reference_k = g[GlobalIndex.REFERENCE_TEMPERATURE]
    at = CostPoint(rates, speed_error, cell_1_k - reference_k, cell_n_k - reference_k)
    rate: ca.SX = sum(term.rate(g[layout.WEIGHTS[key]], at) for key, term in COST_TERMS.items())
    return rate


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
    reserve = braking_reserve_m(
        gap, speed, next_state[StateIndex.LAST_ACCELERATION], leader_speed, gap_policy, bounds
    )
    margin, floor = gap - shortest, gap - gap_policy.standstill_gap_m
    for gap_inside, shortest_inside in step.gaps_m:
        margin = -maximum(-margin, shortest_inside - gap_inside, GAP_SMOOTHING_M)
        floor = -maximum(-floor, gap_policy.standstill_gap_m - gap_inside, GAP_SMOOTHING_M)
    at_end = p[StepIndex.END_OF_PREVIEW]
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
        # Asked for where the preview ends. At other nodes the row is a number that solvers need not heed.
        LimitIndex.GAP_BRAKING: at_end * reserve
        + (1.0 - at_end) * INACTIVE_ROW_M
        + inputs[InputIndex.GAP_SHORT],
        LimitIndex.GAP_MAX: largest_gap - gap + inputs[InputIndex.GAP_LONG],
        LimitIndex.SPEED_MIN: speed - bounds.min_speed_m_s + speed_slack,
        LimitIndex.SPEED_MAX: p[StepIndex.MAX_SPEED] - speed + speed_slack,
        **temperature_rows(next_state, step.outlet_k, inputs, bounds),
    }
