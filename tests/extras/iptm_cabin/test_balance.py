"""Heat is conserved: in all nodes, around the refrigerant, and over a trip, for random cars and climates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import iptm
from iptm_cabin.cabin_plant import CabinVehicleState, plant_with
from iptm_cabin.cycle_map import Refrigerant
from iptm_cabin.parameters import CabinParameters, ClimateControl, cabin_of
from iptm_cabin.refrigerant_loop import SHELL_EFFICIENCY
from iptm_cabin.thermal_functions import thermal_functions
from iptm_cabin.thermal_model import CabinModel
from iptm_core.declaration import parameter_specs
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, VehicleState

TOLERANCE = 1e-9
CARS = ("paper_calibrated", "bmw_i3", "tesla_model_3", "chevrolet_bolt")


def random_cabin(random: np.random.Generator) -> CabinParameters:
    """A cabin with every number that is a size between a half and twice the default."""
    drawn: dict[str, Any] = {}
    for spec in parameter_specs(CabinParameters):
        if spec.unit and spec.name not in {"initial_c", "set_point_c"}:
            value = float(spec.default) * random.uniform(0.5, 2.0)
            drawn[spec.name] = min(max(value, spec.minimum), spec.maximum)
    drawn |= {
        "refrigerant": str(random.choice([each.value for each in Refrigerant])),
        "fresh_share": random.uniform(0.0, 1.0),
        "humidity": random.uniform(0.0, 1.0),
        "sun_w_m2": random.uniform(0.0, 1000.0),
        "occupants": random.uniform(0.0, 5.0),
    }
    return cabin_of(drawn)


def test_balances_close_for_100_random_cars_and_climates() -> None:
    random = np.random.default_rng(55)
    worst = 0.0
    for number in range(100):
        car = load_parameters(CARS[number % len(CARS)]).values
        model = CabinModel(random_cabin(random), car)
        air_k = random.uniform(243.15, 323.15)
        states = tuple(float(air_k + each) for each in random.uniform(-10.0, 45.0, 6))
        inputs = (
            *random.uniform(-6e3, 6e3, 2).tolist(),
            random.uniform(0.0, 5e3),
            random.uniform(),
        )
        weather = (
            random.uniform(0.0, 40.0),
            random.uniform(0.0, 5e3),
            random.uniform(0.0, 4e3),
            float(car.environment.ambient_temperature_k),
            model.cabin.sun_w_m2,
        )
        flows = model.flows(states, inputs, weather)
        loop = flows.loop
        size = abs(loop.evaporated_w) + loop.power_w + 1e3
        given = loop.condensed_w - loop.evaporated_w - SHELL_EFFICIENCY * loop.power_w
        cooled = max(-inputs[0], 0.0) + max(-inputs[1], 0.0) + loop.latent_w
        heated = max(inputs[0], 0.0) + max(inputs[1], 0.0)
        around = cooled + loop.waste_w + SHELL_EFFICIENCY * loop.power_w - heated - loop.to_air_w
        of_nodes = flows.stored_w - flows.into_car_w
        worst = max(worst, *(abs(each) / size for each in (given, around, of_nodes)))
        assert loop.power_w >= 0.0
        assert math.isfinite(flows.electric_w)
    assert worst < TOLERANCE


@pytest.mark.parametrize("car_name", ["paper_calibrated", "bmw_i3"])
def test_the_integrated_pack_keeps_what_flows_into_it(car_name: str) -> None:
    """Heat less what the loop takes, and the air: to 1e-9 of the heat that a pack of 90 s has taken."""
    car = load_parameters(car_name).values
    cabin = CabinParameters(control=ClimateControl.RULE, sun_w_m2=600.0)
    plant = plant_with(cabin)(car, np.zeros_like)
    state: VehicleState = plant.initial_state()
    in_j = 0.0
    pack_j_k = 0.5 * car.pack.cells * car.cell.heat_capacity_j_k
    first = state
    assert car.environment.ambient_temperature_k == first.cell_1_temperature_k
    for tick in range(90):
        step = plant.advance(state, Command(1.0 if tick < 20 else 0.0, 0.0))
        in_j += step.powers.battery_heat_w - step.powers.chiller_heat_w
        state = step.state
    rise_k = state.cell_1_temperature_k + state.cell_n_temperature_k
    rise_k -= first.cell_1_temperature_k + first.cell_n_temperature_k
    exchanged_j = car.cooling.air_exchange_w_k * rise_k * 90.0
    assert abs(pack_j_k * rise_k - in_j) <= TOLERANCE * abs(in_j) + exchanged_j


def test_temperatures_settle_where_flows_balance_by_hand() -> None:
    """A parked cabin in the sun: the heat of sun and person leaves through shell, board and fresh air."""
    cabin = CabinParameters(
        sun_w_m2=500.0, fresh_share=0.0, blower_power_w=0.0, control=ClimateControl.ALONE
    )
    functions = thermal_functions(cabin, load_parameters("paper_calibrated").values)
    weather = (0.0, 0.0, 0.0, 300.0, 500.0)
    states: tuple[float, ...] = (300.0,) * 6
    for _ in range(4000):
        states = functions.advance(states, (0.0, 0.0, 0.0, 0.0), weather, 0.0, 10.0)
    air, interior, core = states[:3]
    leaves_w = 40.0 * (air - 300.0) + 12.0 * (interior - 300.0)
    assert leaves_w == pytest.approx(500.0 * 0.9 + 100.0, rel=1e-4)
    assert core == pytest.approx(air, abs=1e-3)
    assert 305.0 < air < interior < 330.0


def test_a_trip_without_a_cabin_is_unchanged_and_one_with_it_costs_more_in_the_cold() -> None:
    settings: dict[str, Any] = {"duration_s": 40.0, "climate": -10.0, "strategy": "production"}
    without = iptm.simulate("us06", **settings)
    winter = iptm.simulate("us06", **settings, plant="mid_size.cabin")
    again = iptm.simulate("us06", **settings, plant="mid_size.cabin")
    assert winter.figures["consumption"] > 1.2 * without.figures["consumption"]
    np.testing.assert_array_equal(winter.frame.speed_m_s, without.frame.speed_m_s)
    np.testing.assert_array_equal(winter.frame.battery_power_w, again.frame.battery_power_w)


def test_the_pack_supplies_compressor_heater_and_blower() -> None:
    car = load_parameters("paper_calibrated").values
    plant = plant_with(CabinParameters(initial_c=60.0))(car, np.zeros_like)
    step = plant.advance(plant.initial_state(), Command(0.0, 0.0))
    state = step.state
    assert isinstance(state, CabinVehicleState)
    assert state.cabin.compressor_w > 1000.0
    assert state.cabin.electric_w > state.cabin.compressor_w + 100.0
    by_hand = state.cabin.electric_w + car.cooling.auxiliary_power_w
    assert step.powers.auxiliary_power_w == pytest.approx(by_hand, abs=1e-9)
    assert step.powers.battery_power_w == pytest.approx(by_hand, rel=0.02)
