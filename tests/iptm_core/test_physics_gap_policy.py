"""The smallest permitted gap of the intelligent driver model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m

Agree = Callable[..., None]
VALUES = load_parameters().values
SPEEDS = st.floats(0.0, 37.5)


def gap(speed: float, leader_speed: float) -> float:
    value: float = minimum_gap_m(speed, leader_speed, VALUES.gap, VALUES.limits)
    return value


def test_by_hand() -> None:
    # s_st + v T_h + v (v - v_PV) / (2 sqrt(2 * 2)) = 5 + 1.5 v + v (v - v_PV) / 4
    assert gap(0.0, 0.0) == 5.0
    assert gap(0.0, 30.0) == 5.0
    assert gap(20.0, 20.0) == 35.0
    assert gap(20.0, 10.0) == pytest.approx(35.0 + 50.0, rel=1e-12)
    assert gap(20.0, 0.0) == pytest.approx(35.0 + 100.0, rel=1e-12)
    assert gap(20.0, 25.0) == pytest.approx(35.0 - 25.0, rel=1e-12)


def test_behind_a_leader_that_pulls_away_the_printed_gap_falls_below_the_standstill_gap() -> None:
    assert gap(20.0, 30.0) == pytest.approx(-15.0, rel=1e-12)


def test_stronger_brakes_allow_a_closer_approach() -> None:
    strong = replace(VALUES.limits, min_acceleration_m_s2=-8.0)
    # 2 sqrt(8 * 2) = 8 instead of 4
    assert minimum_gap_m(20.0, 10.0, VALUES.gap, strong) == pytest.approx(35.0 + 25.0, rel=1e-12)


@given(speed=SPEEDS, leader=SPEEDS)
def test_the_gap_shrinks_with_the_leaders_speed(speed: float, leader: float) -> None:
    assert gap(speed, leader + 1.0) <= gap(speed, leader)
    assert gap(speed, speed) == pytest.approx(5.0 + 1.5 * speed, rel=1e-12)


@given(speed=SPEEDS, leader=SPEEDS)
def test_approaching_needs_more_than_the_headway_gap(speed: float, leader: float) -> None:
    beyond_headway = gap(speed, leader) - (5.0 + 1.5 * speed)
    assert beyond_headway * (speed - leader) >= -1e-9


def test_all_backends_agree(parameters: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(11)
    agree_in_all_backends(
        lambda v, leader: minimum_gap_m(v, leader, parameters.gap, parameters.limits),
        random.uniform(0.0, 37.5, 40),
        random.uniform(0.0, 37.5, 40),
    )
