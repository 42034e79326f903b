"""Wheel force by hand, and motion under constant acceleration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.traction import (
    advance_position_m,
    advance_speed_m_s,
    traction_force_n,
)

Agree = Callable[..., None]


def test_force_on_a_level_road_is_rolling_resistance_and_drag(parameters: ModelParameters) -> None:
    # 1432 * 9.8 * 0.015 = 210.504 N; 0.5 * 0.3 * 2.22 * 1.026 * 20^2 = 136.6632 N
    assert traction_force_n(0.0, 0.0, 0.0, parameters.body) == pytest.approx(210.504, rel=1e-12)
    assert traction_force_n(20.0, 0.0, 0.0, parameters.body) == pytest.approx(347.1672, rel=1e-12)


def test_force_of_inertia_carries_the_rotating_masses(parameters: ModelParameters) -> None:
    # 1432 * 1.022 * 1.5 = 2195.256 N on top, both ways
    coasting = traction_force_n(20.0, 0.0, 0.0, parameters.body)
    for sign in (1.0, -1.0):
        force = traction_force_n(20.0, sign * 1.5, 0.0, parameters.body)
        assert force - coasting == pytest.approx(sign * 2195.256, rel=1e-12)


def test_force_on_a_slope(parameters: ModelParameters) -> None:
    # 3 m in 5 m: sin = 0.6, cos = 0.8; weight 14033.6 N
    uphill = traction_force_n(0.0, 0.0, math.asin(0.6), parameters.body)
    assert uphill == pytest.approx(14033.6 * (0.6 + 0.015 * 0.8), rel=1e-12)
    downhill = traction_force_n(0.0, 0.0, -math.asin(0.6), parameters.body)
    assert downhill == pytest.approx(14033.6 * (-0.6 + 0.015 * 0.8), rel=1e-12)


def test_every_term_vanishes_with_its_own_coefficient(parameters: ModelParameters) -> None:
    body = replace(parameters.body, rolling_resistance=0.0, drag_coefficient=0.0)
    assert traction_force_n(30.0, 0.0, 0.0, body) == 0.0
    assert traction_force_n(30.0, 0.0, 0.02, body) == pytest.approx(
        body.mass_kg * body.gravity_m_s2 * math.sin(0.02), rel=1e-12
    )


@given(
    speed=st.floats(0.0, 37.5),
    acceleration=st.floats(-2.0, 2.0),
    first_s=st.floats(0.0, 10.0),
    second_s=st.floats(0.0, 10.0),
)
def test_two_short_steps_are_one_long_step(
    speed: float, acceleration: float, first_s: float, second_s: float
) -> None:
    half_way = advance_speed_m_s(speed, acceleration, first_s)
    position = advance_position_m(
        advance_position_m(100.0, speed, acceleration, first_s), half_way, acceleration, second_s
    )
    whole = first_s + second_s
    assert advance_speed_m_s(half_way, acceleration, second_s) == pytest.approx(
        advance_speed_m_s(speed, acceleration, whole), abs=1e-12
    )
    assert position == pytest.approx(
        advance_position_m(100.0, speed, acceleration, whole), abs=1e-10
    )


def test_motion_by_hand() -> None:
    # from 10 m/s with -2 m/s^2 for 3 s: 10 - 6 = 4 m/s, 30 - 9 = 21 m
    assert advance_speed_m_s(10.0, -2.0, 3.0) == 4.0
    assert advance_position_m(5.0, 10.0, -2.0, 3.0) == 26.0


def test_all_backends_agree(parameters: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(1)
    speed, acceleration = random.uniform(0.0, 37.5, 40), random.uniform(-2.0, 2.0, 40)
    slope = random.uniform(-0.06, 0.06, 40)
    agree_in_all_backends(
        lambda v, a, theta: traction_force_n(v, a, theta, parameters.body),
        speed,
        acceleration,
        slope,
    )
    agree_in_all_backends(lambda v, a: advance_speed_m_s(v, a, 5.0), speed, acceleration)
    agree_in_all_backends(lambda p, v, a: advance_position_m(p, v, a, 5.0), speed, speed, slope)
