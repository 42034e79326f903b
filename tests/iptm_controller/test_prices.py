"""Strategies in one currency: prices by hand, the law and the end of the trip that they take."""

from __future__ import annotations

import math

import pytest
from tests.iptm_controller.scenes import PARAMETERS

from iptm_controller.options import ControllerOptions
from iptm_controller.pack_model import valuation_of
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import STRATEGIES, Strategy
from iptm_core.aging_laws.parking import PRICED_LAW, AgingSettings, ParkedAging

PRICES = STRATEGIES["prices"]


def weighed(use: AgingSettings) -> Strategy:
    """Return the strategy as the problem weighs it."""
    options = ControllerOptions(strategy=PRICES, aging=use)
    law = ParkedAging(PRICED_LAW, use, 308.15)
    return valuation_of(PRICES, options, law, PARAMETERS)[0]


def test_prices_by_hand() -> None:
    """The weight of ageing is for both cells, whose mean is the pack: 1 EUR is the same in every term."""
    found = weighed(
        AgingSettings(electricity_eur_kwh=0.36, battery_eur_kwh=100.0, headway_eur_m2_h=0.004)
    )
    pack = PARAMETERS.pack
    capacity_ah = PARAMETERS.cell.nominal_capacity_ah * pack.parallel
    share_eur = 100.0 * pack.open_circuit_voltage_v * capacity_ah / 1000.0 / 0.2
    per_eur = 2.0 * found.aging_weight / share_eur
    assert found.spent_energy_weight_1_j == pytest.approx(1e-7 * per_eur)
    assert found.headway_price_1_m2_s == pytest.approx(0.004 / 3600.0 * per_eur)
    assert found.energy_weight_1_j == 0.0


def test_the_price_of_the_headway_has_the_unit_of_the_law() -> None:
    """Ageing by the law of a cell is scaled down, and the price with it."""
    aging = STRATEGIES["aging_cost_to_go"]
    half = aging.scaled(0.5)
    ratios = [each.headway_price_1_m2_s / each.aging_weight for each in (aging, half)]
    assert ratios[0] == pytest.approx(ratios[1])


def test_law_and_end_of_the_trip() -> None:
    """The paper's law has no hours after the trip; a law that has them cools in time for its end."""
    assert ControllerOptions().law is None
    assert ControllerOptions(strategy=PRICES).law is PRICED_LAW
    for changes, end_s in (
        ({}, math.inf),
        ({"strategy": "prices"}, 900.0),
        ({"aging_law": "lfp"}, 900.0),
    ):
        settings = ControllerSettings(value_beyond_trip=True, **changes)  # type: ignore[arg-type]
        assert settings.options(1.0, 900.0).trip_duration_s == end_s
