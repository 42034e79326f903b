"""Motion of the leader: exact integration, before the start and after the end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import DrivingCycle, LeaderMotion, comprehensive_cycle, load_cycle
from iptm_core.routes.cycles import FINAL_BRAKING_M_S2


def _leader(speeds: list[float], gap_m: float = 15.0) -> LeaderMotion:
    trace = np.array(speeds)
    return LeaderMotion.from_cycle(
        DrivingCycle("own", np.arange(float(trace.size)), trace, "test"), gap_m
    )


def test_position_between_samples_is_the_exact_parabola() -> None:
    leader = _leader([0.0, 2.0, 2.0, 0.0])
    times = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0])
    np.testing.assert_allclose(leader.speeds_at(times), [0, 1, 2, 2, 2, 1, 0])
    np.testing.assert_allclose(
        leader.positions_at(times), 15.0 + np.array([0, 0.25, 1, 2, 3, 3.75, 4]), rtol=1e-15
    )


def test_leader_stands_before_the_start_and_after_the_end() -> None:
    leader = _leader([0.0, 2.0, 0.0])
    for time_s, position_m in [(-1e9, 15.0), (-0.1, 15.0), (2.0, 17.0), (2.1, 17.0), (1e9, 17.0)]:
        state = leader.state_at(time_s)
        assert (state.time_s, state.position_m, state.speed_m_s) == (time_s, position_m, 0.0)


def test_leader_brakes_when_its_trace_ends_at_speed() -> None:
    leader = _leader([0.0, 3.0, 3.0])
    assert FINAL_BRAKING_M_S2 == 1.5
    np.testing.assert_allclose(leader.speeds_at([2.0, 3.0, 4.0, 5.0]), [3.0, 1.5, 0.0, 0.0])
    np.testing.assert_allclose(
        leader.positions_at([2.0, 3.0, 4.0, 5.0]) - 15.0, [4.5, 6.75, 7.5, 7.5]
    )


def test_motion_of_a_published_cycle_covers_its_distance() -> None:
    cycle = load_cycle("us06")
    leader = LeaderMotion.from_cycle(cycle, 20.0)
    assert leader.start_position_m == 20.0
    np.testing.assert_allclose(leader.positions_at(cycle.times_s) - 20.0, cycle.distances_m())
    np.testing.assert_array_equal(leader.speeds_at(cycle.times_s), cycle.speeds_m_s)


@given(
    st.lists(st.floats(0.0, 40.0), min_size=2, max_size=30),
    st.lists(st.floats(-5.0, 80.0), min_size=2, max_size=30),
)
def test_position_is_the_integral_of_speed_and_never_decreases(
    speeds: list[float], times: list[float]
) -> None:
    leader = _leader(speeds)
    instants = np.sort(np.array(times))
    positions = leader.positions_at(instants)
    assert np.all(np.diff(positions) >= -1e-9)
    assert np.all(leader.speeds_at(instants) >= 0.0)
    for start, end, travelled in zip(instants, instants[1:], np.diff(positions), strict=False):
        # Between kinks of the speed, Simpson's rule integrates it exactly.
        inside = leader.times_s[(leader.times_s > start) & (leader.times_s < end)]
        edges = np.concatenate([[start], inside, [end]])
        middles = 0.5 * (edges[1:] + edges[:-1])
        # Speed jumps at t = 0 if the trace starts at speed, so only interior points are read.
        exact = float(np.dot(leader.speeds_at(middles), np.diff(edges)))
        assert travelled == pytest.approx(exact, abs=1e-9)


@given(st.lists(st.floats(-5.0, 80.0), min_size=1, max_size=8))
def test_scalar_and_vector_queries_agree(times: list[float]) -> None:
    leader = _leader([0.0, 4.0, 9.0, 2.0])
    for index, time_s in enumerate(times):
        state = leader.state_at(time_s)
        assert type(state.position_m) is float
        assert type(state.speed_m_s) is float
        assert state.position_m == leader.positions_at(times)[index]
        assert state.speed_m_s == leader.speeds_at(times)[index]


def test_queries_keep_their_shape() -> None:
    leader = _leader([0.0, 4.0, 0.0])
    assert leader.positions_at(np.zeros((2, 3))).shape == (2, 3)
    assert leader.positions_at([]).shape == (0,)
    assert leader.speeds_at([]).shape == (0,)


def test_comprehensive_leader_ends_where_the_road_does() -> None:
    cycle = comprehensive_cycle().cycle
    leader = LeaderMotion.from_cycle(cycle, 15.0)
    assert leader.state_at(10000.0).position_m == pytest.approx(15.0 + cycle.distance_m, abs=1e-6)


@pytest.mark.parametrize(
    ("times", "speeds", "start", "message"),
    [
        ([0.0, 1.0], [0.0, 1.0], 15.0, r"ends at 1\.0 m/s; allowed: 0"),
        ([0.0, 1.0, 2.0], [0.0, -1.0, 0.0], 15.0, r"speed -1\.0 m/s at 1\.0 s"),
        ([0.0, 1.0], [0.0, 0.0], np.nan, "start at nan m"),
        ([1.0, 0.0], [0.0, 0.0], 15.0, "strictly increase"),
    ],
)
def test_malformed_motion_is_refused(
    times: list[float], speeds: list[float], start: float, message: str
) -> None:
    with pytest.raises(RouteError, match=message):
        LeaderMotion(np.array(times), np.array(speeds), start)
