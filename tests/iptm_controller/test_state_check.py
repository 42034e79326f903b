"""Measurements that no vehicle can produce are refused by name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_controller.state_check import check_leader, check_slope, check_state
from iptm_core.errors import StateError
from iptm_core.state import LeaderState, SlopePreview, VehicleState

QUANTITIES = [entry.name for entry in fields(VehicleState)]
IMPOSSIBLE = {
    "time_s": -1.0,
    "position_m": 2e9,
    "speed_m_s": -0.1,
    "acceleration_m_s2": 25.0,
    "compressor_power_w": -1.0,
    "cell_1_temperature_k": 35.0,  # degrees Celsius by mistake
    "cell_n_temperature_k": 400.0,
    "cell_1_capacity_loss": 0.0,
    "cell_n_capacity_loss": 1.0,
}


def test_an_ordinary_state_passes(make_state: Callable[..., VehicleState]) -> None:
    check_state(make_state())
    check_state(make_state(speed_m_s=0.0, time_s=0.0, position_m=-5.0))


@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, None])
def test_every_quantity_is_checked(
    make_state: Callable[..., VehicleState], name: str, value: float | None
) -> None:
    wrong = IMPOSSIBLE[name] if value is None else value
    with pytest.raises(StateError, match=f"measured {name} = .*, allowed are"):
        check_state(make_state(**{name: wrong}))


@pytest.mark.parametrize("gap_m", [-1.0, 0.0, 40.0, 5000.0])
def test_leader_ahead_passes(
    make_state: Callable[..., VehicleState], make_leader: Callable[..., LeaderState], gap_m: float
) -> None:
    """A bumper that touches is measured within a metre of noise."""
    check_leader(make_leader(gap_m), make_state())


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"speed_m_s": math.nan}, "leader speed = nan"),
        ({"speed_m_s": -0.5}, "leader speed = -0.5"),
        ({"speed_m_s": 101.0}, "leader speed = 101"),
        ({"position_m": math.nan}, "gap = nan"),
        ({"position_m": math.inf}, "gap = inf"),
        ({"position_m": 990.0}, "gap = -10.0 m"),
        ({"position_m": 1e9}, "allowed are -1 to 10000 m"),
        ({"time_s": 200.0}, "100.0 s apart from the host"),
        ({"time_s": math.nan}, "leader time = nan"),
        ({"time_s": math.inf}, "leader time = inf"),
    ],
)
def test_leader_is_checked(
    make_state: Callable[..., VehicleState],
    make_leader: Callable[..., LeaderState],
    change: dict[str, float],
    complaint: str,
) -> None:
    with pytest.raises(StateError) as caught:
        check_leader(replace(make_leader(), **change), make_state())
    assert complaint in str(caught.value)


@pytest.mark.parametrize(
    ("positions", "slopes", "complaint"),
    [
        ([], [], "0 positions and 0 slopes"),
        ([0.0, 1.0], [0.0], "2 positions and 1 slopes"),
        ([0.0, math.nan], [0.0, 0.0], "not finite"),
        ([0.0, 1.0], [0.0, math.inf], "not finite"),
        ([0.0, 1.0], [0.0, -1.6], "slope of 1.6 rad"),
    ],
)
def test_road_is_checked(positions: list[float], slopes: list[float], complaint: str) -> None:
    with pytest.raises(StateError, match=complaint):
        check_slope(SlopePreview(np.array(positions), np.array(slopes)))


def test_a_flat_road_passes() -> None:
    check_slope(SlopePreview(np.zeros(1), np.zeros(1)))


@given(values=st.lists(st.floats(), min_size=len(QUANTITIES), max_size=len(QUANTITIES)))
def test_what_passes_is_finite(values: list[float]) -> None:
    state = VehicleState(*values)
    try:
        check_state(state)
    except StateError:
        return
    assert all(math.isfinite(value) for value in values)
