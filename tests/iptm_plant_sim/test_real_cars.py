"""The plant with the laws of real cars: charge and energy balance, limits of regeneration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.physics.cell import at_charge
from iptm_core.settings import ThermalModel
from iptm_core.state import Command, FloatArray
from iptm_plant_sim.plant import Plant

I3 = load_parameters("bmw_i3").values


def level(positions_m: FloatArray) -> FloatArray:
    return np.zeros_like(positions_m)


@pytest.mark.parametrize("model", list(ThermalModel))
def test_charge_falls_by_what_is_drawn(model: ThermalModel) -> None:
    plant = Plant(I3, level, thermal_model=model)
    state = plant.initial_state(speed_m_s=15.0)
    drawn_c = 0.0
    for acceleration in (0.5, 0.8, -1.0, -1.8, 0.0):
        step = plant.advance(state, Command(acceleration, 500.0), 1.0)
        drawn_c += step.charge_c
        state = step.state
    capacity_c = 3600.0 * 61.7682 * (1.0 - I3.aging.initial_capacity_loss)
    assert state.state_of_charge == pytest.approx(0.9 - drawn_c / capacity_c, rel=1e-9)
    assert abs(drawn_c) > 1.0


@pytest.mark.parametrize("acceleration", [1.0, 0.0, -1.0, -2.0])
def test_energy_balances_with_limits_of_regeneration(acceleration: float) -> None:
    """What the source delivers is the terminal energy and the heat, also while the friction brakes help."""
    plant = Plant(I3, level)
    start = replace(plant.initial_state(speed_m_s=25.0), acceleration_m_s2=acceleration)
    step = plant.advance(start, Command(acceleration, 0.0), 1.0)
    source_v = at_charge(I3, start.state_of_charge).pack.open_circuit_voltage_v
    source_j = source_v * step.charge_c
    terminal_j = step.powers.battery_power_w
    assert source_j == pytest.approx(terminal_j + step.powers.battery_heat_w, rel=1e-9)


def test_friction_brakes_take_what_the_motor_does_not() -> None:
    plant = Plant(I3, level)
    start = replace(plant.initial_state(speed_m_s=30.0), acceleration_m_s2=-2.0)
    step = plant.advance(start, Command(-2.0, 0.0), 1.0)
    braked_w = I3.body.mass_kg * 2.0 * 29.0
    assert step.powers.traction_power_w > -I3.regeneration.power_w
    assert -step.powers.traction_power_w < 0.7 * braked_w


def test_the_air_cools_a_warm_pack_at_rest() -> None:
    """96 cells of 3427.67 J/K, 30 K above the air, with 26.2353 W/K between them."""
    cold = load_parameters(
        "bmw_i3",
        {
            "environment.ambient_temperature_k": 278.15,
            "environment.initial_cell_temperature_k": 308.15,
            "cooling.auxiliary_power_w": 0.0,
        },
    ).values
    plant = Plant(cold, level)
    state = plant.initial_state()
    after = plant.advance(state, Command(0.0, 0.0), 1.0).state
    expected_k = 308.15 - 26.2353 * 30.0 / (96 * 3427.67)
    mean_k = 0.5 * (after.cell_1_temperature_k + after.cell_n_temperature_k)
    assert mean_k - 308.15 == pytest.approx(expected_k - 308.15, rel=1e-3)
