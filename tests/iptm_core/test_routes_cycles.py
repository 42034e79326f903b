"""The cycle files against published figures of the schedules, noise in logged speeds, motion of a leader."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

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
from iptm_core.routes.cycles import (
    CYCLE_NAMES,
    FINAL_BRAKING_M_S2,
    NOTED_NOISE_M_S,
    smoothed,
    speed_noise_m_s,
)
from iptm_core.routes.route import build_route

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


LOGGER_M_S = 0.6 / 3.6


def noisy(name: str, seed: int = 3) -> DrivingCycle:
    cycle = load_cycle(name)
    noise = np.random.default_rng(seed).normal(0.0, LOGGER_M_S, cycle.speeds_m_s.size)
    moving = cycle.speeds_m_s > 0.0
    return replace(cycle, speeds_m_s=np.maximum(cycle.speeds_m_s + noise * moving, 0.0))


@pytest.mark.parametrize("name", CYCLE_NAMES)
def test_noise_of_a_logger_is_told_from_a_driver(name: str) -> None:
    assert speed_noise_m_s(load_cycle(name)) < NOTED_NOISE_M_S < speed_noise_m_s(noisy(name))


def test_the_noise_of_a_steady_drive_is_what_was_added() -> None:
    speeds = 20.0 + np.random.default_rng(1).normal(0.0, 0.2, 4000)
    steady = DrivingCycle("steady", np.arange(4000.0), speeds, "made up")
    assert speed_noise_m_s(steady) == pytest.approx(0.2, rel=0.05)


def test_smoothing_keeps_stops_length_and_distance_and_takes_the_noise() -> None:
    drive = noisy("wltc_class3b")
    calm = smoothed(drive, 9.0)
    assert calm.distance_m == pytest.approx(drive.distance_m)
    assert calm.duration_s == drive.duration_s
    assert np.array_equal(calm.speeds_m_s == 0.0, drive.speeds_m_s == 0.0)
    assert speed_noise_m_s(calm) < 0.3 * speed_noise_m_s(drive)
    true = load_cycle("wltc_class3b").speeds_m_s
    left, had = (np.std(each.speeds_m_s - true) for each in (calm, drive))
    assert left < 0.85 * had
    assert smoothed(drive, 1.0) is drive


def test_by_hand() -> None:
    speeds = np.array([0.0, 3.0, 9.0, 6.0, 12.0, 6.0, 0.0])
    cycle = DrivingCycle("hill", np.arange(7.0), speeds, "made up")
    # Five rows fit in from the third to the fifth one: weights -3, 12, 17, 12 and -3 of 35.
    fitted = speeds.copy()
    for row in (2, 3, 4):
        fitted[row] = np.dot(speeds[row - 2 : row + 3], [-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
    expected = fitted * speeds.sum() / fitted.sum()
    assert smoothed(cycle, 5.0).speeds_m_s == pytest.approx(expected)
    # No window reaches beyond a stop.
    twice = DrivingCycle("hills", np.arange(14.0), np.tile(speeds, 2), "made up")
    assert smoothed(twice, 5.0).speeds_m_s == pytest.approx(np.tile(expected, 2))


def test_a_parabola_stays_to_its_end_in_motion() -> None:
    times_s = np.arange(30.0)
    speeds = 0.02 * times_s**2 + 0.1 * times_s
    cycle = DrivingCycle("parabola", times_s, speeds, "made up")
    assert smoothed(cycle, 9.0).speeds_m_s == pytest.approx(speeds)


def test_a_noisy_file_has_a_note_and_a_smoothed_one_has_none(tmp_path: Path) -> None:
    drive = noisy("hwfet")
    file = tmp_path / "log.csv"
    rows = zip(drive.times_s.tolist(), drive.speeds_m_s.tolist(), strict=True)
    file.write_text("time_s,speed_m_s\n" + "".join(f"{t},{v}\n" for t, v in rows))
    (note,) = build_route(str(file), initial_gap_m=15.0).notes
    assert "the speed trace is noisy (0.1" in note
    assert not build_route(str(file), initial_gap_m=15.0, smooth_s=9.0).notes
