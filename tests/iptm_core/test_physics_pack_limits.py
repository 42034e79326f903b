"""What a pack takes and gives: by hand, at the limits of voltage, current and charge."""

from __future__ import annotations

import math

import pytest

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, pack_capacity_ah
from iptm_core.physics.pack_limits import (
    VOLTAGE_MARGIN_V,
    current_limits_a,
    largest_within,
    least_traction_power_w,
    power_limits,
)
from iptm_core.physics.power_thermal import CellPair
from iptm_core.physics.powertrain import pack_current_a, pack_resistance_ohm, terminal_power_w
from iptm_core.units import CELSIUS_ZERO_K

I3 = load_parameters("bmw_i3").values
LOSS = 1e-3


def _cells(celsius: float) -> CellPair:
    kelvin = celsius + CELSIUS_ZERO_K
    return CellPair(kelvin, kelvin, LOSS, LOSS)


def _currents(celsius: float, charge: float, values: ModelParameters = I3) -> tuple[float, float]:
    return current_limits_a(_cells(celsius), charge, at_charge(values, charge))


def test_currents_are_those_recorded() -> None:
    """60 A at 1 degC, 140 A from 10 degC on, 62 A near 90 % charge (docs: the recorded trips)."""
    assert _currents(0.0, 0.5)[0] == pytest.approx(-60.0, abs=1.0)
    assert _currents(10.0, 0.5)[0] == pytest.approx(-140.0, abs=1.0)
    assert _currents(25.0, 0.9)[0] == pytest.approx(-63.0, abs=1.0)
    assert _currents(10.0, 0.5)[1] == pytest.approx(395.0, abs=1.0)


def test_nothing_is_charged_full_or_frozen_and_nothing_drawn_empty() -> None:
    assert _currents(25.0, 1.0)[0] == 0.0
    assert _currents(-10.0, 0.5)[0] == 0.0
    assert _currents(-30.0, 0.5)[0] == 0.0
    assert _currents(25.0, 0.0)[1] == 0.0
    assert power_limits(_cells(25.0), 1.0, I3, 1.0).charge_w == 0.0
    assert power_limits(_cells(25.0), 0.0, I3, 1.0).discharge_w == 0.0


def test_the_colder_cell_counts() -> None:
    cold, warm = _cells(0.0), _cells(25.0)
    mixed = CellPair(warm.cell_1_temperature_k, cold.cell_n_temperature_k, LOSS, LOSS)
    values = at_charge(I3, 0.5)
    assert current_limits_a(mixed, 0.5, values)[0] == current_limits_a(cold, 0.5, values)[0]


@pytest.mark.parametrize("celsius", [-20.0, 0.0, 25.0, 45.0])
@pytest.mark.parametrize("charge", [0.02, 0.5, 0.95])
def test_cells_at_the_limits_of_power_keep_their_limits_of_voltage(
    celsius: float, charge: float
) -> None:
    """A pack with a high resistance, so that the voltage binds and not the current."""
    values = load_parameters("bmw_i3", {"cell.nominal_resistance_ohm": 0.01}).values
    cells = _cells(celsius)
    limits = power_limits(cells, charge, values, 1.0)
    now = at_charge(values, charge)
    kelvin, pack = cells.cell_1_temperature_k, now.pack
    growth = math.exp(-now.cell.resistance_exponent_1_k * (kelvin - now.cell.nominal_temperature_k))
    aged = now.cell.resistance_aging_factor
    aged *= (1.0 - LOSS) ** -now.cell.resistance_aging_exponent
    ohm = now.cell.nominal_resistance_ohm * growth * aged
    for power_w in (-limits.charge_w, limits.discharge_w):
        at = pack_resistance_ohm(ohm, pack), kelvin, now.cell, pack
        current = pack_current_a(power_w, *at)
        source = pack.open_circuit_voltage_v / pack.cells_in_series
        source -= now.cell.entropic_coefficient_v_k * kelvin
        volts = source - ohm * current / pack.parallel
        assert 2.8 + 0.5 * VOLTAGE_MARGIN_V <= volts <= 4.2 - 0.5 * VOLTAGE_MARGIN_V
        assert terminal_power_w(current, *at) == pytest.approx(power_w, abs=1e-3)


def test_a_pack_without_limits_may_be_filled_and_emptied_within_the_interval() -> None:
    paper = load_parameters().values
    assert not paper.pack_limits.limited
    content_as = 3600.0 * pack_capacity_ah(paper, LOSS)
    taken_w = power_limits(_cells(25.0), 0.999, paper, 10.0).charge_w
    current_a = 0.001 * content_as / 10.0
    # At the terminals the ohmic loss comes on top: 0.15 ohm of the pack, aged by the factor mu.
    entropic_v = 96 * paper.cell.entropic_coefficient_v_k * 298.15
    source_w = current_a * (paper.pack.open_circuit_voltage_v - entropic_v)
    assert source_w < taken_w < 1.1 * source_w
    assert power_limits(_cells(25.0), 1.0, paper, 10.0).charge_w == 0.0


def test_auxiliaries_use_what_the_motor_feeds_back_first() -> None:
    """(0 + 640 W / eta) / (eta zeta) with eta the efficiency of the pack."""
    eta = I3.pack.battery_efficiency
    expected = (I3.cooling.auxiliary_power_w / eta) / (eta * I3.powertrain.regenerative_efficiency)
    assert least_traction_power_w(0.0, 0.0, I3) == pytest.approx(-expected)


def test_an_unknown_charge_is_that_of_the_start() -> None:
    known = power_limits(_cells(25.0), I3.charge.initial_charge, I3, 1.0)
    assert power_limits(_cells(25.0), math.nan, I3, 1.0) == known


@pytest.mark.parametrize("power", [1.0, 3.0])
@pytest.mark.parametrize("limit", [-0.6, -0.5, 0.0, 0.3, 1.7, 2.0, 2.1])
def test_the_largest_argument_within_a_limit_is_that_of_bisection(
    limit: float, power: float
) -> None:
    """To the last bit, in a third of the evaluations."""

    def excess(value: float) -> float:
        calls.append(value)
        return math.copysign(abs(value - limit) ** power, value - limit) + max(value - 1.0, 0.0)

    calls: list[float] = []
    low, high = -0.5, 2.0
    found = largest_within(excess, low, high)
    assert len(calls) < 60
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) <= 0.0 else (low, middle)
    assert found == (2.0 if excess(2.0) <= 0.0 else low)
