"""The strategies of the paper and the others, the terms of the cost, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.strategy import (
    COST_TERMS,
    STRATEGIES,
    CostPoint,
    Strategy,
    strategy_by_name,
)
from iptm_core.errors import ParameterError
from iptm_core.physics.power_thermal import PowerThermalRates

AT = CostPoint(
    rates=PowerThermalRates(
        traction_power_w=15e3,
        battery_power_w=20e3,
        pack_current_a=50.0,
        cell_current_a=1.0,
        coolant=None,  # type: ignore[arg-type]  not weighed
        cell_1_temperature_rate_k_s=0.0,
        cell_n_temperature_rate_k_s=0.0,
        cell_1_capacity_loss_rate_1_s=2e-10,
        cell_n_capacity_loss_rate_1_s=3e-10,
    ),
    speed_error_m_s=-3.0,
    cell_1_error_k=4.0,
    cell_n_error_k=-5.0,
)


@pytest.mark.parametrize(
    ("field", "name", "parameter", "weight", "rate_1_s"),
    [
        ("speed_weight", "J1", "speed_weight", 0.5, 4.5),
        ("temperature_weight", "J2", "temperature_weight", 0.1, 4.1),
        ("energy_weight_1_j", "J3", "energy_weight", 1e-3, 20.0),
        ("aging_weight", "J4", "aging_weight", 1e9, 0.5),
    ],
)
def test_cost_of_an_instant_and_parameter_of_the_node(
    field: str, name: str, parameter: str, weight: float, rate_1_s: float
) -> None:
    term = COST_TERMS[field]
    assert term.name == name
    assert term.rate(weight, AT) == pytest.approx(rate_1_s)
    given: dict[str, Any] = {"strategy": "energy_aging", parameter: weight}
    chosen = ControllerNodeParameters(**given).controller_options().strategy
    assert chosen.weights == {**strategy_by_name("energy_aging").weights, field: weight}


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        # Q, R, lambda_P, lambda_Q of the paper's Table I; the proposed one is aging alone.
        ("reference", (0.5, 0.1, 0.0, 0.0)),
        ("reference_energy", (0.5, 0.1, 5e-4, 0.0)),
        ("reference_aging", (0.5, 0.1, 0.0, 1e8)),
        ("reference_energy_aging", (0.5, 0.1, 1e-4, 1e8)),
        ("energy_aging", (0.0, 0.0, 1e-3, 5e8)),
        ("aging", (0.0, 0.0, 0.0, 1e9)),
        ("production", (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_weights(name: str, printed: tuple[float, ...]) -> None:
    strategy = strategy_by_name(name)
    assert tuple(strategy.weights.values())[: len(printed)] == printed
    assert strategy.reference_temperature_k == pytest.approx(26.0 + 273.15)
    assert strategy.is_rule_based == (not any(printed))


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ParameterError, match=f"'ageing'; allowed: {', '.join(STRATEGIES)}"):
        strategy_by_name("ageing")


@pytest.mark.parametrize("term", COST_TERMS)
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf, 2e15])
def test_weights_out_of_range_are_refused(term: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"strategy 'mine': {term} is "):
        Strategy("mine", **{term: value})


def test_a_cost_is_needed_unless_nothing_is_optimised() -> None:
    with pytest.raises(ParameterError, match="every weight is zero"):
        Strategy("mine")
    with pytest.raises(ParameterError, match="'mine' optimises nothing, but has a cost"):
        Strategy("mine", aging_weight=1.0, is_rule_based=True)
