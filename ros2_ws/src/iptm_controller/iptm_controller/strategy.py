"""Control strategies as data: which of the cost terms count, and with which weight.

The terms J1 to J4 are the paper's. Each is declared once, by the field of `Strategy` that holds its weight;
the optimal control problem, the parameters of the node and all tables of weights are made from `COST_TERMS`.
A weight of zero leaves a term out. Sums over the horizon are taken as integrals (each step counts with
its length), so that a strategy means the same on every grid; on 1 s steps this is the printed sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from iptm_core.declaration import TextEnum
from iptm_core.errors import ParameterError
from iptm_core.physics.ops import Scalar
from iptm_core.physics.power_thermal import PowerThermalRates
from iptm_core.user_input import suggestion

REFERENCE_TEMPERATURE_K = 299.15  # r_T = 26 degC
SPEED_WEIGHT = 0.5  # Q
TEMPERATURE_WEIGHT = 0.1  # R
DEFAULT_STRATEGY = "aging_cost_to_go"
MAX_WEIGHT = 1e15
HEADWAY_PRICE_1_M2_S = 0.003
"""Cost per second of a squared metre between the gap and a desired one, in the unit of the ageing of `aging`.
Headways and savings hardly depend on it from a tenth to ten times as much."""
COLDEST_BELOW_LIMIT_K = 2.0
"""Of the default: the thermostat of `production` cools the mean to the limit, too, and its first cell 2.2 K
further."""


class DrivingRules(TextEnum):
    """Laws of `iptm_controller.production` that drive and cool in place of an optimisation."""

    NONE = "none"
    PRODUCTION = "production"
    PRODUCTION_SIMPLE = "production_simple"
    ECO_ACC = "eco_acc"
    RULE_PREVIEW = "rule_preview"


@dataclass(frozen=True)
class CostPoint:
    """What the cost depends on at one instant: powers and rates, and deviations from the references.

    Attributes:
        speed_error_m_s: speed less its reference.
        cell_1_error_k: temperature of cell 1 less its reference.
        cell_n_error_k: the same of cell N.
        motion_power_w: rate of the kinetic energy.
    """

    rates: PowerThermalRates
    speed_error_m_s: Scalar
    cell_1_error_k: Scalar
    cell_n_error_k: Scalar
    motion_power_w: Scalar


@dataclass(frozen=True)
class CostTerm:
    """One term of the cost (paper eq. 17).

    Attributes:
        name: as in the paper.
        meaning: the weighted quantity.
        symbol: of its weight.
        unit: of its weight; empty for none.
        typical_1_s: cost per second with a weight of 1 in ordinary driving.
        rate: cost per second from the weight and the instant; linear in the weight.
    """

    name: str
    meaning: str
    symbol: str
    unit: str
    typical_1_s: float
    rate: Callable[[Scalar, CostPoint], Scalar]


def _weight(*term: Any) -> Any:
    return field(default=0.0, metadata={"term": CostTerm(*term)})


@dataclass(frozen=True)
class Strategy:
    """Weights of the cost terms, each a field, which is also the parameter of the controller node.

    Attributes:
        name: short name, as used in parameters and tables.
        reference_temperature_k: r_T of J2.
        headway_price_1_m2_s: cost per second of a squared metre between the gap and a desired one; it is
            scaled with the weights.
        cost_to_go: price the cell temperatures at the end of the horizon by the aging that follows, see
            ``TemperatureValue``; there is nothing to weigh.
        coldest_below_limit_k: how far the coldest cell may be cooled below the lower temperature limit while
            the mean of the pack keeps it; with 0 each cell keeps it, as in the paper.
        in_currency: all is priced: capacity by the law of a cell, energy (J5) and headway. The weight of
            ageing only sets the scale of the cost.
        rules: laws that drive and cool where nothing is weighed.
    """

    name: str
    # fmt: off
    speed_weight: float = _weight(
        "J1", "deviation from the leader's recent mean speed", "Q", "1/(m/s)^2", 5.0**2,
        lambda weight, at: weight * at.speed_error_m_s * at.speed_error_m_s)
    temperature_weight: float = _weight(
        "J2", "deviation of both cells from the reference", "R", "1/K^2", 2.0 * 5.0**2,
        lambda weight, at: weight * (
            at.cell_1_error_k * at.cell_1_error_k + at.cell_n_error_k * at.cell_n_error_k))
    energy_weight_1_j: float = _weight(
        "J3", "energy at the battery terminals", "lambda_P", "1/J", 20e3,
        lambda weight, at: weight * at.rates.battery_power_w)
    aging_weight: float = _weight(
        "J4", "capacity loss of both cells", "lambda_Q", "", 1e-9,
        lambda weight, at: weight * (
            at.rates.cell_1_capacity_loss_rate_1_s + at.rates.cell_n_capacity_loss_rate_1_s))
    spent_energy_weight_1_j: float = _weight(
        "J5", "energy at the battery terminals less what the motion gains", "lambda_E", "1/J", 20e3,
        lambda weight, at: weight * (
            at.rates.battery_power_w - at.motion_power_w))
    # fmt: on
    reference_temperature_k: float = REFERENCE_TEMPERATURE_K
    headway_price_1_m2_s: float = HEADWAY_PRICE_1_M2_S
    cost_to_go: bool = False
    coldest_below_limit_k: float = 0.0
    in_currency: bool = False
    rules: DrivingRules = DrivingRules.NONE

    def __post_init__(self) -> None:
        for key, value in self.weights.items():
            if not (math.isfinite(value) and 0.0 <= value <= MAX_WEIGHT):
                raise ParameterError(
                    f"strategy '{self.name}': {key} is {value}; allowed: 0 to 1e15"
                )
        has_cost = any(value > 0.0 for value in self.weights.values())
        if self.is_rule_based and (self.cost_to_go or has_cost):
            raise ParameterError(
                f"strategy '{self.name}' optimises nothing, but has a cost; allowed: weights of 0"
            )
        if not (self.is_rule_based or has_cost):
            raise ParameterError(
                f"strategy '{self.name}' has no cost term: every weight is zero; allowed: one above 0"
            )

    @property
    def is_rule_based(self) -> bool:
        """Whether nothing is optimised."""
        return self.rules != DrivingRules.NONE  # a stored strategy holds the text

    @property
    def weights(self) -> dict[str, float]:
        """Weights of the terms by field, in the order of `COST_TERMS`."""
        return {key: getattr(self, key) for key in COST_TERMS}

    def scaled(self, factor: float) -> Strategy:
        """Return the strategy with all weights multiplied by a factor."""
        weights: dict[str, Any] = {key: factor * value for key, value in self.weights.items()}
        weights["headway_price_1_m2_s"] = factor * self.headway_price_1_m2_s
        return replace(self, **weights)

    @property
    def scale(self) -> float:
        """Factor on all weights that keeps a typical cost below what the soft limits are priced at.

        1 for the strategies of this module. It changes no optimum among plans that keep the limits.
        """
        if self.is_rule_based:
            return 1.0
        typical_1_s = sum(
            COST_TERMS[key].typical_1_s * value for key, value in self.weights.items()
        )
        return min(1.0, _LARGEST_TYPICAL_COST_1_S / typical_1_s)


COST_TERMS: Mapping[str, CostTerm] = {
    entry.name: entry.metadata["term"] for entry in fields(Strategy) if "term" in entry.metadata
}
"""All terms by the field of `Strategy` that holds their weight."""

_LARGEST_TYPICAL_COST_1_S = 50.0

# With aging alone the weight only sets the scale of the cost; 1e9 makes it of order one per second.
_AGING_ONLY_WEIGHT = 1e9
_REFERENCE = Strategy("reference", speed_weight=SPEED_WEIGHT, temperature_weight=TEMPERATURE_WEIGHT)
_AGING = Strategy("aging", aging_weight=_AGING_ONLY_WEIGHT)
_OWN = replace(
    _AGING, name=DEFAULT_STRATEGY, cost_to_go=True, coldest_below_limit_k=COLDEST_BELOW_LIMIT_K
)

STRATEGIES: dict[str, Strategy] = {
    strategy.name: strategy
    for strategy in (
        _REFERENCE,
        replace(_REFERENCE, name="reference_energy", energy_weight_1_j=5e-4),
        replace(_REFERENCE, name="reference_aging", aging_weight=1e8),
        replace(
            _REFERENCE, name="reference_energy_aging", energy_weight_1_j=1e-4, aging_weight=1e8
        ),
        Strategy("energy_aging", energy_weight_1_j=1e-3, aging_weight=5e8),
        _AGING,
        _OWN,
        replace(_OWN, name="prices", in_currency=True),
        *(
            Strategy(rules.value, rules=rules)
            for rules in DrivingRules
            if rules is not DrivingRules.NONE
        ),
    )
}
"""By name: the six of the paper, of which it proposes ``aging``, the default, and those without an
optimisation: what cars have today, tuned and simple, the best that is known here without a preview, and a
formula with one."""


def strategy_by_name(name: str) -> Strategy:
    """Return a shipped strategy."""
    try:
        return STRATEGIES[name]
    except KeyError:
        hint = suggestion(name, STRATEGIES)
        raise ParameterError(f"strategy is '{name}'; {hint}") from None
