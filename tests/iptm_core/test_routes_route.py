"""Routes put together from a cycle, a slope choice and a gap."""

from __future__ import annotations

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
from iptm_core.routes.comprehensive import composition_names, load_composition

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
