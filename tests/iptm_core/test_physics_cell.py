"""A cell: resistance, heat, temperature, loss of capacity, and what depends on the state of charge."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.physics.car_following import maximum_gap_m
from iptm_core.physics.cell import (
    ChargeTable,
    at_charge,
    capacity_loss_rate_1_s,
    cell_heat_w,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
    charge_after,
    charge_rate_1_s,
    heat_from_air_w,
    nominal_charge_parameters,
    pack_capacity_ah,
)
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.physics.powertrain import pack_current_a, pack_resistance_ohm

VALUES = load_parameters().values
CELL, COOLING, PACK, AGING = VALUES.cell, VALUES.cooling, VALUES.pack, VALUES.aging
GAS = 8.314462618
TEMPERATURES = st.floats(298.15, 313.15)
CURRENTS = st.floats(0.01, 15.0)


def test_temperature_by_hand() -> None:
    # 20 K above nominal: 0.060 (1 - 0.008 * 20) = 0.0504 ohm
    assert cell_resistance_ohm(308.15, 0.0, CELL) == pytest.approx(0.0504, rel=1e-12)
    assert cell_resistance_ohm(278.15, 0.0, CELL) == pytest.approx(0.0648, rel=1e-12)


def test_ageing_by_hand() -> None:
    # Q_nom / Q_bc = 1 / 0.8 = 1.25; 1.1 * 1.25^2 = 1.71875
    aged = replace(CELL, resistance_aging_factor=1.1, resistance_aging_exponent=2.0)
    assert cell_resistance_ohm(288.15, 0.2, aged) == pytest.approx(0.060 * 1.71875, rel=1e-12)
    assert cell_resistance_ohm(308.15, 0.2, aged) == pytest.approx(0.0504 * 1.71875, rel=1e-12)


def test_heat_by_hand() -> None:
    # 3^2 * 0.05 + 3 * 300 * 4e-4 = 0.45 + 0.36 W; charging 0.45 - 0.36 W
    assert cell_heat_w(3.0, 0.05, 300.0, CELL) == pytest.approx(0.81, rel=1e-12)
    assert cell_heat_w(-3.0, 0.05, 300.0, CELL) == pytest.approx(0.09, rel=1e-12)
    assert cell_heat_w(0.0, 0.05, 300.0, CELL) == 0.0


def test_rate_by_hand() -> None:
    # (0.81 + 0.4901 (298 - 300)) / 45 = (0.81 - 0.9802) / 45
    assert cell_temperature_rate_k_s(0.81, 300.0, 298.0, CELL, COOLING) == pytest.approx(
        -0.1702 / 45.0, rel=1e-11
    )
    assert cell_temperature_rate_k_s(0.0, 300.0, 300.0, CELL, COOLING) == 0.0
    # without coolant contact in temperature, 45 W warm a cell by 1 K/s
    assert cell_temperature_rate_k_s(45.0, 300.0, 300.0, CELL, COOLING) == 1.0


@given(
    current=st.floats(-5.0, 10.0),
    resistance=st.floats(0.02, 0.08),
    temperature=st.floats(298.15, 313.15),
)
def test_the_heat_of_all_cells_is_what_the_pack_loses(
    current: float, resistance: float, temperature: float
) -> None:
    """96 x 38 cell heats close the pack's balance E I = P_b + heat."""
    heat = 96 * 38 * cell_heat_w(current, resistance, temperature, CELL)
    pack_current = 38 * current
    terminal = 380.0 * pack_current - heat
    found = pack_current_a(terminal, pack_resistance_ohm(resistance, PACK), temperature, CELL, PACK)
    assert found == pytest.approx(pack_current, rel=1e-12, abs=1e-10)


def rate(current: float, temperature: float, loss: float, width: float = 0.0) -> float:
    value: float = capacity_loss_rate_1_s(
        current, temperature, loss, AGING, CELL, current_smoothing_a=width
    )
    return value


