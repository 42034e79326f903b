"""Minutes at a fast charger: by hand where the temperature stays, an energy balance where it does not."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from studies.life.fast_charge import ChargingStopSettings, fast_charge

from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_resistance_ohm
from iptm_core.units import CELSIUS_ZERO_K

PAPER = load_parameters().values
STOP = ChargingStopSettings()


def kelvin(*celsius: float) -> Any:
    return np.array(celsius) + CELSIUS_ZERO_K


def pack(**cell: float) -> ModelParameters:
    return replace(PAPER, cell=replace(PAPER.cell, entropic_coefficient_v_k=0.0, **cell))


HEAVY = pack(heat_capacity_j_k=1e9)  # stays as warm as it arrives


def test_minutes_by_hand_where_the_cells_are_the_limit() -> None:
    """At 10 degC 0.8 1/h up to half, then falling linearly to 0.3 of it at 80 %."""
    by_hand_h = 0.4 / 0.8 + 0.3 / (0.7 * 0.8) * math.log(1.0 / 0.3)
    minutes = fast_charge(kelvin(10.0), STOP, HEAVY).minutes
    assert minutes == pytest.approx([60.0 * by_hand_h], rel=1e-4)


def test_current_by_hand_where_the_charger_is_the_limit() -> None:
    """(E + R I) I = 50 kW at the terminals, far below what cells of 30 degC take."""
    charge = fast_charge(kelvin(30.0), replace(STOP, charging_power_kw=50.0), HEAVY)
    ohm = cell_resistance_ohm(303.15, PAPER.aging.initial_capacity_loss, HEAVY.cell) * 96.0 / 38.0
    ampere = charge.c_rate_1_h[0, 0] * PAPER.cell.nominal_capacity_ah * 38.0
    assert (380.0 + ohm * ampere) * ampere == pytest.approx(50e3)


def test_the_loss_of_the_pack_warms_it() -> None:
    """Without air and limit of temperature, what is stored is what the current loses."""
    values = pack(heat_capacity_j_k=300.0)
    charge = fast_charge(kelvin(5.0), STOP, values, 1e-3)
    current_a = charge.c_rate_1_h * values.cell.nominal_capacity_ah
    ohm = cell_resistance_ohm(charge.temperature_k, values.aging.initial_capacity_loss, values.cell)
    lost_j = np.sum(current_a**2 * ohm * charge.step_s)
    assert charge.temperature_k[-1, 0] < values.limits.max_temperature_k
    stored_j = 300.0 * (charge.temperature_k[-1, 0] - kelvin(5.0)[0])
    assert stored_j == pytest.approx(lost_j, rel=2e-3)


def test_the_usual_step_is_within_three_seconds_of_a_tenth_of_it() -> None:
    arrivals = kelvin(0.0, 5.0, 15.0, 30.0)
    minutes = fast_charge(arrivals, STOP, PAPER).minutes
    finer = fast_charge(arrivals, STOP, PAPER, 5e-4).minutes
    assert np.max(np.abs(minutes - finer)) < 0.05


def test_warmer_packs_charge_no_slower_up_to_the_limit() -> None:
    minutes = fast_charge(kelvin(*np.arange(-20.0, 40.5, 0.5)), STOP, PAPER).minutes
    assert np.all(np.diff(minutes) < 1e-6)


def test_the_upper_limit_is_held_and_a_hotter_pack_is_no_cooler_for_it() -> None:
    charge = fast_charge(kelvin(20.0, 45.0), STOP, PAPER)
    assert charge.temperature_k[:, 0].max() <= PAPER.limits.max_temperature_k
    assert np.all(charge.temperature_k[:, 1] == kelvin(45.0)[0])


def test_a_heater_on_the_charger_runs_as_long_as_the_cells_are_the_limit() -> None:
    heated = fast_charge(kelvin(0.0, 25.0), replace(STOP, charging_heater_kw=5.0), PAPER)
    own = fast_charge(kelvin(0.0, 25.0), STOP, PAPER)
    assert np.all(own.heater_j == 0.0)
    assert heated.minutes[0] < own.minutes[0] - 30.0
    assert heated.heater_j[0] <= 5000.0 * 60.0 * heated.minutes[0]
    assert heated.heater_j[0] > 5.0 * heated.heater_j[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"charging_minute_kwh": -0.1}, "charging_minute_kwh is -0.1"),
        ({"charging_power_kw": 0.0}, "charging_power_kw is 0"),
        ({"fast_charge_to": 1.2}, "fast_charge_to is 1.2"),
        ({"fast_charge_from": 0.8}, "fast_charge_from is 0.8; allowed: below fast_charge_to, 0.8"),
    ],
)
def test_bad_settings_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        ChargingStopSettings(**changes)
