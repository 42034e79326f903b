"""Full and empty, cold and hot: every shipped car keeps charge and cell voltage within their limits."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.errors import PackEmptyError
from iptm_core.parameters import available_parameter_sets, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.settings import ThermalModel
from iptm_core.state import Command
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.actuators import Clamp
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

QUICK = (("paper_calibrated", 25.0), ("bmw_i3", -20.0), ("bmw_i3", 45.0))
CASES = [
    pytest.param(car, celsius, marks=() if (car, celsius) in QUICK else pytest.mark.slow)
    for car in available_parameter_sets()
    for celsius in (-20.0, 25.0, 45.0)
]


def _car(name: str, celsius: float, charge: float) -> ModelParameters:
    kelvin = max(celsius + CELSIUS_ZERO_K, 253.15)
    table = name in {"published_chiller", "paper_identified"}
    ambient = {} if table else {"environment.ambient_temperature_k": kelvin}
    return load_parameters(
        name,
        {
            **ambient,
            "environment.initial_cell_temperature_k": kelvin,
            "charge.initial_charge": charge,
            "charge.min_charge": 0.0,
        },
    ).values


def _drive(
    values: ModelParameters,
    slope_rad: float,
    accelerations_m_s2: list[float],
    model: ThermalModel = ThermalModel.TWO_CELL,
    speed_m_s: float = 0.0,
    compressor_w: float = 0.0,
) -> list[PlantStep]:
    plant = Plant(values, lambda at: np.full(np.shape(at), slope_rad), 0.05, model)
    state = plant.initial_state(speed_m_s=speed_m_s)
    steps = []
    for acceleration in accelerations_m_s2:
        try:
            step = plant.advance(state, Command(acceleration, compressor_w))
        except PackEmptyError:
            assert steps
            break
        steps.append(step)
        state = step.state
    return steps


def _check(steps: list[PlantStep], values: ModelParameters) -> None:
    limits = values.pack_limits
    for step in steps:
        assert 0.0 <= step.state.state_of_charge <= 1.0
        for volts in (step.cell_1_voltage_v, step.cell_n_voltage_v):
            assert limits.min_cell_voltage_v <= volts <= limits.max_cell_voltage_v


@pytest.mark.parametrize(("car", "celsius"), CASES)
def test_a_full_pack_takes_nothing_downhill_and_the_brakes_hold_the_speed(
    car: str, celsius: float
) -> None:
    values = _car(car, celsius, 1.0)
    steps = _drive(values, -0.08, [0.0] * 120, speed_m_s=25.0)
    _check(steps, values)
    assert steps[-1].state.speed_m_s == 25.0  # friction brakes supply the rest
    # What the motor feeds back serves the auxiliaries; nothing reaches the cells.
    assert all(step.pack_current_a >= -1e-9 for step in steps)
    assert all(step.powers.traction_power_w <= 0.0 for step in steps)


@pytest.mark.parametrize(("car", "celsius"), CASES)
def test_an_empty_pack_ends_the_trip_at_zero(car: str, celsius: float) -> None:
    values = _car(car, celsius, 0.006)
    steps = _drive(values, 0.04, [0.0] * 4000, speed_m_s=15.0, compressor_w=2000.0)
    _check(steps, values)
    assert len(steps) < 4000
    # What is left of a cold pack does not even supply the auxiliaries.
    assert steps[-1].state.state_of_charge < (0.006 if celsius < 0.0 else 0.0015)


@pytest.mark.parametrize("model", list(ThermalModel))
def test_a_nearly_empty_pack_gives_less_power(model: ThermalModel) -> None:
    full, low = (
        _drive(_car("bmw_i3", 25.0, charge), 0.0, [2.3] * 10, model) for charge in (0.9, 0.02)
    )
    assert low[-1].state.speed_m_s < 0.8 * full[-1].state.speed_m_s
    assert any(Clamp.PACK_POWER in step.report.clamps for step in low)
    assert not any(Clamp.PACK_POWER in step.report.clamps for step in full)


def test_an_empty_pack_is_named() -> None:
    values = _car("bmw_i3", 25.0, 1e-7)
    plant = Plant(values, np.zeros_like)
    with pytest.raises(PackEmptyError, match=r"the pack is empty: at 0\.00 %"):
        plant.advance(plant.initial_state(), Command(1.0, 0.0))


@pytest.mark.parametrize("model", list(ThermalModel))
def test_a_cold_pack_brakes_with_friction(model: ThermalModel) -> None:
    warm, cold = (
        _drive(_car("bmw_i3", celsius, 0.5), 0.0, [-1.5] * 8, model, speed_m_s=20.0)
        for celsius in (25.0, -20.0)
    )
    assert warm[-1].state.speed_m_s == cold[-1].state.speed_m_s
    assert min(step.pack_current_a for step in cold) >= -1e-9
    assert min(step.pack_current_a for step in warm) < -20.0