def closed_form_loss(throughput_ah: float, temperature: float, c_rate: float) -> float:
    """Eq. (11) with the printed numbers."""
    exponent = (-15162.0 + 1516.0 * c_rate) / (GAS * temperature)
    return float(0.0032 * math.exp(exponent) * throughput_ah**0.824)


def throughput_ah(loss: float, temperature: float, c_rate: float) -> float:
    """The throughput at which eq. (11) reaches a loss."""
    return float((loss / closed_form_loss(1.0, temperature, c_rate)) ** (1.0 / 0.824))


def test_the_rate_by_hand() -> None:
    """Eq. (12) with 5.019 A (1C), 300 K and the initial loss of 0.001, factor by factor."""
    z = 0.824
    expected = (
        (5.019 / 3600.0)
        * z
        * 0.0032 ** (1.0 / z)
        * math.exp((-15162.0 + 1516.0) / (z * GAS * 300.0))
        * 0.001 ** (1.0 - 1.0 / z)
    )
    assert rate(5.019, 300.0, 0.001) == pytest.approx(expected, rel=1e-12)
    assert rate(-5.019, 300.0, 0.001) == rate(5.019, 300.0, 0.001)
    assert rate(0.0, 300.0, 0.001) == 0.0


def test_a_signed_rate_lowers_the_loss_while_charging_only() -> None:
    """At 1C and 300 K the exponent changes by 2 B / (z R T), with half the rate counted by half of that."""
    gap = 2.0 * 1516.0 / (0.824 * GAS * 300.0)
    for factor, share in ((-1.0, 1.0), (0.0, 0.5)):
        signed = replace(AGING, charging_rate_factor=factor)
        charging = capacity_loss_rate_1_s(-5.019, 300.0, 0.001, signed, CELL)
        assert charging == pytest.approx(rate(5.019, 300.0, 0.001) * math.exp(-share * gap))
        assert capacity_loss_rate_1_s(5.019, 300.0, 0.001, signed, CELL) == pytest.approx(
            rate(5.019, 300.0, 0.001), rel=1e-15
        )


@given(current=CURRENTS, temperature=TEMPERATURES, loss=st.floats(1e-4, 0.2))
def test_the_rate_is_the_slope_of_the_closed_form(
    current: float, temperature: float, loss: float
) -> None:
    """d Q / d A_h = z Q / A_h at the throughput that led to this loss."""
    c_rate = current / 5.019
    throughput = throughput_ah(loss, temperature, c_rate)
    slope_1_ah = 0.824 * loss / throughput
    assert rate(current, temperature, loss) == pytest.approx(
        slope_1_ah * current / 3600.0, rel=1e-10
    )


@given(current=st.floats(-15.0, 15.0), temperature=TEMPERATURES, loss=st.floats(1e-4, 0.3))
def test_ageing_never_reverses_and_slows_with_age(
    current: float, temperature: float, loss: float
) -> None:
    here = rate(current, temperature, loss)
    assert here >= 0.0
    assert rate(current, temperature, 1.01 * loss) <= here
    assert rate(current, temperature + 1.0, loss) >= here


TABLE = ChargeTable((0.1, 0.5, 0.9), (3.3, 3.7, 4.1))


def test_table_is_linear_between_nodes_and_constant_outside() -> None:
    charges = np.array([0.0, 0.1, 0.3, 0.5, 0.8, 1.0])
    expected = np.interp(charges, TABLE.charges, TABLE.values)
    np.testing.assert_allclose(TABLE.at(charges), expected, atol=1e-12)
    symbol = ca.SX.sym("charge")
    function = ca.Function("table", [symbol], [TABLE.at(symbol)])
    np.testing.assert_allclose([float(function(c)) for c in charges], expected, atol=1e-12)


def test_rates_by_hand() -> None:
    assert charge_rate_1_s(36.0, 10.0) == pytest.approx(-0.001)


PAPER = load_parameters().values
I3 = load_parameters("bmw_i3").values
SHARES = {f"charge.voltage_share_{percent}": 0.8 + 0.004 * percent for percent in range(0, 101, 10)}


