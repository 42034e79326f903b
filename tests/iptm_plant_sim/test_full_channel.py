"""The plant with every cell of a coolant channel."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm_core.errors import StateError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import (
    capacity_loss_rate_1_s,
    cell_heat_w,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
)
from iptm_core.physics.chiller import chiller_line
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.physics.powertrain import (
    battery_power_w,
    cell_current_a,
    pack_current_a,
    pack_resistance_ohm,
)
from iptm_core.physics.thermal_loop import FullChannel, exchange_ratio, solve_coolant_loop
from iptm_core.settings import ThermalModel
from iptm_core.state import ChannelCells, Command, FloatArray, FullChannelState, VehicleState
from iptm_plant_sim.actuators import Clamp
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

FULL = ThermalModel.FULL_CHANNEL
TICKS = 60


def hills(positions_m: FloatArray) -> FloatArray:
    return 0.06 * np.sin(positions_m / 150.0)


def full_plant(
    parameters: ModelParameters,
    step_s: float = 0.05,
    slope_at: Callable[[FloatArray], FloatArray] = hills,
) -> Plant:
    return Plant(parameters, slope_at, step_s, FULL)


def cells_of(state: VehicleState) -> ChannelCells:
    assert isinstance(state, FullChannelState)
    return state.cells


def lively_trip(plant: Plant, ticks: int = TICKS) -> list[PlantStep]:
    """Speeding up and braking over hills, with a compressor that is never at rest."""
    step = plant.observe(plant.initial_state(speed_m_s=15.0, cell_n_temperature_k=310.0))
    steps = [step]
    for tick in range(ticks):
        command = Command(1.2 * math.sin(tick / 9.0), 1500.0 + 1000.0 * math.sin(tick / 7.0))
        step = plant.advance(step.state, command)
        steps.append(step)
    return steps


def columns(state: VehicleState) -> FloatArray:
    return np.array(
        [
            state.cell_1_temperature_k,
            state.cell_n_temperature_k,
            1e6 * state.cell_1_capacity_loss,
            1e6 * state.cell_n_capacity_loss,
        ]
    )


def test_two_cells_are_the_two_cell_model_at_second_order() -> None:
    """Uphill all the way, so that no kink hides the order."""
    parameters = load_parameters(overrides={"pack.cells_per_channel": 2}).values

    def climb(positions_m: FloatArray) -> FloatArray:
        return 0.02 + 0.01 * np.sin(positions_m / 100.0)

    def changes(plant: Plant) -> FloatArray:
        start = plant.initial_state(speed_m_s=10.0, cell_n_temperature_k=310.0)
        state = start
        for tick in range(10):
            command = Command(
                0.8 + 0.5 * math.sin(tick / 3.0), 1500.0 + 800.0 * math.sin(tick / 2.0)
            )
            state = plant.advance(state, command).state
        return columns(state) - columns(start)

    expected = changes(Plant(parameters, climb))
    errors = [
        np.abs(changes(full_plant(parameters, step_s, climb)) / expected - 1.0)
        for step_s in (0.05, 0.025, 0.0125)
    ]
    assert (errors[0] < 1e-4).all()
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (orders > 1.8).all()
    assert (orders < 2.3).all()


def test_powers_of_two_cells_are_those_of_the_two_cell_model() -> None:
    parameters = load_parameters(overrides={"pack.cells_per_channel": 2}).values
    for reduced, full in zip(
        lively_trip(Plant(parameters, hills)), lively_trip(full_plant(parameters)), strict=True
    ):
        for name in ("traction_power_w", "battery_power_w", "auxiliary_power_w"):
            assert getattr(full.powers, name) == pytest.approx(
                getattr(reduced.powers, name), rel=1e-9
            )
        heat_w = reduced.powers.battery_heat_w
        assert full.powers.battery_heat_w == pytest.approx(heat_w, rel=2e-3, abs=1e-3)
        for name, tolerance in (
            ("charge_c", 1e-4),
            ("pack_voltage_v", 1e-5),
            ("pack_current_a", 1e-4),
            ("coolant_inlet_temperature_k", 1e-5),
            ("coolant_outlet_temperature_k", 1e-5),
        ):
            assert getattr(full, name) == pytest.approx(
                getattr(reduced, name), rel=tolerance, abs=1e-3
            )


def test_heat_is_what_the_chiller_takes_and_the_cells_keep(parameters: ModelParameters) -> None:
    steps = lively_trip(full_plant(parameters))
    capacity_j_k = parameters.cell.heat_capacity_j_k * parameters.pack.modules
    assert max(step.powers.chiller_heat_w for step in steps) > 1000.0
    for before, after in itertools.pairwise(steps):
        warmed = cells_of(after.state).temperatures_k - cells_of(before.state).temperatures_k
        kept_w = capacity_j_k * float(np.sum(warmed))
        # Temperatures of 300 K are kept to 6e-14 K.
        assert after.powers.battery_heat_w == pytest.approx(
            after.powers.chiller_heat_w + kept_w, rel=1e-9, abs=1e-4
        )


def test_without_current_and_cooling_uniform_cells_stay() -> None:
    parameters = load_parameters(overrides={"cooling.auxiliary_power_w": 0.0}).values
    plant = full_plant(parameters, slope_at=np.zeros_like)
    step = plant.observe(plant.initial_state())
    for _ in range(100):
        step = plant.advance(step.state, Command(0.0, 0.0))
    assert step.cell_current_a == 0.0
    found, start = cells_of(step.state), cells_of(plant.initial_state())
    assert found.temperatures_k == pytest.approx(start.temperatures_k, abs=1e-10)
    assert (found.capacity_losses == start.capacity_losses).all()


def test_equal_heat_settles_on_a_line() -> None:
    """Resistance without temperature coefficient and no entropic heat: all cells heat alike."""
    parameters = load_parameters(
        overrides={
            "cell.resistance_temperature_coefficient_1_k": 0.0,
            "cell.entropic_coefficient_v_k": 0.0,
            "cell.resistance_aging_exponent": 0.0,
        }
    ).values
    plant = full_plant(parameters, 1.0, np.zeros_like)
    state = plant.initial_state(speed_m_s=25.0, cell_n_temperature_k=300.0)
    bent = []
    for _ in range(2500):
        step = plant.advance(state, Command(0.0, 600.0), 20.0)
        state = replace(step.state, state_of_charge=0.9)  # 14 hours at 25 m/s empty any pack
        cells_k = cells_of(state).temperatures_k
        line = np.linspace(cells_k[0], cells_k[-1], cells_k.size)
        bent.append(float(np.max(np.abs(cells_k - line))))
    assert max(bent) > 0.3
    assert bent[-1] < 1e-6
    # Each cell hands its heat q to the coolant, which warms by r q / h from cell to cell.
    cell_heat = step.powers.battery_heat_w / (parameters.pack.modules * cells_k.size)
    warmed = exchange_ratio(parameters.cooling, parameters.pack) * cell_heat
    expected = (cells_k.size - 1) * warmed / parameters.cooling.convective_coefficient_w_k
    assert cells_k[-1] - cells_k[0] == pytest.approx(expected, rel=1e-4)


def rates_of_all_cells(
    parameters: ModelParameters, start: VehicleState, command: Command, time_s: float, x: FloatArray
) -> FloatArray:
    """Rates of temperatures and losses at an instant of a motion over the hills, cell by cell."""
    count = x.size // 2
    temperatures, losses = x[:count], x[count:]
    speed = start.speed_m_s + command.acceleration_m_s2 * time_s
    position = start.position_m + time_s * 0.5 * (start.speed_m_s + speed)
    slope = float(hills(np.array(position)))
    pack, cell, cooling = parameters.pack, parameters.cell, parameters.cooling
    traction = electric_traction_power_w(speed, command.acceleration_m_s2, slope, parameters)
    power = battery_power_w(
        traction, command.compressor_power_w, cooling.auxiliary_power_w, pack, parameters.powertrain
    )
    resistances = cell_resistance_ohm(temperatures, losses, cell)
    pack_resistance = pack_resistance_ohm(float(np.mean(resistances)), pack)
    current = cell_current_a(
        pack_current_a(power, pack_resistance, float(np.mean(temperatures)), cell, pack), pack
    )
    channel = FullChannel.of(cooling, pack)
    line = chiller_line(
        command.compressor_power_w, speed, parameters.chiller, cooling, parameters.environment
    )
    equivalent = channel.equivalent_cell_k(temperatures)
    loop = solve_coolant_loop(equivalent, equivalent, line, channel.outlet, cooling)
    coolant = np.array(channel.coolant_k(loop.inlet_k, temperatures)[:-1])
    heat = cell_heat_w(current, resistances, temperatures, cell)
    return np.concatenate(
        (
            cell_temperature_rate_k_s(heat, temperatures, coolant, cell, cooling),
            capacity_loss_rate_1_s(current, temperatures, losses, parameters.aging, cell),
        )
    )


@pytest.mark.parametrize("acceleration", [-1.5, 0.0, 1.2])
def test_every_cell_follows_its_equations(parameters: ModelParameters, acceleration: float) -> None:
    """Against classical Runge-Kutta on the rates of all cells at each instant, nothing averaged."""
    plant = full_plant(parameters)
    begun = lively_trip(plant, 30)[-1].state
    start = replace(
        begun, speed_m_s=15.0, acceleration_m_s2=acceleration, compressor_power_w=1800.0
    )
    command = Command(acceleration, 1800.0)
    found = cells_of(plant.advance(start, command).state)
    cells = cells_of(start)
    first = np.concatenate((cells.temperatures_k, cells.capacity_losses))
    x, h = first, 0.02
    for index in range(50):
        t = index * h
        k1 = rates_of_all_cells(parameters, start, command, t, x)
        k2 = rates_of_all_cells(parameters, start, command, t + h / 2, x + h / 2 * k1)
        k3 = rates_of_all_cells(parameters, start, command, t + h / 2, x + h / 2 * k2)
        k4 = rates_of_all_cells(parameters, start, command, t + h, x + h * k3)
        x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    expected = x - first
    count = cells.temperatures_k.size
    assert found.temperatures_k - first[:count] == pytest.approx(expected[:count], abs=2e-5)
    assert found.capacity_losses - first[count:] == pytest.approx(expected[count:], rel=1e-3)


def test_both_measured_cells_are_the_ends_of_the_channel(parameters: ModelParameters) -> None:
    for step in lively_trip(full_plant(parameters), 5):
        cells = cells_of(step.state)
        assert cells.temperatures_k.shape == cells.capacity_losses.shape == (228,)
        assert step.state.cell_1_temperature_k == cells.temperatures_k[0]
        assert step.state.cell_n_temperature_k == cells.temperatures_k[-1]
        assert step.state.cell_n_capacity_loss == cells.capacity_losses[-1]


def test_the_drive_gives_way_when_the_pack_cannot_supply_it() -> None:
    weak = load_parameters(overrides={"cell.nominal_resistance_ohm": 0.5}).values
    plant = full_plant(weak, slope_at=lambda positions: np.full_like(positions, 0.06))
    state = replace(plant.initial_state(speed_m_s=30.0), acceleration_m_s2=1.0)
    step = plant.advance(state, Command(1.5, 0.0))
    assert Clamp.PACK_POWER in step.report.clamps
    assert math.isfinite(step.state.cell_n_temperature_k)


def test_a_state_of_two_cells_is_refused(parameters: ModelParameters) -> None:
    plant = full_plant(parameters)
    with pytest.raises(StateError, match="full channel"):
        plant.advance(Plant(parameters, hills).initial_state(), Command(0.0, 0.0))


@pytest.mark.parametrize("value", [math.nan, 35.0])
def test_impossible_cells_are_named(parameters: ModelParameters, value: float) -> None:
    plant = full_plant(parameters)
    state = plant.initial_state()
    temperatures = cells_of(state).temperatures_k.copy()
    temperatures[100] = value
    poisoned = replace(state, cells=replace(cells_of(state), temperatures_k=temperatures))
    with pytest.raises(StateError, match=f"temperatures_k is {value}"):
        plant.check(poisoned)
