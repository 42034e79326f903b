"""Routes put together from a cycle, a slope choice and a gap; compositions of the comprehensive cycle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.routes import (
    ROUTE_CYCLES,
    SLOPE_CHOICES,
    build_route,
    comprehensive_cycle,
    load_cycle,
)
from iptm_core.routes.comprehensive import (
    RouteComposition,
    composition_names,
    load_composition,
    read_composition,
)

CSV = "time_s,speed_m_s,slope_percent\n" + "\n".join(
    f"{second},{min(second, 20, 120 - second)},1.5" for second in range(121)
)


@pytest.mark.parametrize("cycle", ROUTE_CYCLES)
@pytest.mark.parametrize("slope", SLOPE_CHOICES)
def test_every_cycle_can_be_driven_on_every_slope(cycle: str, slope: str) -> None:
    route = build_route(cycle, slope, initial_gap_m=15.0)
    assert route.name == f"{cycle}, slope {slope}"
    assert route.leader.state_at(0.0).position_m == 15.0
    assert route.leader.state_at(route.duration_s).speed_m_s == 0.0
    assert route.segments[0].start_s == 0.0
    assert route.segments[-1].end_s == route.duration_s
    travelled = route.leader.state_at(route.duration_s).position_m - 15.0
    assert route.segments[-1].end_m == pytest.approx(travelled)
    composed = slope == "as_designed" and cycle in composition_names()
    climb = np.arctan(load_composition(cycle).mean_climb) if composed else 0.0
    peak = np.max(np.abs(np.tan(route.slope.slopes_rad - climb)))
    expected = {"small": 0.02, "large": 0.06}.get(slope, 0.0)
    if composed:
        expected = load_composition(cycle).large_grade
    assert peak == pytest.approx(expected, rel=5e-3)


def test_slope_choice_replaces_the_designed_one_in_every_segment() -> None:
    route = build_route("comprehensive", "small", initial_gap_m=15.0)
    assert {segment.slope_kind for segment in route.segments} == {"small"}
    designed = build_route("comprehensive", initial_gap_m=15.0)
    assert designed.segments == comprehensive_cycle()[1]


def test_a_cut_trip_keeps_the_motion_beyond_its_end() -> None:
    cut = build_route("us06", initial_gap_m=15.0, duration_s=60)
    whole = build_route("us06", initial_gap_m=15.0)
    assert cut.duration_s == 60.0
    times = np.arange(0.0, 700.0, 0.5)
    np.testing.assert_array_equal(cut.leader.positions_at(times), whole.leader.positions_at(times))
    assert cut.leader.state_at(61.0).speed_m_s == load_cycle("us06").speeds_m_s[61] > 0.0


def test_a_longer_trip_ends_with_a_standing_leader() -> None:
    route = build_route("nycc", initial_gap_m=15.0, duration_s=650.0)
    assert route.duration_s == 650.0
    assert route.leader.state_at(650.0).speed_m_s == 0.0


@pytest.mark.parametrize("as_text", [True, False])
def test_csv_files_are_routes_too(tmp_path: Path, *, as_text: bool) -> None:
    path = tmp_path / "my commute.CSV"
    path.write_text(CSV, encoding="utf-8")
    route = build_route(str(path) if as_text else path, initial_gap_m=15.0)
    assert route.name == "my commute, slope as_designed"
    assert route.duration_s == 120.0
    assert route.segments[0].slope_kind == "measured"
    np.testing.assert_allclose(route.slope.slopes_rad, np.arctan(0.015))
    level = build_route(path, "flat", initial_gap_m=15.0)
    assert level.segments[0].slope_kind == "flat"
    np.testing.assert_array_equal(level.slope.slopes_rad, [0.0])


def test_csv_without_road_column_is_level(tmp_path: Path) -> None:
    path = tmp_path / "trip.csv"
    path.write_text("time_s,speed_m_s\n0,0\n5,5\n10,0\n", encoding="utf-8")
    route = build_route(path, initial_gap_m=15.0)
    assert route.segments[0].slope_kind == "flat"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cycle": "nedc"}, r"unknown driving cycle 'nedc'; allowed: nycc, .*\.csv"),
        ({"cycle": ""}, "unknown driving cycle ''"),
        ({"cycle": "missing.csv"}, "no such file"),
        ({"cycle": "bad\0name.csv"}, "cannot be read"),
        (
            {"slope": "alpine"},
            "slope is 'alpine'; allowed: as_designed, flat, small, large",
        ),
        ({"initial_gap_m": 0.0}, r"initial gap is 0\.0 m"),
        ({"initial_gap_m": np.nan}, "initial gap is nan m"),
        ({"duration_s": 0.0}, r"trip is 0\.0 s"),
        ({"duration_s": np.inf}, "trip is inf s"),
        ({"duration_s": np.nan}, "trip is nan s"),
    ],
)
def test_wrong_choices_are_explained(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(RouteError, match=message):
        build_route(**{"initial_gap_m": 15.0, **arguments})  # type: ignore[arg-type]


SHIPPED = [load_composition(name) for name in composition_names()]
STEEP = RouteComposition(
    "steep",
    ("nycc", "wltc_class3b", "us06", "sc03", "smooth"),
    large_grade=0.16,
    small_grade=0.05,
    mean_climb=0.02,
    hill_length_m=1500.0,
    smooth_low_km_h=80.0,
    smooth_high_km_h=110.0,
)


def test_the_first_composition_stays_what_it_was() -> None:
    assert load_composition("comprehensive") == RouteComposition("comprehensive")
    assert set(composition_names()) <= set(ROUTE_CYCLES)


@pytest.mark.parametrize("composition", [*SHIPPED, STEEP], ids=lambda entry: entry.name)
def test_every_composition_is_two_passes_of_5000_s_in_its_order(
    composition: RouteComposition,
) -> None:
    cycle, segments, _ = comprehensive_cycle(composition)
    assert cycle.duration_s == 10_000.0
    assert tuple(segment.cycle for segment in segments) == composition.order * 2
    assert segments[len(composition.order)].start_s == 5000.0
    # Five parts are odd, so that every part meets both kinds of hills.
    first, second = segments[:5], segments[5:]
    assert first[0].slope_kind == composition.first_slope
    assert all(a.slope_kind != b.slope_kind for a, b in zip(first, second, strict=True))
    for segment, before in zip(segments[1:], segments, strict=False):
        assert (segment.start_s, segment.start_m) == (before.end_s, before.end_m)
    for segment in segments:
        rows = slice(int(segment.start_s), int(segment.end_s) + 1)
        assert cycle.distances_m()[rows][-1] == segment.end_m
        if segment.cycle != "smooth":
            speeds = load_cycle(segment.cycle).speeds_m_s
            np.testing.assert_array_equal(cycle.speeds_m_s[rows], speeds)


def test_hills_reach_their_grade_on_top_of_the_climb() -> None:
    _, segments, road = comprehensive_cycle(STEEP)
    climb = np.arctan(0.02)
    for segment in segments:
        positions = np.linspace(segment.start_m, segment.end_m, 20_001)
        slopes = road.slope_at(positions)
        peak = np.arctan({"large": 0.16, "small": 0.05}[segment.slope_kind])
        assert np.max(np.abs(slopes - climb)) == pytest.approx(peak, rel=0.01)
        assert np.mean(slopes) == pytest.approx(climb, abs=2e-4)
    assert road.slope_at(-100.0) == pytest.approx(climb)


def test_the_smooth_part_keeps_its_speeds() -> None:
    cycle, segments, _ = comprehensive_cycle(STEEP)
    smooth = next(segment for segment in segments if segment.cycle == "smooth")
    speeds = 3.6 * cycle.speeds_m_s[int(smooth.start_s) + 90 : int(smooth.end_s) - 90]
    assert np.min(speeds) == pytest.approx(80.0, abs=0.1)
    assert np.max(speeds) == pytest.approx(110.0, abs=0.1)


def test_a_route_can_be_built_from_a_composition_of_ones_own() -> None:
    route = build_route(STEEP, initial_gap_m=15.0, duration_s=100.0)
    assert route.name == "steep, slope as_designed"
    assert route.slope.slope_at(-1.0) == pytest.approx(np.arctan(0.02))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"order": ("nycc", "nowhere", "smooth")}, "unknown part 'nowhere'"),
        ({"order": ("nycc", "us06")}, "smooth occurs 0 times"),
        ({"first_slope": "steep"}, "first_slope is 'steep'"),
        ({"large_grade": 0.4}, "large_grade is 0.4 (float); allowed: a number from 0 to 0.25"),
        ({"mean_climb": float("nan")}, "mean_climb is nan"),
        ({"smooth_low_km_h": 115.0}, "smooth_low_km_h is 115.0; allowed: at most"),
    ],
)
def test_what_makes_no_trip_is_refused(change: dict[str, object], text: str) -> None:
    with pytest.raises(RouteError, match="composition steep") as refusal:
        replace(STEEP, **change)  # type: ignore[arg-type]
    assert text in str(refusal.value)


def test_a_file_must_state_everything(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("order: [nycc, smooth]\nfirst_slope: large\n", encoding="utf-8")
    with pytest.raises(RouteError, match="'large_grade' is missing"):
        read_composition(path)