def test_the_papers_pack_does_not_depend_on_its_charge() -> None:
    assert at_charge(PAPER, 0.2) is PAPER
    assert nominal_charge_parameters(PAPER) is PAPER


def test_voltage_and_resistance_by_hand() -> None:
    values = load_parameters(
        overrides={**SHARES, "charge.resistance_slope": 0.5, "charge.initial_charge": 0.75}
    ).values
    at = nominal_charge_parameters(values)
    assert at.pack.open_circuit_voltage_v == pytest.approx(380.0 * 1.1)
    assert at.cell.nominal_resistance_ohm == pytest.approx(0.060 * 1.125)
    assert at_charge(values, -0.1).pack.open_circuit_voltage_v == pytest.approx(380.0 * 0.8)
    symbol = ca.SX.sym("s")
    function = ca.Function("v", [symbol], [at_charge(values, symbol).pack.open_circuit_voltage_v])
    assert float(function(0.33)) == pytest.approx(380.0 * (0.8 + 0.4 * 0.33))


def test_charge_balance_by_hand() -> None:
    """One hour at 10 A out of a pack of 38 cells of 5.019 Ah that has lost 1 %."""
    capacity_ah = pack_capacity_ah(PAPER, 0.01)
    assert capacity_ah == pytest.approx(188.81478)
    assert charge_after(0.9, 36_000.0, capacity_ah) == pytest.approx(0.9 - 10.0 / 188.81478)
    assert charge_after(0.9, -36_000.0, capacity_ah) > 0.9


def test_exponential_resistance_by_hand() -> None:
    cell = replace(
        PAPER.cell,
        nominal_resistance_ohm=0.002,
        nominal_temperature_k=298.15,
        resistance_exponent_1_k=0.05,
        resistance_offset_share=0.25,
        resistance_aging_exponent=0.0,
    )
    assert cell_resistance_ohm(298.15, 0.0, cell) == pytest.approx(0.002)
    assert cell_resistance_ohm(278.15, 0.0, cell) == pytest.approx(0.0005 + 0.0015 * np.e)


def test_the_air_warms_a_cold_pack_and_cools_a_warm_one() -> None:
    """26.2353 W/K of the i3's pack are shared by 96 cells."""
    ambient_k = I3.environment.ambient_temperature_k
    assert heat_from_air_w(ambient_k - 10.0, I3) == pytest.approx(2.7328, rel=1e-4)
    assert heat_from_air_w(ambient_k + 10.0, I3) == pytest.approx(-2.7328, rel=1e-4)
    assert heat_from_air_w(250.0, PAPER) == 0.0


def test_what_the_motor_recovers_is_limited() -> None:
    """At 20 m/s the i3's motor turns at 569 rad/s: 84 N m, sigma T^2 and the drag loss remain."""
    power_w = electric_traction_power_w(20.0, -2.0, 0.0, I3)
    turning = 20.0 * 9.665 / 0.3396
    expected_w = -84.0 * turning + 0.122982 * 84.0**2 + 0.00121773 * turning**2
    assert power_w == pytest.approx(expected_w, rel=1e-9)
    # Friction brakes alone below 3 km/h, and at 40 m/s the power counts.
    crawling = electric_traction_power_w(0.7, -2.0, 0.0, I3)
    assert crawling == pytest.approx(0.00121773 * (0.7 * 9.665 / 0.3396) ** 2)
    fast = electric_traction_power_w(40.0, -2.0, 0.0, I3)
    assert fast > -I3.regeneration.power_w


def test_largest_gap_by_hand() -> None:
    gap = replace(PAPER.gap, max_time_headway_s=3.0)
    assert maximum_gap_m(2.0, gap) == gap.initial_gap_m
    assert maximum_gap_m(20.0, gap) == 60.0
    assert maximum_gap_m(50.0, gap) == gap.max_gap_m
    assert maximum_gap_m(2.0, PAPER.gap) == 120.0
