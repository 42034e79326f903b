"""The price of a kelvin on arrival, against years of use composed with a kelvin more and a kelvin less."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.extras.iptm_life.test_year_of_use import trip

from iptm.climate import CLIMATES, MONTH_DAYS, Climate
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K
from iptm_life.life import SERVICE_YEARS, losses_by_cause
from iptm_life.year import NO_COOLING, USAGES, Activity, Year, year_of

COMMUTER = USAGES[0]
PARAMETERS = load_parameters().values
STEP_K = 0.2
DRAWN = 0.052
UNCOOLED = trip(4.4, drawn=DRAWN)
"""Warms the pack as the WLTC without cooling does, and draws as much."""


def prices_1_k(law: str, climate: Climate, arrival_k: FloatArray) -> FloatArray:
    """Prices with the settings of a commuter, mean of the arrivals of each month."""
    monthly_k = np.array(climate.monthly_c) + CELSIUS_ZERO_K
    prices = []
    for air_k, kelvin in zip(monthly_k, arrival_k, strict=True):
        use = AgingSettings(
            aging_law=law,
            parking_air_k=float(air_k),
            parking_air_swing_k=0.5 * climate.daily_range_k,
            year_air_k=float(np.mean(monthly_k)),
            year_air_swing_k=0.5 * float(np.ptp(monthly_k)),
            charging_target=COMMUTER.target,
            charging_c_rate_1_h=COMMUTER.charging_c_rate_1_h,
            daily_discharge=len(COMMUTER.departures) * DRAWN,
        )
        parked = ParkedAging(LAWS[law], use, PARAMETERS.environment.ambient_temperature_k)
        prices.append(float(np.mean(parked.kelvin_price_1_k(kelvin))))
    return np.array(prices)


def costates(law: str, climate: Climate) -> tuple[FloatArray, FloatArray]:
    """Costs of a kelvin on arrival, shape (12,), and temperatures there, shape (12, drives of a day)."""

    def year(month: int, step_k: float) -> Year:
        warmer = replace(UNCOOLED, end_k=UNCOOLED.end_k + step_k)
        return year_of(
            COMMUTER,
            climate,
            NO_COOLING,
            [warmer if each == month else UNCOOLED for each in range(12)],
            PARAMETERS,
        )

    def lost(month: int, step_k: float) -> float:
        return sum(losses_by_cause(LAWS[law], year(month, step_k), SERVICE_YEARS).values())

    usual = year(0, 0.0)
    driving = usual.activity == Activity.DRIVING
    ends = np.flatnonzero(driving[:-1] & ~driving[1:]) + 1
    arrivals = SERVICE_YEARS * len(COMMUTER.departures) * 5.0 / 7.0 * np.array(MONTH_DAYS)
    differences = [lost(month, STEP_K) - lost(month, -STEP_K) for month in range(12)]
    return (
        np.array(differences) / (2.0 * STEP_K * arrivals),
        np.asarray(usual.load.temperature_k)[ends].reshape(12, -1),
    )


@pytest.mark.parametrize(
    "name",
    [
        name if name in {"lfp", "nmc111"} else pytest.param(name, marks=pytest.mark.slow)
        for name in LAWS
    ],
)
def test_the_price_of_a_kelvin_is_its_costate(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over a year within 15 % of the sum of magnitudes in each climate, over months correlated by 0.99."""
    monkeypatch.setattr("iptm_life.year.UPPER_LIMIT_K", math.inf)  # a kelvin above it lasts no time
    found, expected = [], []
    for climate in CLIMATES:
        costs, arrival_k = costates(name, climate)
        prices = prices_1_k(name, climate, arrival_k)
        error = float(np.sum(prices - costs) / np.sum(np.abs(costs)))
        print(f"{name} {climate.name}: {100.0 * error:+.1f} %")
        assert abs(error) < 0.15
        found += list(prices)
        expected += list(costs)
    correlation = float(np.corrcoef(found, expected)[0, 1])
    print(f"{name}: correlation {correlation:.4f}")
    assert correlation > 0.99
