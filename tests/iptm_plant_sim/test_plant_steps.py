"""One interval of the plant: balances, standstill, limits, and the edges of what is possible."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm_core.errors import StateError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import Command, IntervalPowers, VehicleState
from iptm_plant_sim.actuators import Clamp
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant


def energies_balance(step: PlantStep, parameters: ModelParameters, duration: float) -> None:
    """Every joule at the terminals has a taker, and every joule of the source goes somewhere."""
    pack, zeta = parameters.pack, parameters.powertrain.regenerative_efficiency
    driving = step.powers.traction_power_w - step.regenerative_power_w
    assert step.regenerative_power_w <= 0.0 <= driving
    terminal = (
        driving + step.powers.compressor_power_w + step.powers.auxiliary_power_w
    ) / pack.battery_efficiency
    terminal += pack.battery_efficiency * zeta * step.regenerative_power_w
    assert step.powers.battery_power_w == pytest.approx(terminal, rel=1e-11, abs=1e-8)
    source = pack.open_circuit_voltage_v * step.charge_c / duration
    assert source == pytest.approx(
        step.powers.battery_power_w + step.powers.battery_heat_w, rel=1e-10, abs=1e-7
    )


@pytest.mark.parametrize("efficiency", [1.0, 0.95])
@pytest.mark.parametrize("duration", [1.0, 0.3])
def test_energies_balance_in_every_interval(
    parameters: ModelParameters, efficiency: float, duration: float
) -> None:
    lossy = replace(parameters, pack=replace(parameters.pack, battery_efficiency=efficiency))
    plant = Plant(lossy, lambda p: 0.06 * np.sin(p / 150.0))
    state = plant.initial_state(speed_m_s=15.0)
    for tick in range(200):
        command = Command(2.0 * math.sin(tick / 6.0), 2000.0 * (1.0 + math.cos(tick / 11.0)))
        step = plant.advance(state, command, duration)
        energies_balance(step, lossy, duration)
        state = step.state


def test_temperature_of_the_cells_balances_heat_and_coolant(plant: Plant) -> None:
    """Without flow through the chiller, all heat stays in the pack (per channel of equal cells)."""
    state = plant.initial_state(speed_m_s=25.0)
    step = plant.advance(state, Command(0.5, 0.0))
    assert step.powers.chiller_heat_w == 0.0
    assert step.coolant_inlet_temperature_k == step.coolant_outlet_temperature_k
    cells = plant.parameters.pack.cells_in_series * plant.parameters.pack.parallel
    rise = step.powers.battery_heat_w / (cells * plant.parameters.cell.heat_capacity_j_k)
    end = step.state
    for temperature, start in (
        (end.cell_1_temperature_k, state.cell_1_temperature_k),
        (end.cell_n_temperature_k, state.cell_n_temperature_k),
    ):
        assert temperature - start == pytest.approx(rise, rel=1e-6)


@pytest.mark.parametrize("slope", ["climb", "hills", "level"])
def test_holding_consumes_nothing_but_auxiliaries(
    make_plant: Callable[..., Plant], slope: str
) -> None:
    plant = make_plant(slope)
    step = plant.advance(plant.initial_state(position_m=40.0), Command(0.0, 0.0))
    assert step.standstill
    assert step.powers.traction_power_w == 0.0
    assert step.powers.battery_power_w == pytest.approx(step.powers.auxiliary_power_w)
    assert step.powers.auxiliary_power_w == plant.parameters.cooling.auxiliary_power_w
    assert step.state.position_m == 40.0


def test_stop_inside_an_interval(make_plant: Callable[..., Plant]) -> None:
    """The part before the stop is that of a shorter interval, the part behind it is held."""
    plant = make_plant("climb")
    state = replace(plant.initial_state(speed_m_s=0.8), acceleration_m_s2=-2.0)
    whole = plant.advance(state, Command(-2.0, 0.0))
    assert whole.standstill
    assert whole.state.speed_m_s == 0.0
    assert whole.state.acceleration_m_s2 == 0.0
    assert whole.report.actuated.acceleration_m_s2 == -2.0
    assert whole.state.position_m == pytest.approx(0.8**2 / 4.0, abs=1e-12)
    braking = plant.advance(state, Command(-2.0, 0.0), 0.4)
    holding = plant.advance(braking.state, Command(0.0, 0.0), 0.6)
    energy = 0.4 * braking.powers.battery_power_w + 0.6 * holding.powers.battery_power_w
    assert whole.powers.battery_power_w == pytest.approx(energy, rel=1e-7)
    assert whole.powers.traction_power_w == pytest.approx(
        0.4 * braking.powers.traction_power_w, rel=1e-7
    )
    assert whole.state.cell_n_temperature_k == pytest.approx(
        holding.state.cell_n_temperature_k, abs=1e-10
    )


def test_the_next_start_is_smooth_from_zero(plant: Plant) -> None:
    state = replace(plant.initial_state(speed_m_s=0.5), acceleration_m_s2=-2.0)
    stopped = plant.advance(state, Command(-2.0, 0.0)).state
    step = plant.advance(stopped, Command(0.4, 0.0))
    assert step.report.clamps == ()
    assert step.state.speed_m_s == pytest.approx(0.4)


def test_top_speed_is_reported_and_kept(plant: Plant) -> None:
    top = plant.parameters.limits.max_speed_m_s
    step = plant.advance(plant.initial_state(speed_m_s=top - 0.1), Command(0.5, 0.0))
    assert step.report.clamps == (Clamp.TOP_SPEED,)
    assert step.state.speed_m_s == top
    again = plant.advance(step.state, Command(0.0, 0.0))
    assert again.report.clamps == ()
    assert again.state.speed_m_s == top


def test_drive_gives_way_when_the_pack_cannot_deliver(parameters: ModelParameters) -> None:
    weak = replace(parameters, cell=replace(parameters.cell, nominal_resistance_ohm=0.3))
    plant = Plant(weak, np.zeros_like)
    state = replace(plant.initial_state(speed_m_s=25.0), acceleration_m_s2=1.9)
    step = plant.advance(state, Command(2.0, 0.0))
    assert Clamp.PACK_POWER in step.report.clamps
    assert "pack_power" in step.report.reason
    done = step.report.actuated.acceleration_m_s2
    assert 0.0 < done < 2.0
    assert math.isfinite(step.powers.battery_power_w)
    more = plant.advance(replace(state, acceleration_m_s2=done), Command(done + 1e-3, 0.0))
    assert Clamp.PACK_POWER in more.report.clamps
    less = plant.advance(replace(state, acceleration_m_s2=done), Command(done - 1e-3, 0.0))
    assert less.report.clamps == ()


def test_observation_before_the_first_interval(plant: Plant) -> None:
    state = replace(plant.initial_state(), compressor_power_w=700.0)
    seen = plant.observe(state)
    assert seen.state == state
    assert seen.standstill
    assert seen.powers.compressor_power_w == 700.0
    assert seen.powers == IntervalPowers(0.0, 700.0, 0.0, 0.0, 0.0, 0.0)
    assert seen.pack_current_a > 0.0
    assert 300.0 < seen.pack_voltage_v < plant.parameters.pack.open_circuit_voltage_v
    # The electrics agree with those of a short interval from there.
    after = plant.advance(state, Command(0.0, 700.0), 1e-6)
    assert seen.pack_current_a == pytest.approx(after.pack_current_a, rel=1e-6)
    assert seen.coolant_inlet_temperature_k == pytest.approx(
        after.coolant_inlet_temperature_k, abs=1e-6
    )


def test_electrics_at_the_end_are_consistent(plant: Plant) -> None:
    step = plant.advance(plant.initial_state(speed_m_s=20.0), Command(0.5, 150.0))
    pack = plant.parameters.pack
    assert step.pack_current_a == pytest.approx(step.cell_current_a * pack.parallel)
    mean_cell = 0.5 * (step.cell_1_voltage_v + step.cell_n_voltage_v)
    assert step.pack_voltage_v == pytest.approx(mean_cell * pack.cells_in_series)


@pytest.mark.parametrize("flow_heats", [0.0, 4500.0])
def test_chiller_works_only_with_the_compressor(plant: Plant, flow_heats: float) -> None:
    state = replace(plant.initial_state(speed_m_s=20.0), compressor_power_w=flow_heats)
    step = plant.advance(state, Command(0.0, flow_heats))
    assert (step.powers.chiller_heat_w > 0.0) == (flow_heats > 0.0)
    assert (step.coolant_outlet_temperature_k > step.coolant_inlet_temperature_k) == (
        flow_heats > 0.0
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed_m_s", -0.1),
        ("speed_m_s", 40.0),
        ("position_m", math.nan),
        ("cell_1_temperature_k", 35.0),
        ("cell_n_capacity_loss", 0.0),
    ],
)
def test_impossible_states_are_named(plant: Plant, name: str, value: float) -> None:
    state: VehicleState = replace(plant.initial_state(), **{name: value})
    with pytest.raises(StateError, match=name):
        plant.check(state)


def test_a_poisoned_state_raises_instead_of_spreading(plant: Plant) -> None:
    state = replace(plant.initial_state(), cell_1_temperature_k=math.nan)
    with pytest.raises(StateError, match="cell_1_temperature_k"):
        plant.advance(state, Command(0.0, 0.0))
    with pytest.raises(StateError, match="cell_1_temperature_k"):
        plant.observe(state)


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan, math.inf])
def test_integration_step_must_make_sense(parameters: ModelParameters, step: float) -> None:
    with pytest.raises(StateError, match="step"):
        Plant(parameters, np.zeros_like, step)
