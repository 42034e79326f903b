"""The problem's model against the exact plant, over the range in which the vehicle operates.

The bounds state how far an optimised prediction may be off within one step, from the quadrature and
from the smoothed kinks together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state, run_stage

from iptm_controller.ocp.grid import MIDPOINT_UP_TO_S
from iptm_controller.ocp.layout import StateIndex
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_core.physics.power_thermal import EXACT, electric_traction_power_w
from iptm_core.physics.powertrain import battery_power_w, motor_torque_nm, traction_force_n
from iptm_core.state import Command, VehicleState
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

GRADE, WAVE_M = 0.05, 120.0
ENERGY = (0.0, 0.0, 1.0, 0.0)
AGEING_WEIGHT = 1e9  # as the strategies have it
AGEING = (0.0, 0.0, 0.0, AGEING_WEIGHT)


def road(position_m: float) -> tuple[float, float, float]:
    """Slope and its two derivatives."""
    phase = position_m / WAVE_M
    return (
        GRADE * math.sin(phase),
        GRADE * math.cos(phase) / WAVE_M,
        -GRADE * math.sin(phase) / WAVE_M**2,
    )


@dataclass(frozen=True)
class Sample:
    """One interval as the plant drives it."""

    start: VehicleState
    command: Command
    step: PlantStep

    @property
    def lost(self) -> float:
        """Capacity loss of both cells during the interval."""
        end, start = self.step.state, self.start
        return (
            end.cell_1_capacity_loss
            + end.cell_n_capacity_loss
            - start.cell_1_capacity_loss
            - start.cell_n_capacity_loss
        )


def draw_samples(plant: Plant, state: VehicleState, step_s: float, count: int) -> list[Sample]:
    rng = np.random.default_rng(7)
    samples: list[Sample] = []
    while len(samples) < count:
        speed, acceleration = rng.uniform(1.0, 36.0), rng.uniform(-2.0, 2.0)
        if not 1.0 <= speed + acceleration * step_s <= 37.0:
            continue
        power = float(rng.choice([0.0, 300.0, 600.0, 1000.0, 2000.0, 4500.0]))
        cell_1 = rng.uniform(298.0, 313.0)
        start = replace(
            state,
            position_m=rng.uniform(0.0, 2000.0),
            speed_m_s=speed,
            acceleration_m_s2=acceleration,
            compressor_power_w=power,
            cell_1_temperature_k=cell_1,
            cell_n_temperature_k=cell_1 + rng.uniform(0.0, 4.0),
        )
        command = Command(acceleration, power)
        step = plant.advance(start, command, step_s)
        if not step.report.clamps:
            samples.append(Sample(start, command, step))
    return samples


@pytest.fixture(scope="module")
def plant() -> Plant:
    return Plant(PARAMETERS, lambda positions: GRADE * np.sin(positions / WAVE_M), step_s=0.1)


@pytest.fixture(scope="module", params=[1.0, 5.0], ids=["1s", "5s"])
def step_s(request: pytest.FixtureRequest) -> float:
    return float(request.param)


@pytest.fixture(scope="module")
def samples(plant: Plant, step_s: float) -> list[Sample]:
    return draw_samples(plant, make_state(), step_s, 250)


def test_temperatures_within_a_few_millikelvin(samples: list[Sample], step_s: float) -> None:
    bound_k = 1e-3 if step_s <= MIDPOINT_UP_TO_S else 5e-3
    for sample in samples:
        following, _, _ = run_stage(
            sample.start, *vars(sample.command).values(), step_s, slope=road
        )
        end = sample.step.state
        assert following[StateIndex.CELL_1_TEMPERATURE] == pytest.approx(
            end.cell_1_temperature_k, abs=bound_k
        )
        assert following[StateIndex.CELL_N_TEMPERATURE] == pytest.approx(
            end.cell_n_temperature_k, abs=bound_k
        )


def test_ageing_within_one_percent(samples: list[Sample], step_s: float) -> None:
    """Half of all steps within 0.5 %, their sum within 1 %, none off by a fifth of the average step."""
    predicted = np.array(
        [
            run_stage(s.start, *vars(s.command).values(), step_s, AGEING, slope=road)[1]
            / AGEING_WEIGHT
            for s in samples
        ]
    )
    lost = np.array([sample.lost for sample in samples])
    errors = np.abs(predicted - lost)
    assert np.median(errors / lost) < 5e-3
    assert abs(predicted.sum() / lost.sum() - 1.0) < 1e-2
    assert errors.max() < 0.2 * lost.mean()


def test_energy_within_one_percent(samples: list[Sample], step_s: float) -> None:
    powers, errors = [], []
    for sample in samples:
        _, energy_j, _ = run_stage(
            sample.start, *vars(sample.command).values(), step_s, ENERGY, slope=road
        )
        powers.append(abs(sample.step.powers.battery_power_w))
        errors.append(energy_j / step_s - sample.step.powers.battery_power_w)
    assert np.median(np.abs(errors)) < 50.0
    assert abs(np.mean(errors)) < 1e-2 * np.mean(powers)
    assert np.max(np.abs(errors)) < 700.0


def test_without_smoothing_only_the_quadrature_is_left(
    samples: list[Sample], step_s: float
) -> None:
    errors = []
    for sample in samples:
        _, lost, _ = run_stage(
            sample.start,
            *vars(sample.command).values(),
            step_s,
            AGEING,
            slope=road,
            smoothing=EXACT,
        )
        errors.append(abs(lost / AGEING_WEIGHT / sample.lost - 1.0))
    assert np.median(errors) < 2e-3


def test_one_long_step_is_as_good_as_five_short_ones(plant: Plant) -> None:
    """Temperatures within 4 mK and the ageing of all steps within 1 % of five steps of 1 s each."""
    long_sum = short_sum = 0.0
    for sample in draw_samples(plant, make_state(), 5.0, 100):
        command = (sample.command.acceleration_m_s2, sample.command.compressor_power_w)
        following, lost, _ = run_stage(sample.start, *command, 5.0, AGEING, slope=road)
        long_sum += lost
        state = sample.start
        for _ in range(5):
            short, lost, _ = run_stage(state, *command, 1.0, AGEING, slope=road)
            short_sum += lost
            state = replace(
                state,
                position_m=short[StateIndex.POSITION],
                speed_m_s=short[StateIndex.SPEED],
                cell_1_temperature_k=short[StateIndex.CELL_1_TEMPERATURE],
                cell_n_temperature_k=short[StateIndex.CELL_N_TEMPERATURE],
            )
        assert following[StateIndex.POSITION] == pytest.approx(state.position_m, abs=1e-8)
        for index, temperature in (
            (StateIndex.CELL_1_TEMPERATURE, state.cell_1_temperature_k),
            (StateIndex.CELL_N_TEMPERATURE, state.cell_n_temperature_k),
        ):
            assert following[index] == pytest.approx(temperature, abs=4e-3)
    assert long_sum == pytest.approx(short_sum, rel=1e-2)


def test_traction_power_is_smoothed_by_no_more_than_the_widths() -> None:
    """Largest where the wheel force changes its sign: half a width of force, times the speed."""
    powertrain = PARAMETERS.powertrain
    efficiency = powertrain.driveline_efficiency
    half_width_n = 0.5 * DEFAULT_SMOOTHING.force_n * (1.0 / efficiency - efficiency)
    rng = np.random.default_rng(1)
    for _ in range(2000):
        speed, acceleration = rng.uniform(0.0, 37.5), rng.uniform(-2.0, 2.0)
        motion = (speed, acceleration, rng.uniform(-0.06, 0.06))
        exact = electric_traction_power_w(*motion, PARAMETERS)
        smooth = electric_traction_power_w(*motion, PARAMETERS, DEFAULT_SMOOTHING)
        torque = motor_torque_nm(traction_force_n(*motion, PARAMETERS.body), powertrain)
        copper_w = powertrain.motor_loss_w_per_nm2 * torque**2
        gross_w = abs(exact - copper_w) + copper_w
        held = DEFAULT_SMOOTHING.speed_m_s**2 / (speed**2 + DEFAULT_SMOOTHING.speed_m_s**2)
        # A tenth more, because the copper loss sees the smoothed torque squared.
        bound_w = 1.1 * half_width_n * speed + 2.0 * held * gross_w + 30.0
        assert abs(smooth - exact) < bound_w


def test_battery_power_is_smoothed_by_half_a_width_at_most() -> None:
    lost_share = 1.0 - PARAMETERS.powertrain.regenerative_efficiency
    traction = np.linspace(-40e3, 40e3, 4001)
    arguments = (traction, 0.0, 200.0, PARAMETERS.pack, PARAMETERS.powertrain)
    exact = battery_power_w(*arguments)
    smooth = battery_power_w(*arguments, power_smoothing_w=DEFAULT_SMOOTHING.power_w)
    error = smooth - exact
    half_width_w = 0.5 * DEFAULT_SMOOTHING.power_w * lost_share
    assert error.max() == pytest.approx(half_width_w, rel=1e-6)
    assert error.min() >= 0.0
    assert error[np.abs(traction) > 10e3].max() < 0.03 * half_width_w


def test_heater_and_radiator_agree_with_the_plant(step_s: float) -> None:
    """The sign change of the actuator is smooth in the problem: 10 W at most of heat and of power."""
    model = replace(
        PARAMETERS,
        limits=replace(PARAMETERS.limits, max_heater_power_w=5000.0),
        cooling=replace(PARAMETERS.cooling, radiator_w_k=150.0),
        environment=replace(PARAMETERS.environment, ambient_temperature_k=288.15),
    )
    plant = Plant(model, np.zeros_like, step_s=0.1)
    for power_w in (-5000.0, -800.0, -50.0, 0.0, 50.0, 300.0, 2000.0):
        for cells_k in (278.15, 308.15):
            state = make_state(
                compressor_power_w=power_w,
                cell_1_temperature_k=cells_k,
                cell_n_temperature_k=cells_k + 2.0,
            )
            step = plant.advance(state, Command(0.2, power_w), step_s)
            assert not step.report.clamps
            following, energy_j, _ = run_stage(state, 0.2, power_w, step_s, ENERGY, model=model)
            # Off, 10 W of fan power open the radiator by a tenth, 14 W/K, for up to 22 K: 330 W make the
            # coolant 0.7 K colder, and a cell of 45 J/K gives it 0.49 W/K.
            bound_k = 5e-3 + (step_s * 0.7 * 0.49 / 45.0 if abs(power_w) < 200.0 else 0.0)
            for index, end_k in (
                (StateIndex.CELL_1_TEMPERATURE, step.state.cell_1_temperature_k),
                (StateIndex.CELL_N_TEMPERATURE, step.state.cell_n_temperature_k),
            ):
                assert following[index] == pytest.approx(end_k, abs=bound_k)
            drawn_j = step.powers.battery_power_w * step_s
            assert energy_j == pytest.approx(drawn_j, rel=1e-2, abs=25.0 * step_s)
