"""Bounds, rates and nonsense at the actuators."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.physics.car_following import controlled_stop_command
from iptm_core.state import Command, VehicleState
from iptm_plant_sim.actuators import Clamp, limit_command

LIMITS = load_parameters().values.limits
ANYTHING = st.floats(allow_nan=True, allow_infinity=True)


def state(
    acceleration: float = 0.0, compressor: float = 1000.0, speed: float = 10.0
) -> VehicleState:
    return VehicleState(0.0, 0.0, speed, acceleration, compressor, 308.0, 308.0, 1e-3, 1e-3)


def test_reachable_command_passes_unchanged_and_unreported() -> None:
    command = Command(0.5, 1200.0)
    report = limit_command(command, state(), LIMITS, 1.0)
    assert report.actuated == report.requested == command
    assert report.clamps == ()
    assert report.reason == ""


@pytest.mark.parametrize(
    ("command", "clamps", "actuated"),
    [
        (Command(0.6, 1000.0), (Clamp.JERK,), Command(0.5, 1000.0)),
        (Command(-9.0, 1000.0), (Clamp.ACCELERATION_BOUND, Clamp.JERK), Command(-0.5, 1000.0)),
        (Command(0.0, 1500.0), (Clamp.COMPRESSOR_RATE,), Command(0.0, 1200.0)),
        (Command(0.0, 0.0), (Clamp.COMPRESSOR_RATE,), Command(0.0, 800.0)),
        (
            Command(0.0, -5.0),
            (Clamp.COMPRESSOR_BOUND, Clamp.COMPRESSOR_RATE),
            Command(0.0, 800.0),
        ),
    ],
)
def test_the_limit_that_acts_is_reported(
    command: Command, clamps: tuple[Clamp, ...], actuated: Command
) -> None:
    report = limit_command(command, state(), LIMITS, 1.0)
    assert report.clamps == clamps
    assert report.actuated == actuated
    for clamp in clamps:
        assert clamp.value in report.reason


def test_rounding_is_corrected_but_not_reported() -> None:
    report = limit_command(Command(2.0 + 1e-12, -1e-9), state(1.6, 100.0), LIMITS, 1.0)
    assert report.clamps == ()
    assert report.actuated == Command(2.0, 0.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", ["acceleration_m_s2", "compressor_power_w"])
def test_nonsense_becomes_the_controlled_stop(bad: float, which: str) -> None:
    present = state(acceleration=1.0)
    report = limit_command(replace(Command(1.0, 1000.0), **{which: bad}), present, LIMITS, 1.0)
    assert report.clamps == (Clamp.NON_FINITE,)
    assert report.actuated == controlled_stop_command(present, LIMITS)
    assert report.actuated.acceleration_m_s2 == 0.5


@given(
    acceleration=ANYTHING,
    compressor=ANYTHING,
    last_acceleration=st.floats(-2.0, 2.0),
    last_compressor=st.floats(0.0, 4500.0),
    duration=st.floats(0.01, 10.0),
)
def test_actuated_values_always_lie_inside_all_limits(
    acceleration: float,
    compressor: float,
    last_acceleration: float,
    last_compressor: float,
    duration: float,
) -> None:
    present = state(last_acceleration, last_compressor)
    report = limit_command(Command(acceleration, compressor), present, LIMITS, duration)
    done = report.actuated
    assert -2.0 <= done.acceleration_m_s2 <= 2.0
    assert abs(done.acceleration_m_s2 - last_acceleration) <= 0.5 * duration + 1e-12
    assert 0.0 <= done.compressor_power_w <= 4500.0
    assert abs(done.compressor_power_w - last_compressor) <= 200.0 * duration + 1e-9
    finite = math.isfinite(acceleration) and math.isfinite(compressor)
    assert (Clamp.NON_FINITE in report.clamps) == (not finite)
