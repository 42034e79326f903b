"""Whatever is commanded, the vehicle stays a vehicle."""

import math
from collections.abc import Callable

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from iptm_core.state import Command
from iptm_plant_sim.plant import Plant

ANYTHING = st.floats(allow_nan=True, allow_infinity=True)
PLAUSIBLE = st.floats(-3.0, 3.0)
COMMANDS = st.lists(
    st.builds(Command, st.one_of(PLAUSIBLE, ANYTHING), st.one_of(st.floats(0.0, 5000.0), ANYTHING)),
    min_size=1,
    max_size=60,
)


@given(commands=COMMANDS, speed=st.floats(0.0, 37.5), duration=st.sampled_from([0.1, 1.0, 2.5]))
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_commands_lead_to_finite_and_plausible_states(
    make_plant: Callable[..., Plant], commands: list[Command], speed: float, duration: float
) -> None:
    plant = make_plant("hills")
    limits = plant.parameters.limits
    open_circuit_v = plant.parameters.pack.open_circuit_voltage_v
    state = plant.initial_state(speed_m_s=speed)
    for command in commands:
        step = plant.advance(state, command, duration)
        end = step.state
        numbers = [*vars(end).values(), step.powers.battery_power_w, step.pack_current_a]
        assert all(math.isfinite(number) for number in numbers)
        assert 0.0 <= end.speed_m_s <= limits.max_speed_m_s * (1.0 + 1e-12)
        assert end.position_m >= state.position_m
        assert limits.min_acceleration_m_s2 <= end.acceleration_m_s2 <= limits.max_acceleration_m_s2
        assert 0.0 <= end.compressor_power_w <= limits.max_compressor_power_w
        assert end.cell_1_capacity_loss >= state.cell_1_capacity_loss
        assert end.cell_n_capacity_loss >= state.cell_n_capacity_loss
        for temperature in (end.cell_1_temperature_k, end.cell_n_temperature_k):
            assert 260.0 < temperature < 340.0
        assert 240.0 < step.coolant_inlet_temperature_k < 340.0
        # A source gives its largest power at half of its open-circuit voltage.
        assert 0.5 * open_circuit_v < step.pack_voltage_v < 450.0
        assert step.standstill == (end.speed_m_s == 0.0)
        state = end
