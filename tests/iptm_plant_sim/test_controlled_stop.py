"""The controlled stop: comfortable, within all limits, and it does end."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from iptm_core.physics.car_following import COMFORTABLE_DECELERATION_M_S2, controlled_stop_command
from iptm_core.state import Command
from iptm_plant_sim.plant import Plant


def stop(
    plant: Plant, speed: float, acceleration: float, compressor: float, duration: float
) -> int:
    """Apply the stop until standstill; return the number of intervals."""
    state = replace(
        plant.initial_state(speed_m_s=speed),
        acceleration_m_s2=acceleration,
        compressor_power_w=compressor,
    )
    for count in range(20_000):
        if state.speed_m_s == 0.0 and state.compressor_power_w == 0.0:
            return count
        command = controlled_stop_command(state, plant.parameters.limits, duration)
        step = plant.advance(state, command, duration)
        # The limits of the plant find nothing to correct, but for the top speed at the start.
        assert step.report.actuated == command
        assert step.state.speed_m_s <= max(speed, 0.0) + acceleration**2 + 1.0
        state = step.state
    pytest.fail("does not come to rest")


@given(
    speed=st.floats(0.0, 37.5),
    acceleration=st.floats(-2.0, 2.0),
    compressor=st.floats(0.0, 4500.0),
)
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_stops_from_any_state(
    make_plant: Callable[..., Plant], speed: float, acceleration: float, compressor: float
) -> None:
    assert stop(make_plant("hills"), speed, acceleration, compressor, 1.0) < 90


def test_is_comfortable_and_ends_softly(plant: Plant) -> None:
    state = plant.initial_state(speed_m_s=25.0)
    decelerations = []
    while state.speed_m_s > 0.0:
        command = controlled_stop_command(state, plant.parameters.limits)
        decelerations.append(-command.acceleration_m_s2)
        state = plant.advance(state, command).state
    assert max(decelerations) == COMFORTABLE_DECELERATION_M_S2
    assert decelerations[0] == 0.5
    assert decelerations[-1] <= 0.5


def test_deceleration_is_cut_to_the_limits(plant: Plant) -> None:
    state = replace(plant.initial_state(speed_m_s=30.0), acceleration_m_s2=-1.9)
    command = controlled_stop_command(state, plant.parameters.limits, deceleration_m_s2=50.0)
    assert command == Command(-2.0, 0.0)


def test_a_heater_runs_down_within_its_rate(plant: Plant) -> None:
    limits = replace(plant.parameters.limits, max_heater_power_w=5000.0)
    state = replace(plant.initial_state(), compressor_power_w=-450.0)
    powers = []
    while state.compressor_power_w != 0.0:
        power_w = controlled_stop_command(state, limits).compressor_power_w
        powers.append(power_w)
        state = replace(state, compressor_power_w=power_w)
    assert powers == [-250.0, -50.0, 0.0]
