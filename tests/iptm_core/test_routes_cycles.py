"""The cycle files against the figures published for the schedules, and the generated cycles."""

from __future__ import annotations

import csv
from importlib import resources

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import (
    CYCLE_NAMES,
    DrivingCycle,
    comprehensive_cycle,
    load_cycle,
    smooth_cycle,
)
from iptm_core.routes.cycles import SPEED_COLUMNS_M_S

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


def test_sum_of_the_wltc_column() -> None:
    assert np.sum(load_cycle("wltc_class3b").speeds_m_s) * 3.6 == pytest.approx(83758.6, abs=1e-6)


def test_every_named_cycle_is_checked_above_and_has_a_file() -> None:
    assert sorted(CYCLE_NAMES) == sorted(row[0] for row in PUBLISHED)
    folder = resources.files("iptm_core.routes") / "data"
    files = {entry.name for entry in folder.iterdir() if entry.name.endswith(".csv")}
    assert files == {f"{name}.csv" for name in CYCLE_NAMES}


@pytest.mark.parametrize("name", CYCLE_NAMES)
def test_files_carry_the_schedule_in_tenths_of_its_unit(name: str) -> None:
    file = resources.files("iptm_core.routes") / "data" / f"{name}.csv"
    header, *rows = csv.reader(file.read_text(encoding="utf-8").splitlines())
    assert header == ["time_s", "speed_kmh" if name == "wltc_class3b" else "speed_mph"]
    factor = SPEED_COLUMNS_M_S[header[1]]
    for second, (row, speed) in enumerate(zip(rows, load_cycle(name).speeds_m_s, strict=True)):
        assert row[0] == str(second)
        assert row[1] == f"{float(row[1]):.1f}"
        assert speed == float(row[1]) * factor


def test_unknown_cycle_names_the_known_ones() -> None:
    with pytest.raises(RouteError, match="unknown driving cycle 'nedc'; allowed: nycc, sc03"):
        load_cycle("nedc")


def test_arrays_cannot_be_changed() -> None:
    cycle = load_cycle("nycc")
    with pytest.raises(ValueError, match="read-only"):
        cycle.speeds_m_s[0] = 1.0


def test_cycle_does_not_alias_the_array_it_was_made_from() -> None:
    speeds = np.array([0.0, 1.0, 0.0])
    cycle = DrivingCycle("own", np.arange(3.0), speeds, "test")
    speeds[1] = 9.0
    assert cycle.speeds_m_s[1] == 1.0


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


def test_comprehensive_cycle_is_1e4_seconds_at_1_hz() -> None:
    cycle = comprehensive_cycle().cycle
    np.testing.assert_array_equal(cycle.times_s, np.arange(10001))
    np.testing.assert_array_equal(cycle.speeds_m_s[:5001], cycle.speeds_m_s[5000:])


def test_comprehensive_segments_are_the_named_cycles() -> None:
    whole = comprehensive_cycle()
    distances = whole.cycle.distances_m()
    names = ["nycc", "sc03", "wltc_class3b", "us06", "smooth"] * 2
    assert [segment.cycle for segment in whole.segments] == names
    ends = [598, 1198, 2998, 3598, 5000, 5598, 6198, 7998, 8598, 10000]
    assert [segment.end_s for segment in whole.segments] == ends
    for segment, before in zip(whole.segments[1:], whole.segments, strict=False):
        assert segment.start_s == before.end_s
        assert segment.start_m == before.end_m
    for segment in whole.segments:
        start, end = int(segment.start_s), int(segment.end_s)
        assert segment.start_m == distances[start]
        assert segment.end_m == distances[end]
        part = smooth_cycle(end - start) if segment.cycle == "smooth" else load_cycle(segment.cycle)
        np.testing.assert_array_equal(whole.cycle.speeds_m_s[start : end + 1], part.speeds_m_s)


def test_slopes_alternate_and_every_segment_meets_both() -> None:
    kinds = [segment.slope_kind for segment in comprehensive_cycle().segments]
    assert kinds == ["large", "small"] * 5
    assert all(first != second for first, second in zip(kinds[:5], kinds[5:], strict=True))
    assert [segment.name for segment in comprehensive_cycle().segments][::5] == [
        "1: nycc L",
        "2: nycc S",
    ]
