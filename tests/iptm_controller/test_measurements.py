"""Measurements that no vehicle can produce are refused by name."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_controller.scenes import make_leader, make_scene, make_state

from iptm_controller.measurements import (
    leader_fault,
    slope_fault,
    trusted_measurements,
)
from iptm_core.state import SlopePreview, VehicleState

UNUSED = "state_of_charge"
"""The controller's model has a constant charge."""
QUANTITIES = [entry.name for entry in fields(VehicleState) if entry.name != UNUSED]
IMPOSSIBLE = {
    "time_s": -1.0,
    "position_m": 2e9,
    "speed_m_s": -0.6,
    "acceleration_m_s2": 25.0,
    "compressor_power_w": -20001.0,
    "cell_1_temperature_k": 35.0,  # degrees Celsius by mistake
    "cell_n_temperature_k": 400.0,
    "cell_1_capacity_loss": 0.0,
    "cell_n_capacity_loss": 1.0,
}


MOTION = QUANTITIES[:4]
"""Quantities of the motion; the others are of the pack, see ``test_pack_observer``."""


def state_fault(state: VehicleState) -> str:
    return trusted_measurements(replace(make_scene(), state=state, leader=None, fault="none"))[2]


@pytest.mark.parametrize("error_m_s", [-1e-9, -0.3])
def test_small_negative_speeds_are_those_of_a_vehicle_at_rest(error_m_s: float) -> None:
    leader = make_leader(speed_m_s=error_m_s)
    measured = replace(make_scene(), state=make_state(speed_m_s=error_m_s), leader=leader)
    state, leader, fault = trusted_measurements(measured)
    assert fault == ""
    assert state.speed_m_s == leader.speed_m_s == 0.0


@pytest.mark.parametrize("name", MOTION)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, None])
def test_every_quantity_is_checked(name: str, value: float | None) -> None:
    wrong = IMPOSSIBLE[name] if value is None else value
    fault = state_fault(make_state(**{name: wrong}))
    assert fault.startswith(f"measured {name} is {wrong}; allowed: ")


@pytest.mark.parametrize("gap_m", [-30.0, -1.0, 0.0, 40.0, 5000.0])
def test_leader_ahead_or_overlapping_passes(gap_m: float) -> None:
    """An overlap is measured when it is too late, or too early for the radar: the brakes must know."""
    assert leader_fault(make_leader(gap_m), make_state()) == ""


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"speed_m_s": math.nan}, "leader speed is nan"),
        ({"speed_m_s": -0.6}, "leader speed is -0.6"),
        ({"speed_m_s": 101.0}, "leader speed is 101"),
        ({"position_m": math.nan}, "gap is nan"),
        ({"position_m": math.inf}, "gap is inf"),
        ({"position_m": -1e5}, "gap is -101000.0 m"),
        ({"position_m": 1e9}, "allowed: -10000 to 10000 m"),
        ({"time_s": 200.0}, "100.0 s apart from the ego vehicle"),
        ({"time_s": math.nan}, "leader time is nan"),
        ({"time_s": math.inf}, "leader time is inf"),
    ],
)
def test_leader_is_checked(change: dict[str, float], complaint: str) -> None:
    assert complaint in leader_fault(replace(make_leader(), **change), make_state())


@pytest.mark.parametrize(
    ("positions", "slopes", "complaint"),
    [
        ([], [], "0 positions and 0 slopes"),
        ([0.0, 1.0], [0.0], "2 positions and 1 slopes"),
        ([0.0, math.nan], [0.0, 0.0], "not finite"),
        ([0.0, 1.0], [0.0, math.inf], "not finite"),
        ([0.0, 1.0], [0.0, -1.6], "slope is 1.6 rad"),
    ],
)
def test_road_is_checked(positions: list[float], slopes: list[float], complaint: str) -> None:
    assert complaint in slope_fault(SlopePreview(np.array(positions), np.array(slopes)))


@given(values=st.lists(st.floats(), min_size=len(QUANTITIES), max_size=len(QUANTITIES)))
def test_what_passes_is_finite(values: list[float]) -> None:
    state = trusted_measurements(replace(make_scene(), state=VehicleState(*values)))[0]
    assert state is None or all(math.isfinite(getattr(state, name)) for name in MOTION)


@pytest.mark.parametrize(
    ("change", "state_kept", "leader_kept"),
    [
        ({}, True, True),
        ({"state": None}, False, False),
        ({"leader": None}, True, False),
        ({"slope": SlopePreview(np.empty(0), np.empty(0))}, True, True),
    ],
)
def test_what_builds_on_a_missing_part_is_left_out(
    change: dict[str, Any], state_kept: bool, leader_kept: bool
) -> None:
    state, leader, fault = trusted_measurements(replace(make_scene(), **change))
    assert (state is not None, leader is not None) == (state_kept, leader_kept)
    assert bool(fault) is bool(change)
