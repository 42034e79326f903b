"""Control strategies as data: which of the cost terms count, and with which weight.

J1 to J4 are the paper's; the cost to go of the temperatures is what comes after the horizon.

A weight of zero leaves a term out. Sums over the horizon are taken as integrals (each step counts with
its length), so that a strategy means the same on every grid; on 1 s steps this is the printed sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from iptm_core.errors import ParameterError

REFERENCE_TEMPERATURE_K = 299.15  # r_T = 26 degC
SPEED_WEIGHT = 0.5  # Q
TEMPERATURE_WEIGHT = 0.1  # R
DEFAULT_STRATEGY = "aging_cost_to_go"


@dataclass(frozen=True)
class Strategy:
    """Weights of the four cost terms (paper eq. 17).

    Attributes:
        name: short name, as used in parameters and tables.
        speed_weight: Q of J1, deviation from the leader's recent mean speed, 1/(m/s)^2.
        temperature_weight: R of J2, deviation of both cells from the reference, 1/K^2.
        energy_weight_1_j: lambda_P of J3, energy at the battery terminals.
        aging_weight: lambda_Q of J4, capacity loss of both cells.
        reference_temperature_k: r_T of J2.
        cost_to_go: price the cell temperatures at the end of the horizon by the aging that follows, see
            ``TemperatureValue``; there is nothing to weigh.
        is_rule_based: drive and cool by the laws of `iptm_controller.production`, which weigh nothing.
    """

    name: str
    speed_weight: float = 0.0
    temperature_weight: float = 0.0
    energy_weight_1_j: float = 0.0
    aging_weight: float = 0.0
    reference_temperature_k: float = REFERENCE_TEMPERATURE_K
    cost_to_go: bool = False
    is_rule_based: bool = False

    def __post_init__(self) -> None:
        weights = {
            "speed_weight": self.speed_weight,
            "temperature_weight": self.temperature_weight,
            "energy_weight_1_j": self.energy_weight_1_j,
            "aging_weight": self.aging_weight,
        }
        for key, value in weights.items():
            if not (math.isfinite(value) and 0.0 <= value <= 1e15):
                raise ParameterError(
                    f"strategy '{self.name}': {key} is {value}; allowed: 0 to 1e15"
                )
        if self.is_rule_based:
            if self.cost_to_go or any(value > 0.0 for value in weights.values()):
                raise ParameterError(
                    f"strategy '{self.name}' optimises nothing, but has a cost; allowed: weights of 0"
                )
        elif not any(value > 0.0 for value in weights.values()):
            raise ParameterError(
                f"strategy '{self.name}' has no cost term: every weight is zero; allowed: one above 0"
            )

    @property
    def scale(self) -> float:
        """Factor on all weights that keeps a typical cost below what the soft limits are priced at.

        1 for the strategies of this module. It changes no optimum among plans that keep the limits.
        """
        if self.is_rule_based:
            return 1.0
        typical_1_s = (
            self.speed_weight * _TYPICAL_SPEED_ERROR_M_S**2
            + self.temperature_weight * 2.0 * _TYPICAL_TEMPERATURE_ERROR_K**2
            + self.energy_weight_1_j * _TYPICAL_POWER_W
            + self.aging_weight * _TYPICAL_AGING_RATE_1_S
        )
        return min(1.0, _LARGEST_TYPICAL_COST_1_S / typical_1_s)


_LARGEST_TYPICAL_COST_1_S = 50.0
_TYPICAL_SPEED_ERROR_M_S = 5.0
_TYPICAL_TEMPERATURE_ERROR_K = 5.0
_TYPICAL_POWER_W = 20e3
_TYPICAL_AGING_RATE_1_S = 1e-9  # both cells

# With aging alone the weight only sets the scale of the cost; 1e9 makes it of order one per second.
_AGING_ONLY_WEIGHT = 1e9
_REFERENCE = Strategy("reference", speed_weight=SPEED_WEIGHT, temperature_weight=TEMPERATURE_WEIGHT)
_AGING = Strategy("aging", aging_weight=_AGING_ONLY_WEIGHT)

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
        replace(_AGING, name=DEFAULT_STRATEGY, cost_to_go=True),
        Strategy("production", is_rule_based=True),
    )
}
"""By name: the six of the paper, of which it proposes ``aging``, the default, and what cars have today."""


def strategy_by_name(name: str) -> Strategy:
    """Return a shipped strategy.

    Raises:
        ParameterError: the strategy is unknown.
    """
    try:
        return STRATEGIES[name]
    except KeyError:
        raise ParameterError(f"strategy is '{name}'; allowed: {', '.join(STRATEGIES)}") from None
