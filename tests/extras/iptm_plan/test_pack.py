"""A step of a parked pack, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.extras.iptm_plan.scenes import CAR, CHARGER_W, PACK, PRICE, pack_with_heater, trip

from iptm_core.aging_laws.law import Load
from iptm_plan.pack import PlannedStep

WARM_K, STEP_S = 308.15, 900.0
CAPACITY_J_K = 16 * 6 * 38 * 45.0


def test_a_parked_pack_approaches_the_air_with_ten_hours() -> None:
    stood = PACK.stand(0.5, WARM_K, 0.0, PlannedStep(), STEP_S)
    assert stood.kept == pytest.approx(math.exp(-0.25 / 10.0))
    assert (stood.gained, stood.grid_j, stood.warmed_k) == (0.0, 0.0, 0.0)


def test_a_fan_takes_its_power_from_the_pack_without_a_plug() -> None:
    blown = PACK.stand(0.5, WARM_K, 0.0, PlannedStep(fan=1.0), STEP_S)
    assert blown.gained == pytest.approx(-80.0 * 900.0 / (380.0 * 5.019 * 38 * 3600.0))
    assert blown.kept == pytest.approx(math.exp(-0.025 - 900.0 * 100.0 / CAPACITY_J_K))
    plugged = PACK.stand(0.5, WARM_K, CHARGER_W, PlannedStep(fan=1.0), STEP_S)
    assert (plugged.gained, plugged.grid_j) == (0.0, pytest.approx(80.0 * 900.0))


def test_charging_by_hand() -> None:
    """P = I (U + R I) with U = 380 V - 96 * 0.4 mV/K * T; the loss heats the pack."""
    stood = PACK.stand(0.5, WARM_K, CHARGER_W, PlannedStep(1.0), STEP_S)
    volt = 380.0 - 96 * 4e-4 * WARM_K
    ohm = (
        96 / 38 * 0.06 * (1.0 - 0.008 * (WARM_K - 288.15)) / (1.0 - CAR.aging.initial_capacity_loss)
    )
    ampere = (-volt + math.sqrt(volt**2 + 4.0 * ohm * 0.92 * CHARGER_W)) / (2.0 * ohm)
    assert stood.gained == pytest.approx(0.25 * ampere / (5.019 * 38), rel=1e-9)
    assert stood.grid_j == pytest.approx(CHARGER_W * STEP_S)
    heat_w = ampere**2 * ohm - ampere * 96 * 4e-4 * WARM_K
    assert stood.warmed_k == pytest.approx(heat_w * STEP_S / CAPACITY_J_K, rel=1e-9)


def test_a_full_pack_takes_no_more() -> None:
    stood = PACK.stand(0.99, WARM_K, CHARGER_W, PlannedStep(1.0), STEP_S)
    assert stood.gained == pytest.approx(0.01)
    assert stood.grid_j < 0.5 * CHARGER_W * STEP_S


def test_chiller_and_heater_move_heat_and_leave_the_rest_to_charging() -> None:
    cooled = PACK.stand(0.5, WARM_K, CHARGER_W, PlannedStep(0.0, 500.0), STEP_S)
    assert cooled.warmed_k == pytest.approx(-2.4 * 500.0 * STEP_S / CAPACITY_J_K)
    heater = pack_with_heater(5000.0)
    heated = heater.stand(0.5, 268.15, CHARGER_W, PlannedStep(1.0, -5000.0), STEP_S)
    assert heated.grid_j == pytest.approx(CHARGER_W * STEP_S)
    assert (
        heated.c_rate_1_h
        < 0.4 * PACK.stand(0.5, 268.15, CHARGER_W, PlannedStep(1.0), STEP_S).c_rate_1_h
    )


def test_the_chiller_stops_at_the_lower_limit() -> None:
    stood = PACK.stand(0.5, 298.15 + 1.0, CHARGER_W, PlannedStep(0.0, 1000.0), STEP_S)
    assert stood.warmed_k == pytest.approx(-1.0)
    assert stood.thermal_j == pytest.approx(CAPACITY_J_K / 2.4)


def test_cold_cells_take_less_where_the_car_has_limits() -> None:
    """Plating: no charging below -10 degC, by the rates of the parameter set."""
    limits = {
        f"pack_limits.charge_rate_{node}_1_h": rate
        for node, rate in (("minus_20", 0.0), ("minus_10", 0.0), ("0", 0.04))
    }
    pack = pack_with_heater(5000.0, **limits)
    rates = [
        float(pack.stand(0.5, kelvin, CHARGER_W, PlannedStep(1.0), STEP_S).c_rate_1_h)
        for kelvin in (262.15, 268.15, 293.15)
    ]
    assert rates[0] == 0.0
    assert rates[1] == pytest.approx(0.02)
    assert rates[2] > 0.09


def test_the_price_of_ageing_is_the_marginal_loss_times_the_price_of_the_pack() -> None:
    """EUR per second: 130 EUR/kWh of 72.5 kWh over a fifth of the capacity, p u^(p - 1) du/dt."""
    part, weight = PRICE.law.mechanisms[0], PRICE.weights[0]
    eur = 130.0 * 72.47436 / 0.2
    by_hand = eur * weight * part.damage_rate_1_s(Load(WARM_K, 0.0, 0.7))
    assert float(PRICE.calendar_eur_s(0.7, WARM_K)) == pytest.approx(by_hand)
    service_s = 8 * 365.25 * 86400.0
    yearly = eur * part.damage_rate_1_s(Load(301.15, 0.0, 0.775)) * service_s
    u_f = service_s * part.damage_rate_1_s(Load(301.15, 0.0, 0.775))
    assert float(PRICE.calendar_eur_s(0.775, 301.15)) * service_s == pytest.approx(
        0.512 * yearly * u_f**-0.488, rel=0.05
    )


def test_a_trip_of_known_energy_draws_it_and_heats_the_pack() -> None:
    driven = PACK.driven(trip(7.247436, 60.0), 298.15)
    assert driven.drawn[-1] == pytest.approx(0.1)
    ampere = 0.1 * 5.019
    heat_w = 2.25 * ampere**2 * 0.06 * 0.92 + ampere * 4e-4 * 298.15
    assert driven.end_k - 298.15 == pytest.approx(heat_w * 3600.0 / 45.0, rel=0.05)
    assert np.all(np.diff(driven.drawn) > 0.0)


def test_trips_in_a_row_go_on_where_the_last_one_ended() -> None:
    first = PACK.driven(trip(), 298.15)
    second = PACK.driven(trip(), first.end_k)
    both = PACK.driven(trip(), 298.15, 2)
    assert both.end_k == second.end_k
    assert both.drawn[-1] == pytest.approx(2.0 * first.drawn[-1])
    assert both.durations_s.sum() == pytest.approx(3600.0)


def test_a_trip_costs_more_from_a_warm_and_full_pack() -> None:
    cost = {
        (kelvin, charge): float(PACK.driven_eur(PACK.driven(trip(), kelvin), charge, PRICE))
        for kelvin in (293.15, 308.15)
        for charge in (0.4, 0.9)
    }
    assert cost[308.15, 0.9] > cost[308.15, 0.4] > cost[293.15, 0.4] > 0.0
