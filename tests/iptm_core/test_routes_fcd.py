"""Drives of SUMO's vehicles: one of a file of floating car data becomes a leader."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.routes import build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.user_csv import read_user_trip

ROAD = RoadLine.test_road()
SECONDS = np.arange(0.0, 61.0, 0.5)
SPEEDS = np.interp(SECONDS, [0, 10, 50, 60], [0, 15, 15, 0])
PLACES = np.concatenate([[0.0], np.cumsum(0.25 * (SPEEDS[1:] + SPEEDS[:-1]))])
DEGREES = 2.0


def fcd(head: str = "", *, in_degrees: bool = False) -> str:
    """Return the drive of "leader" 100 s into a simulation, between others, on a steady climb."""
    latitudes, longitudes, _ = ROAD.locate(PLACES)
    east, north = (longitudes, latitudes) if in_degrees else (np.full(PLACES.size, 7.0), PLACES)
    rows = []
    for index, second in enumerate(SECONDS.tolist()):
        height = 500.0 + float(np.sin(np.radians(DEGREES))) * PLACES[index]
        rows.append(
            f'<timestep time="{100.0 + second:.2f}"><vehicle id="other" x="0" y="0" speed="0"/>'
            f'<vehicle id="leader" x="{east[index]}" y="{north[index]}" z="{height}" angle="0.0" '
            f'speed="{SPEEDS[index]}" pos="0" lane="a_0" slope="{DEGREES}"/><person id="p" x="0"/></timestep>'
        )
    return f'<?xml version="1.0"?>{head}<fcd-export>{"".join(rows)}</fcd-export>'


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def save(text: str) -> Path:
        path = tmp_path / "traffic.fcd.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return save


def test_a_vehicle_becomes_the_leader_on_its_slope(write: Callable[[str], Path]) -> None:
    route = build_route(f"{write(fcd())}#leader", initial_gap_m=15.0)
    whole = slice(None, None, 2)
    np.testing.assert_allclose(route.leader.speeds_at(SECONDS[whole]), SPEEDS[whole], atol=1e-9)
    np.testing.assert_allclose(route.leader.positions_at(60.0), 15.0 + PLACES[-1], rtol=1e-3)
    np.testing.assert_allclose(np.degrees(route.slope.slope_at([0.0, 500.0])), DEGREES)
    np.testing.assert_array_equal(route.road_line.latitudes_deg, ROAD.latitudes_deg)


def test_places_in_degrees_are_its_road(write: Callable[[str], Path]) -> None:
    trip = read_user_trip(Path(f"{write(fcd(in_degrees=True))}#leader"))
    fix = trip.line.project(*(float(value) for value in ROAD.locate(300.0)[:2]))
    assert fix.position_m == pytest.approx(300.0, abs=2.0)
    assert abs(fix.lateral_m) < 0.1
    np.testing.assert_allclose(np.degrees(trip.slope.slope_at(400.0)), DEGREES, atol=0.05)


def test_the_only_vehicle_needs_no_name(write: Callable[[str], Path]) -> None:
    alone = fcd().replace('<vehicle id="other" x="0" y="0" speed="0"/>', "")
    assert read_user_trip(write(alone)).cycle.max_speed_m_s == 15.0


@pytest.mark.parametrize(
    ("vehicle", "change", "reason"),
    [
        ("", lambda text: text, "holds 2 vehicles; name one"),
        ("#ledaer", lambda text: text, "did you mean 'leader'"),
        ("#leader", lambda text: text[:-30], "cannot be read"),
        ("#leader", lambda _: "<fcd-export/>", "holds none"),
        ("#leader", lambda text: text.replace('speed="15.0"', "", 1), "row 21: speed is None"),
        ("#leader", lambda text: text.replace('speed="15.0"', 'speed="x"', 1), "speed is 'x'"),
        ("#leader", lambda text: text.replace('speed="15.0"', 'speed="nan"', 1), "speed is 'nan'"),
        ("#leader", lambda text: text.replace('speed="15.0"', 'speed="60"', 1), "row 21, column"),
        ("#leader", lambda text: text.replace('"110.00"', '"90.00"'), "row 21, column time_s"),
        ("#leader", lambda text: text.replace('slope="2.0"', 'slope="40"', 1), "slope_rad"),
    ],
)
def test_files_without_the_drive_are_refused(
    write: Callable[[str], Path], vehicle: str, change: Callable[[str], str], reason: str
) -> None:
    with pytest.raises(RouteError, match=reason) as refusal:
        build_route(f"{write(change(fcd()))}{vehicle}", initial_gap_m=15.0)
    assert "traffic.fcd.xml" in str(refusal.value)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match="no such file"):
        build_route(f"{tmp_path}/none.xml#leader", initial_gap_m=15.0)
