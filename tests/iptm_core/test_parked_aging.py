"""What a kelvin costs a parked pack, against integration of the law over the hours."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.law import Load, Mechanism
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.errors import ParameterError

USE = AgingSettings(
    parking_air_k=300.0, parking_air_swing_k=6.0, year_air_k=290.0, daily_discharge=0.0
)
STEP_S = 60.0


def parked_loss(law: str, aging: ParkedAging, arrival_k: float, hours: float) -> float:
    """Loss at the end of service by the calendar damage of a parked pack, the mean of 24 hours of arrival.

    The temperature is integrated by Euler's method under the air of the hour, on top of what trips add.
    """
    parts = LAWS[law].mechanisms
    arrivals_s = np.arange(24) * 3600.0
    warm_up_s = 100 * 3600.0
    kelvin = np.full(24, 303.0)
    lost = 0.0
    for step in range(round((warm_up_s + hours * 3600.0) / STEP_S)):
        time_s = step * STEP_S - warm_up_s
        if step == round(warm_up_s / STEP_S):
            kelvin = kelvin + (arrival_k - 303.0)
        air_k = 303.0 + 6.0 * np.cos(2.0 * np.pi * (arrivals_s + time_s) / 86400.0)
        kelvin = kelvin + STEP_S * (air_k - kelvin) / 36000.0
        if time_s >= 0.0:
            for part, weight in zip(parts, aging.weights, strict=True):
                if part.mechanism is Mechanism.CALENDAR:
                    load = Load(kelvin, 0.0, USE.parked_charge)
                    lost += weight * STEP_S * float(np.mean(part.damage_rate_1_s(load)))
    return lost


@pytest.mark.parametrize("name", ["nca", "nmc111"])
def test_the_price_is_the_slope_of_the_loss_of_the_hours_parked(name: str) -> None:
    """Arrival 6 K above the pack's mean, four days: the law integrated over time, within 1 %."""
    aging = ParkedAging(LAWS[name], USE, 0.0)
    ends = (parked_loss(name, aging, kelvin, 96.0) for kelvin in (308.9, 309.1))
    below, above = ends
    price = float(aging.kelvin_price_1_k(np.array([309.0]))[0])
    assert price == pytest.approx((above - below) / 0.2, rel=0.01)


@pytest.mark.parametrize("name", LAWS)
def test_the_end_of_service_has_the_loss_of_equal_days(name: str) -> None:
    """In air of one temperature the weight is p u^(p-1) of eight years at that of the pack."""
    use = AgingSettings(parking_air_k=295.15, parking_air_swing_k=0.0)
    aging = ParkedAging(LAWS[name], use, 0.0)
    mean = 2.0 * use.daily_discharge / 24.0
    load = Load(298.15, mean, use.parked_charge, use.daily_discharge, mean, 0.1)
    for part, weight in zip(LAWS[name].mechanisms, aging.weights, strict=True):
        damage = 8.0 * 365.25 * 86400.0 * float(part.damage_rate_1_s(load))
        assert weight == pytest.approx(part.exponent * damage ** (part.exponent - 1.0))


def test_only_the_hours_that_count_count() -> None:
    """Between two temperatures the rate is all but linear: 10 h of a time constant of 10 h are 1 - 1/e."""
    whole = ParkedAging(LAWS["nca"], USE, 0.0)
    ten = ParkedAging(LAWS["nca"], AgingSettings(**{**vars(USE), "parked_h": 10.0}), 0.0)
    at = np.array([303.5])
    ratio = float(ten.kelvin_price_1_k(at)[0] / whole.kelvin_price_1_k(at)[0])
    assert ratio == pytest.approx(1.0 - np.exp(-1.0), rel=0.02)


def test_a_law_of_another_name_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"aging_law is 'nmc'.* allowed: one of paper, nca"):
        AgingSettings(aging_law="nmc")
