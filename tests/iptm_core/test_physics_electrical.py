"""Terminal power and pack current, with every watt accounted for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import PowerLimitError
from iptm_core.parameters import load_parameters
from iptm_core.physics.powertrain import (
    battery_power_w,
    cell_current_a,
    effective_source_voltage_v,
    extended_pack_current_a,
    pack_current_a,
    pack_resistance_ohm,
)

VALUES = load_parameters().values
TRACTION = st.floats(-60e3, 90e3)
COMPRESSOR = st.floats(0.0, 4500.0)


def by_the_printed_cases(traction: float, compressor: float, efficiency: float) -> float:
    if traction >= 0.0:
        return (traction + compressor + 200.0) / efficiency
    return efficiency * 0.3 * traction + (compressor + 200.0) / efficiency


def test_by_hand() -> None:
    def at_terminals(traction: float, efficiency: float) -> float:
        pack = replace(VALUES.pack, battery_efficiency=efficiency)
        return float(battery_power_w(traction, 800.0, 200.0, pack, VALUES.powertrain))

    assert at_terminals(9000.0, 1.0) == 10000.0
    assert at_terminals(-9000.0, 1.0) == pytest.approx(-1700.0, rel=1e-12)
    assert at_terminals(8500.0, 0.95) == pytest.approx(10000.0, rel=1e-12)
    # 0.95 * 0.3 * -10000 + 1000 / 0.95 = -2850 + 1052.63
    assert at_terminals(-10000.0, 0.95) == pytest.approx(-1797.368421, rel=1e-9)
    assert at_terminals(0.0, 1.0) == 1000.0


@pytest.mark.parametrize("efficiency", [1.0, 0.95, 0.5])
@given(traction=TRACTION, compressor=COMPRESSOR)
def test_one_convex_kink_is_the_two_printed_cases(
    efficiency: float, traction: float, compressor: float
) -> None:
    pack = replace(VALUES.pack, battery_efficiency=efficiency)
    power = battery_power_w(traction, compressor, 200.0, pack, VALUES.powertrain)
    assert power == pytest.approx(
        by_the_printed_cases(traction, compressor, efficiency), rel=1e-13, abs=1e-9
    )


CELL, PACK = VALUES.cell, VALUES.pack
ISOTHERMAL_OCV = replace(CELL, entropic_coefficient_v_k=0.0)
POWERS = st.floats(-60e3, 100e3)
TEMPERATURES = st.floats(298.15, 313.15)
RESISTANCES = st.floats(0.05, 0.2)


def test_layout_by_hand() -> None:
    # 96 cells in series, 38 strings: 0.0608 ohm * 96 / 38 = 0.1536 ohm; 96 * 4e-4 = 0.0384 V/K
    assert PACK.cells_in_series == 96
    assert pack_resistance_ohm(0.0608, PACK) == pytest.approx(0.1536, rel=1e-12)
    # 380 V - 300 K * 0.0384 V/K = 368.48 V
    assert effective_source_voltage_v(300.0, CELL, PACK) == pytest.approx(368.48, rel=1e-12)
    assert cell_current_a(76.0, PACK) == 2.0


def test_power_and_current_by_hand() -> None:
    # 380 V * 100 A - 0.2 ohm * 100^2 A^2 = 36 kW, and back; -100 A charge with -40 kW
    assert pack_current_a(36e3, 0.2, 300.0, ISOTHERMAL_OCV, PACK) == pytest.approx(100.0, rel=1e-12)
    assert pack_current_a(-40e3, 0.2, 300.0, ISOTHERMAL_OCV, PACK) == pytest.approx(
        -100.0, rel=1e-12
    )
    assert pack_current_a(0.0, 0.2, 300.0, CELL, PACK) == 0.0


@given(power=POWERS, temperature=TEMPERATURES, resistance=RESISTANCES)
def test_chemical_power_is_terminal_power_plus_heat(
    power: float, temperature: float, resistance: float
) -> None:
    """E I = P_b + I^2 R + I T dV/dT to round-off, discharging and charging."""
    current = pack_current_a(power, resistance, temperature, CELL, PACK)
    ohmic = current**2 * resistance
    entropic = current * temperature * 96 * 4e-4
    chemical = 380.0 * current
    assert power + ohmic + entropic == pytest.approx(chemical, rel=1e-13, abs=1e-9)
    assert math.copysign(1.0, current) == math.copysign(1.0, power) or current == 0.0


@given(power=POWERS, temperature=TEMPERATURES, resistance=RESISTANCES)
def test_of_the_two_roots_the_small_current_is_taken(
    power: float, temperature: float, resistance: float
) -> None:
    voltage = effective_source_voltage_v(temperature, CELL, PACK)
    current = pack_current_a(power, resistance, temperature, CELL, PACK)
    assert current <= voltage / (2.0 * resistance)


@pytest.mark.parametrize("power", [1e-6, -1e-6, 1e-12])
def test_small_powers_lose_no_digits(power: float) -> None:
    """The printed root (E - sqrt(E^2 - 4 R P)) / (2 R) would cancel to a few digits here."""
    current = pack_current_a(power, 0.15, 300.0, CELL, PACK)
    first_order = power / 368.48
    assert current == pytest.approx(first_order, rel=1e-12)


def test_more_than_the_pack_can_deliver_is_refused_with_the_limit() -> None:
    # 380^2 / (4 * 0.2) = 180500 W
    limit = 380.0**2 / (4.0 * 0.2)
    assert pack_current_a(limit, 0.2, 300.0, ISOTHERMAL_OCV, PACK) == pytest.approx(
        380.0 / 0.4, rel=1e-6
    )
    with pytest.raises(PowerLimitError, match=r"180600\.0 W .* at most 180500\.0 W at 300\.00 K"):
        pack_current_a(limit + 100.0, 0.2, 300.0, ISOTHERMAL_OCV, PACK)
    with np.errstate(invalid="ignore"):
        both = pack_current_a(np.array([1e3, 2.0 * limit]), 0.2, 300.0, ISOTHERMAL_OCV, PACK)
    assert np.isnan(both).tolist() == [False, True]


@pytest.mark.parametrize("margin", [0.02, 0.1])
def test_an_optimiser_finds_a_current_for_any_power(margin: float) -> None:
    """Exact short of the largest power, by sqrt(margin) / 2 too small at it, convex and rising all along."""
    limit = 380.0**2 / (4.0 * 0.2)
    arguments = (0.2, 300.0, ISOTHERMAL_OCV, PACK)
    within = np.linspace(-3.0, 1.0 - margin, 200) * limit
    np.testing.assert_array_equal(
        extended_pack_current_a(within, *arguments, margin), pack_current_a(within, *arguments)
    )
    between = np.linspace(1.0 - margin, 1.0, 50) * limit
    share = extended_pack_current_a(between, *arguments, margin) / pack_current_a(
        between, *arguments
    )
    assert np.all(np.diff(share) < 0.0)
    assert share[-1] == pytest.approx(1.0 - 0.5 * math.sqrt(margin), rel=1e-6)
    power = np.linspace(-1.0, 4.0, 2001) * limit
    slope = np.diff(extended_pack_current_a(power, *arguments, margin)) / np.diff(power)
    assert slope[0] > 0.0
    assert np.all(np.diff(slope) > -1e-9 * slope[-1])
    # The steepest it gets: 1 / (380 V sqrt(margin)).
    assert slope[-1] == pytest.approx(1.0 / (380.0 * math.sqrt(margin)), rel=1e-6)
