"""Voltage, charge transfer and temperature of a cell: values by hand, limits, and the same in symbols."""

import casadi as ca
import numpy as np
import pytest

from iptm_core.physics.charge import (
    ChargeTable,
    ChargeTransfer,
    ResistanceLaw,
    ambient_temperature_rate_k_s,
    charge_rate_1_s,
    relaxation_rate_a_s,
)

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
    assert relaxation_rate_a_s(2.0, 12.0, 100.0) == pytest.approx(0.1)
    assert charge_rate_1_s(36.0, 10.0) == pytest.approx(-0.001)
    rate = ambient_temperature_rate_k_s(500.0, 300.0, 290.0, 100_000.0, 20.0)
    assert rate == pytest.approx((500.0 - 200.0) / 100_000.0)
