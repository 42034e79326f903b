"""The strategies of the paper and those beside them, and what is refused."""

from __future__ import annotations

import math

import pytest

from iptm_controller.strategy import STRATEGIES, Strategy, strategy_by_name
from iptm_core.errors import ParameterError

TERMS = ("speed_weight", "temperature_weight", "energy_weight_1_j", "aging_weight")


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        # Q, R, lambda_P, lambda_Q of the paper's Table I; the proposed one is aging alone.
        ("reference", (0.5, 0.1, 0.0, 0.0)),
        ("reference_energy", (0.5, 0.1, 5e-4, 0.0)),
        ("reference_aging", (0.5, 0.1, 0.0, 1e8)),
        ("reference_energy_aging", (0.5, 0.1, 1e-4, 1e8)),
        ("energy_aging", (0.0, 0.0, 1e-3, 5e8)),
    ],
)
def test_weights(name: str, printed: tuple[float, ...]) -> None:
    strategy = strategy_by_name(name)
    assert tuple(getattr(strategy, term) for term in TERMS) == printed


def test_proposed_strategy_counts_aging_only() -> None:
    strategy = strategy_by_name("aging")
    assert [term for term in TERMS if getattr(strategy, term) > 0.0] == ["aging_weight"]


def test_names_are_those_of_the_table() -> None:
    assert len(STRATEGIES) == 8
    for name, strategy in STRATEGIES.items():
        assert strategy.name == name
        assert strategy_by_name(name) is strategy
        assert strategy.reference_temperature_k == pytest.approx(26.0 + 273.15)


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ParameterError, match=r"'ageing'; allowed: .*reference_energy_aging, "):
        strategy_by_name("ageing")


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf, 2e15])
def test_weights_out_of_range_are_refused(term: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"strategy 'mine': {term} is "):
        Strategy("mine", **{term: value})


def test_no_weight_is_no_strategy() -> None:
    with pytest.raises(ParameterError, match="every weight is zero"):
        Strategy("mine")


def test_what_cars_have_today_weighs_nothing() -> None:
    strategy = strategy_by_name("production")
    assert strategy.is_rule_based
    assert not any(getattr(strategy, term) for term in TERMS)
    with pytest.raises(ParameterError, match="'mine' optimises nothing, but has a cost"):
        Strategy("mine", aging_weight=1.0, is_rule_based=True)
