"""State of charge and voltage, and what depends on them: values by hand, limits, and the same in symbols."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.physics.car_following import maximum_gap_m
from iptm_core.physics.cell import cell_resistance_ohm, heat_from_air_w
from iptm_core.physics.charge import (
    ChargeTable,
    ChargeTransfer,
    ResistanceLaw,
    ambient_temperature_rate_k_s,
    at_charge,
    charge_after,
    charge_rate_1_s,
    nominal_charge_parameters,
    pack_capacity_ah,
)
from iptm_core.physics.power_thermal import electric_traction_power_w

TABLE = ChargeTable((0.1, 0.5, 0.9), (3.3, 3.7, 4.1))
FLAT = ChargeTable((0.0, 1.0), (1.0, 1.0))


def test_table_is_linear_between_nodes_and_constant_outside() -> None:
    charges = np.array([0.0, 0.1, 0.3, 0.5, 0.8, 1.0])
    expected = np.interp(charges, TABLE.charges, TABLE.values)
    np.testing.assert_allclose(TABLE.at(charges), expected, atol=1e-12)
    symbol = ca.SX.sym("charge")
    function = ca.Function("table", [symbol], [TABLE.at(symbol)])
    np.testing.assert_allclose([float(function(c)) for c in charges], expected, atol=1e-12)


def test_resistance_law_has_an_offset_and_an_exponential() -> None:
    offset = ChargeTable((0.0, 1.0), (0.02, 0.02))
    exponential = ChargeTable((0.0, 1.0), (0.02, 0.01))
    law = ResistanceLaw(offset, exponential, 0.05, 298.15)
    assert law.ohm(298.15, 1.0) == pytest.approx(0.03)
    assert law.ohm(273.15, 0.5) == pytest.approx(0.02 + 0.015 * np.exp(1.25))


def test_charge_transfer_is_ohmic_for_small_and_logarithmic_for_large_currents() -> None:
    transfer = ChargeTransfer(FLAT, 0.5, 0.06, 298.15)
    thermal_v = 8.314462618 * 298.15 / 96485.33212
    small = transfer.voltage_v(1e-4, 298.15, 0.5)
    assert small == pytest.approx(thermal_v * 1e-4 / 0.5, rel=1e-6)
    decade = transfer.voltage_v(500.0, 298.15, 0.5) - transfer.voltage_v(50.0, 298.15, 0.5)
    assert decade == pytest.approx(2.0 * thermal_v * np.log(10.0), rel=1e-4)
    assert transfer.voltage_v(-3.0, 280.0, 0.5) == -transfer.voltage_v(3.0, 280.0, 0.5)
    assert transfer.voltage_v(1.0, 263.15, 0.5) > transfer.voltage_v(1.0, 298.15, 0.5)


def test_rates_by_hand() -> None:
    assert charge_rate_1_s(36.0, 10.0) == pytest.approx(-0.001)
    rate = ambient_temperature_rate_k_s(500.0, 300.0, 290.0, 100_000.0, 20.0)
    assert rate == pytest.approx((500.0 - 200.0) / 100_000.0)


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
