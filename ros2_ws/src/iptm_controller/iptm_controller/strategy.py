"""Control strategies as data: which of the paper's cost terms J1 to J4 count, and with which weight.

A weight of zero leaves a term out. Sums over the horizon are taken as integrals (each step counts with
its length), so that a strategy means the same on every grid; on 1 s steps this is the printed sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.errors import ParameterError

REFERENCE_TEMPERATURE_K = 299.15  # r_T = 26 degC
SPEED_WEIGHT = 0.5  # Q
TEMPERATURE_WEIGHT = 0.1  # R


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
    """

    name: str
    speed_weight: float = 0.0
    temperature_weight: float = 0.0
    energy_weight_1_j: float = 0.0
    aging_weight: float = 0.0
    reference_temperature_k: float = REFERENCE_TEMPERATURE_K

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
        if not any(value > 0.0 for value in weights.values()):
            raise ParameterError(
                f"strategy '{self.name}' has no cost term: every weight is zero; allowed: one above 0"
            )


# With aging alone the weight only sets the scale of the cost; 1e9 makes it of order one per second.
_AGING_ONLY_WEIGHT = 1e9
_REFERENCE = {"speed_weight": SPEED_WEIGHT, "temperature_weight": TEMPERATURE_WEIGHT}

STRATEGIES: dict[str, Strategy] = {
    strategy.name: strategy
    for strategy in (
        Strategy("reference", **_REFERENCE),
        Strategy("reference_energy", **_REFERENCE, energy_weight_1_j=5e-4),
        Strategy("reference_aging", **_REFERENCE, aging_weight=1e8),
        Strategy("reference_energy_aging", **_REFERENCE, energy_weight_1_j=1e-4, aging_weight=1e8),
        Strategy("energy_aging", energy_weight_1_j=1e-3, aging_weight=5e8),
        Strategy("aging", aging_weight=_AGING_ONLY_WEIGHT),
    )
}
"""The six strategies of the paper by name; ``aging`` is the proposed one."""


def strategy_by_name(name: str) -> Strategy:
    """Return a strategy of the paper.

    Raises:
        ParameterError: there is no such strategy.
    """
    try:
        return STRATEGIES[name]
    except KeyError:
        raise ParameterError(f"strategy is '{name}'; allowed: {', '.join(STRATEGIES)}") from None
