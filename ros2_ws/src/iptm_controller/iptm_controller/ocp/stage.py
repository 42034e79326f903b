"""Common parts of all stages of the optimal control problem: symbols, costs, temperature rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import (
    GlobalIndex,
    InputIndex,
    LimitIndex,
    StateIndex,
    StepIndex,
)
from iptm_controller.strategy import COST_TERMS, CostPoint
from iptm_core.declaration import has_effect
from iptm_core.parameters.model import LimitParameters, ModelParameters
from iptm_core.physics.model_numbers import SymbolicModel
from iptm_core.physics.ops import absolute, maximum
from iptm_core.physics.power_thermal import (
    PowerThermalRates,
    Smoothing,
)

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
        model: with the symbol of its numbers.
    """

    state: ca.SX
    inputs: ca.SX
    step_parameters: ca.SX
    global_parameters: ca.SX
    next_state: ca.SX
    cost: ca.SX
    limits: ca.SX
    model: SymbolicModel


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
        model: SymbolicModel,
        smoothing: Smoothing,
        penalties: PenaltyWeights,
    ) -> StageExpressions:
        """Return a stage: what it is given, and the costs that all stages have.

        Args:
            cost: running cost of the step.
            next_state: physical units.
        """
        end_1_k = next_state[StateIndex.CELL_1_TEMPERATURE]
        change_1_k = end_1_k - self.state[StateIndex.CELL_1_TEMPERATURE]
        end_n_k = next_state[StateIndex.CELL_N_TEMPERATURE]
        change_n_k = end_n_k - self.state[StateIndex.CELL_N_TEMPERATURE]
        power = self.inputs[InputIndex.COMPRESSOR_POWER]
        cost += _price_cost(
            step_s, change_1_k, change_n_k, power, self.g, model.parameters.limits, smoothing
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
            model=model,
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
    if has_effect(bounds.max_heater_power_w):
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


def charge_limit_w(parameters: ModelParameters, g: ca.SX) -> ca.SX | None:
    """Return the largest charging power, None for a pack without limits."""
    return g[GlobalIndex.CHARGE_POWER] if parameters.pack_limits.limited else None


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


def cost_rate(
    rates: PowerThermalRates,
    speed_error: ca.SX,
    cell_1_k: ca.SX,
    cell_n_k: ca.SX,
    motion_power_w: ca.SX,
    g: ca.SX,
) -> ca.SX:
    """Return the sum of all cost terms per second (paper eq. 17)."""
    reference_k = g[GlobalIndex.REFERENCE_TEMPERATURE]
    at = CostPoint(
        rates, speed_error, cell_1_k - reference_k, cell_n_k - reference_k, motion_power_w
    )
    rate: ca.SX = sum(term.rate(g[layout.WEIGHTS[key]], at) for key, term in COST_TERMS.items())
    return rate
