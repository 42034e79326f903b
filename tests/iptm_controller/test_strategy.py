"""Strategies and terms of the cost; from the parameters of the node to a controller."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from tests.iptm_controller.scenes import PARAMETERS

from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import (
    COST_TERMS,
    DEFAULT_STRATEGY,
    STRATEGIES,
    CostPoint,
    DrivingRules,
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
    motion_power_w=5e3,
)


@pytest.mark.parametrize(
    ("field", "name", "weight", "rate_1_s"),
    [
        ("speed_weight", "J1", 0.5, 4.5),
        ("temperature_weight", "J2", 0.1, 4.1),
        ("energy_weight_1_j", "J3", 1e-3, 20.0),
        ("aging_weight", "J4", 1e9, 0.5),
        ("spent_energy_weight_1_j", "J5", 1e-3, 15.0),
    ],
)
def test_cost_of_an_instant_and_parameter_of_the_node(
    field: str, name: str, weight: float, rate_1_s: float
) -> None:
    term = COST_TERMS[field]
    assert term.name == name
    assert term.rate(weight, AT) == pytest.approx(rate_1_s)
    given: dict[str, Any] = {"strategy": "energy_aging", field: weight}
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
        ("production_simple", (0.0, 0.0, 0.0, 0.0)),
        ("eco_acc", (0.0, 0.0, 0.0, 0.0)),
        ("rule_preview", (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_weights(name: str, printed: tuple[float, ...]) -> None:
    strategy = strategy_by_name(name)
    assert tuple(strategy.weights.values())[: len(printed)] == printed
    assert strategy.reference_temperature_k == pytest.approx(26.0 + 273.15)
    assert strategy.is_rule_based == (not any(printed))


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(
        ParameterError, match=f"'ageing'; did you mean 'aging'\\? allowed: {', '.join(STRATEGIES)}"
    ):
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
        Strategy("mine", aging_weight=1.0, rules=DrivingRules.PRODUCTION)


SMALL = ControllerNodeParameters(horizon="2x1")


def test_defaults_of_the_node_are_those_of_the_controller() -> None:
    options = replace(SMALL, horizon=str(MULTI_HORIZON)).build_controller().options
    expected = ControllerOptions()
    assert options.strategy == expected.strategy == STRATEGIES[DEFAULT_STRATEGY]
    assert options.horizon == expected.horizon == MULTI_HORIZON
    assert options.shifted_plan_ticks == expected.shifted_plan_ticks
    assert options.safe_law_ticks == expected.safe_law_ticks
    assert options.max_preview_age_s == expected.max_preview_age_s
    assert options.tick_s == expected.tick_s
    assert options.solver == expected.solver


def test_every_parameter_reaches_the_controller() -> None:
    controller = ControllerNodeParameters(
        strategy="reference",
        horizon="2x1+1x5",
        max_iterations=42,
        deadline_ms=80.0,
        tolerance=1e-4,
        overrides="gap.max_gap_m=80, limits.max_jerk_m_s3=1.0",
        period_s=0.5,
        max_preview_age_s=3.0,
        shifted_plan_ticks=7,
        safe_law_ticks=9,
    ).build_controller()
    options = controller.options
    assert options.strategy == STRATEGIES["reference"]
    assert options.horizon == Horizon.parse("2x1+1x5")
    assert options.solver.max_iterations == 42
    assert options.solver.deadline_s == pytest.approx(0.08)
    assert options.solver.tolerance == 1e-4
    assert (options.shifted_plan_ticks, options.safe_law_ticks) == (7, 9)
    assert options.max_preview_age_s == 3.0
    assert options.tick_s == 0.5
    assert PARAMETERS.gap.max_gap_m != 80.0


def test_all_weights_zero_is_refused() -> None:
    with pytest.raises(ParameterError, match="every weight is zero"):
        replace(SMALL, aging_weight=0.0).build_controller()


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"horizon": "3by1"}, "horizon '3by1' cannot be read"),
        ({"horizon": "5x5+3x1"}, "do not shrink"),
        ({"parameter_set": "no_such_set"}, "no_such_set"),
        ({"overrides": "body.mas_kg=1600"}, "mas_kg"),
        ({"overrides": "body.mass_kg=-1"}, "mass_kg"),
        ({"overrides": "body.mass_kg"}, "overrides have the entry"),
    ],
)
def test_what_cannot_be_built_is_named(wrong: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ParameterError) as caught:
        replace(SMALL, **wrong).build_controller()
    assert complaint in str(caught.value)
