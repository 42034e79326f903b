"""The cycle files against the figures published for the schedules, and the motion of a leader."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import (
    DrivingCycle,
    LeaderMotion,
    load_cycle,
    smooth_cycle,
)
from iptm_core.routes.cycles import FINAL_BRAKING_M_S2

MILE_M = 1609.344

# name, duration s, distance, mean, maximum; miles and mph, kilometres and km/h for the WLTC.
PUBLISHED = [
    ("nycc", 598, "1.1796", "7.10", "27.7"),
    ("sc03", 600, "3.5795", "21.48", "54.8"),
    ("us06", 600, "8.008", "48.05", "80.3"),
    ("wltc_class3b", 1800, "23.266", "46.53", "131.3"),
    ("hwfet", 765, "10.257", "48.27", "59.9"),
    ("udds", 1369, "7.450", "19.59", "56.7"),
]


def _to_printed_digits(value: float, printed: str) -> str:
    return f"{value:.{len(printed.partition('.')[2])}f}"


@pytest.mark.parametrize(("name", "duration_s", "distance", "mean", "maximum"), PUBLISHED)
def test_cycle_matches_the_published_figures(
    name: str, duration_s: int, distance: str, mean: str, maximum: str
) -> None:
    cycle = load_cycle(name)
    length_m, speed_m_s = (1000.0, 1 / 3.6) if name == "wltc_class3b" else (MILE_M, 0.44704)
    assert cycle.duration_s == duration_s
    assert cycle.times_s.size == duration_s + 1
    assert _to_printed_digits(cycle.distance_m / length_m, distance) == distance
    mean_m_s = cycle.distance_m / cycle.duration_s
    assert _to_printed_digits(mean_m_s / speed_m_s, mean) == mean
    assert _to_printed_digits(cycle.max_speed_m_s / speed_m_s, maximum) == maximum
    assert cycle.speeds_m_s[0] == cycle.speeds_m_s[-1] == 0.0


def test_unknown_cycle_names_the_known_ones() -> None:
    with pytest.raises(RouteError, match="unknown driving cycle 'nedc'; allowed: nycc, sc03"):
        load_cycle("nedc")


@pytest.mark.parametrize(
    ("times", "speeds", "message"),
    [
        ([0.0, 1.0], [0.0, -0.1], r"speed -0\.1 m/s at 1\.0 s"),
        ([0.0, 2.0], [0.0, 1.0], "at 0, 1, 2, ... s"),
        ([1.0, 2.0], [0.0, 1.0], "at 0, 1, 2, ... s"),
        ([0.0], [0.0], "at least two samples"),
        ([0.0, 1.0], [0.0, np.nan], r"node 1 is \(1\.0, nan\)"),
        ([0.0, 1.0], [0.0], "equally long"),
        ([], [], "non-empty"),
        ([0.0, 0.0], [0.0, 1.0], "strictly increase"),
    ],
)
def test_malformed_cycles_are_refused(
    times: list[float], speeds: list[float], message: str
) -> None:
    with pytest.raises(RouteError, match=message):
        DrivingCycle("own", np.array(times), np.array(speeds), "test")


@given(st.integers(360, 20000))
def test_smooth_cycle_is_gentle_and_ends_at_rest(duration_s: int) -> None:
    cycle = smooth_cycle(duration_s)
    speeds = cycle.speeds_m_s
    assert cycle.duration_s == duration_s
    assert speeds[0] == speeds[-1] == 0.0
    assert np.max(np.abs(np.diff(speeds))) < 0.35
    assert np.max(speeds) <= 120.0 / 3.6
    assert np.max(speeds) > 119.0 / 3.6
    assert np.min(speeds[90:-90]) >= 60.0 / 3.6 - 1e-9
    assert np.max(np.abs(np.diff(speeds, 2))) < 0.02, "no jumps of acceleration"


@pytest.mark.parametrize("duration_s", [359, 0, -5, 1000.5])
def test_smooth_cycle_refuses_odd_durations(duration_s: float) -> None:
    with pytest.raises(RouteError, match="whole seconds, at least 360"):
        smooth_cycle(duration_s)  # type: ignore[arg-type]


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
