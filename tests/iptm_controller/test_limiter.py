"""The last limiter: whatever comes in, what goes out can be actuated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.actuation import PowerAuthority
from iptm_controller.safeguards import CommandLimiter
from iptm_core.parameters import load_parameters
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.physics.powertrain import battery_power_w
from iptm_core.state import Command, SlopePreview

ANYTHING = st.floats(allow_nan=True, allow_infinity=True)
ACCELERATIONS = st.floats(-3.0, 3.0) | ANYTHING
POWERS = st.floats(-500.0, 6000.0) | ANYTHING
TICKS = st.sampled_from([0.1, 0.5, 1.0, 2.0])
SLACK = 1e-9
FLAT = SlopePreview(np.zeros(1), np.zeros(1))


@pytest.fixture
def limiter() -> CommandLimiter:
    return CommandLimiter(PARAMETERS.limits, 1.0)


@pytest.mark.parametrize(
    ("actuated_m_s2", "comfort_m_s2"),
    [
        (-8.0, PARAMETERS.limits.min_acceleration_m_s2),
        (-1.0, -1.0),
        (9.0, PARAMETERS.limits.max_acceleration_m_s2),
    ],
)
def test_what_service_brakes_actuate_is_brought_within_comfort(
    limiter: CommandLimiter, actuated_m_s2: float, comfort_m_s2: float
) -> None:
    state = make_state(acceleration_m_s2=actuated_m_s2)
    assert limiter.within_comfort(state).acceleration_m_s2 == comfort_m_s2


@given(
    acceleration=ACCELERATIONS,
    power=POWERS,
    last_acceleration=st.floats(-2.0, 2.0),
    last_power=st.floats(0.0, 4500.0),
    speed=st.floats(0.0, 37.5),
    tick_s=TICKS,
)
def test_any_command_leaves_within_bounds_and_rates(
    acceleration: float,
    power: float,
    last_acceleration: float,
    last_power: float,
    speed: float,
    tick_s: float,
) -> None:
    limits = PARAMETERS.limits
    limiter = CommandLimiter(limits, tick_s)
    state = make_state(
        acceleration_m_s2=last_acceleration, compressor_power_w=last_power, speed_m_s=speed
    )
    out, reasons = limiter.limit(Command(acceleration, power), state)
    assert limits.min_acceleration_m_s2 <= out.acceleration_m_s2 <= limits.max_acceleration_m_s2
    jerk_step = limits.max_jerk_m_s3 * tick_s
    assert abs(out.acceleration_m_s2 - last_acceleration) <= jerk_step + SLACK
    assert limits.min_compressor_power_w <= out.compressor_power_w <= limits.max_compressor_power_w
    rate_step = limits.max_compressor_rate_w_s * tick_s
    assert abs(out.compressor_power_w - last_power) <= rate_step + SLACK
    # Beyond its top speed the vehicle only gets by momentum that the jerk limit cannot take away.
    next_speed = speed + tick_s * out.acceleration_m_s2
    if next_speed > limits.max_speed_m_s + SLACK:
        assert out.acceleration_m_s2 == pytest.approx(last_acceleration - jerk_step)
    # Exactly the changed inputs are reported.
    changed = not (
        abs(out.acceleration_m_s2 - acceleration) <= 1e-6
        and abs(out.compressor_power_w - power) <= 1e-3
    )
    assert bool(reasons) == changed
    assert limiter.limit(out, state)[0] == out


@given(acceleration=st.floats(-0.5, 0.5), power=st.floats(800.0, 1200.0))
def test_what_can_be_actuated_passes_untouched(acceleration: float, power: float) -> None:
    limiter = CommandLimiter(PARAMETERS.limits, 1.0)
    command = Command(acceleration, power)
    assert limiter.limit(command, make_state(compressor_power_w=1000.0)) == (command, ())


@pytest.mark.parametrize(
    ("command", "state", "expected", "reasons"),
    [
        (Command(2.5, 0.0), {"acceleration_m_s2": 1.8}, Command(2.0, 0.0), ["acceleration bound"]),
        (Command(1.0, 0.0), {}, Command(0.5, 0.0), ["jerk"]),
        (Command(-2.0, 0.0), {"acceleration_m_s2": 1.0}, Command(0.5, 0.0), ["jerk"]),
        (Command(0.4, 0.0), {"speed_m_s": 37.4}, Command(0.1, 0.0), ["top speed"]),
        (
            Command(1.0, 0.0),
            {"speed_m_s": 37.4, "acceleration_m_s2": 1.0},
            Command(0.5, 0.0),
            ["top speed", "jerk"],
        ),
        (
            Command(0.0, 5000.0),
            {"compressor_power_w": 4400.0},
            Command(0.0, 4500.0),
            ["compressor power bound"],
        ),
        (Command(0.0, 900.0), {}, Command(0.0, 200.0), ["compressor rate"]),
        (
            Command(-9.0, -1.0),
            {"compressor_power_w": 900.0},
            Command(-0.5, 700.0),
            ["acceleration bound", "jerk", "compressor power bound", "compressor rate"],
        ),
    ],
)
def test_reasons_name_the_active_bounds(
    limiter: CommandLimiter,
    command: Command,
    state: dict[str, float],
    expected: Command,
    reasons: list[str],
) -> None:
    limited, active = limiter.limit(command, make_state(**state))
    assert limited.acceleration_m_s2 == pytest.approx(expected.acceleration_m_s2)
    assert limited.compressor_power_w == pytest.approx(expected.compressor_power_w)
    assert list(active) == reasons


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(("last", "coasting"), [(1.0, 0.5), (-0.7, -0.7), (0.0, 0.0)])
def test_nonsense_coasts_down_and_holds_the_compressor(
    limiter: CommandLimiter, wrong: float, last: float, coasting: float
) -> None:
    state = make_state(acceleration_m_s2=last, compressor_power_w=700.0)
    limited, reasons = limiter.limit(Command(wrong, wrong), state)
    assert limited == Command(coasting, 700.0)
    assert reasons[:2] == ("acceleration not finite", "compressor power not finite")


def test_actuated_values_outside_the_bounds_do_not_pull_the_command_out(
    limiter: CommandLimiter,
) -> None:
    state = make_state(acceleration_m_s2=5.0, compressor_power_w=9000.0)
    limited, _ = limiter.limit(Command(5.0, 9000.0), state)
    limits = PARAMETERS.limits
    assert limited.acceleration_m_s2 <= limits.max_acceleration_m_s2
    assert limited.compressor_power_w <= limits.max_compressor_power_w


def test_the_top_speed_is_that_of_the_end_of_a_tick() -> None:
    limits = PARAMETERS.limits
    limiter = CommandLimiter(limits, 0.1)
    state = make_state(speed_m_s=limits.max_speed_m_s - 0.05, acceleration_m_s2=0.5)
    command, reasons = limiter.limit(Command(1.0, state.compressor_power_w), state)
    assert command.acceleration_m_s2 == pytest.approx(0.5), "0.05 m/s in 0.1 s"
    assert reasons == ("top speed",)


@pytest.mark.parametrize("thermal_w", [-4000.0, 0.0, 2000.0])
def test_a_cold_pack_supplies_traction_and_thermal_power_to_the_end_of_the_tick(
    thermal_w: float,
) -> None:
    """Heating and cooling both draw from it."""
    values = load_parameters("bmw_i3").values
    cold = make_state(cell_1_temperature_k=258.15, cell_n_temperature_k=258.15)
    authority = PowerAuthority(values, 1.0)
    authority.update(cold, FLAT)
    chosen = authority.within(Command(values.limits.max_acceleration_m_s2, thermal_w))
    a_m_s2 = chosen.acceleration_m_s2
    assert 0.0 < a_m_s2 < values.limits.max_acceleration_m_s2
    traction_w = electric_traction_power_w(cold.speed_m_s + a_m_s2, a_m_s2, 0.0, values)
    auxiliary_w = values.cooling.auxiliary_power_w
    drawn_w = battery_power_w(
        traction_w, abs(thermal_w), auxiliary_w, values.pack, values.powertrain
    )
    assert drawn_w == pytest.approx(authority.limits.discharge_w, rel=1e-3)
