"""The course of a road on the ellipsoid, points seen from it, and the road in space."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.routes.road_course import RoadCourse, heights
from iptm_core.routes.road_line import RoadLine, east_north_m, step_deg
from iptm_core.state import SlopePreview


def winding(points: int = 400) -> RoadLine:
    """A road of about 8 km with bends."""
    turn = np.linspace(0.0, 6.0 * np.pi, points)
    latitudes = 47.5 + np.linspace(0.0, 0.06, points)
    return RoadLine(latitudes, 8.2 + 0.004 * np.sin(turn))


def test_distances_are_those_of_the_ellipsoid() -> None:
    """Independent of ours: Vincenty's formula of pymap3d."""
    vincenty = pytest.importorskip("pymap3d.vincenty")
    source = np.random.default_rng(4)
    for _ in range(200):
        latitude, longitude = source.uniform(-70.0, 70.0), source.uniform(-180.0, 180.0)
        other = latitude + source.uniform(-0.01, 0.01)
        aside = longitude + source.uniform(-0.01, 0.01)
        east, north = east_north_m(other, aside, (latitude, longitude))
        expected, _ = vincenty.vdist(latitude, longitude, other, aside)
        assert float(np.hypot(east, north)) == pytest.approx(float(expected), rel=1e-8, abs=1e-3)


def test_the_date_line_is_no_jump() -> None:
    east, _ = east_north_m(10.0, -179.999, (10.0, 179.999))
    assert float(east) == pytest.approx(0.002 * 109_640.0, rel=1e-3)


@pytest.mark.parametrize("position_m", [-30.0, 0.0, 123.4, 4000.0, 7700.0, 7780.0])
@pytest.mark.parametrize("road", [winding(), RoadLine.test_road()], ids=["winding", "straight"])
def test_a_point_of_the_road_is_found_where_it_is(road: RoadLine, position_m: float) -> None:
    latitude, longitude, heading = road.locate(position_m)
    fix = road.project(float(latitude), float(longitude))
    assert fix.position_m == pytest.approx(position_m, abs=0.02)
    assert fix.lateral_m == pytest.approx(0.0, abs=0.02)
    assert fix.heading_deg == pytest.approx(float(heading), abs=1e-9)


def test_left_is_positive() -> None:
    road = RoadLine.test_road()
    latitude, longitude, _ = road.locate(500.0)
    west = road.project(float(latitude), float(longitude) - 1e-4)
    assert west.lateral_m == pytest.approx(7.46, abs=0.05)
    assert west.position_m == pytest.approx(500.0, abs=1e-3)


@pytest.mark.parametrize(
    ("latitudes", "longitudes", "reason"),
    [
        ([48.0], [9.0], "at least two"),
        ([48.0, 48.1], [9.0], "equally many"),
        ([48.0, 95.0], [9.0, 9.0], "95;"),
        ([48.0, np.nan], [9.0, 9.0], "nan"),
        ([48.0, 48.0], [9.0, 9.0], "different"),
        ([48.0, 48.1], [9.0, 200.0], "200;"),
    ],
)
def test_impossible_lines_are_refused(
    latitudes: list[float], longitudes: list[float], reason: str
) -> None:
    with pytest.raises(RouteError, match=reason):
        RoadLine(np.array(latitudes), np.array(longitudes))


def _line(corners: list[tuple[float, float]], spacing_m: float = 10.0) -> RoadLine:
    """A road through corners east and north of a place, in m."""
    points = [corners[0]]
    for (east, north), (to_east, to_north) in pairwise(corners):
        count = round(math.hypot(to_east - east, to_north - north) / spacing_m)
        points += [
            (east + k / count * (to_east - east), north + k / count * (to_north - north))
            for k in range(1, count + 1)
        ]
    easts, norths = (np.array(values) for values in zip(*points, strict=True))
    zeros = np.zeros(easts.size)
    return RoadLine(*step_deg(48.0 + zeros, 11.0 + zeros, easts, norths))


def _place(road: RoadLine, position_m: float) -> tuple[float, float]:
    latitude, longitude, _ = road.locate(position_m)
    return float(latitude), float(longitude)


def test_of_two_laps_the_expected_one_counts() -> None:
    lap = [(0.0, 0.0), (200.0, 0.0), (200.0, 200.0), (0.0, 200.0)]
    road = _line([*lap, *lap, (0.0, 0.0)])
    for expected_m in (150.0, 950.0, 1500.0):
        place = _place(road, expected_m)
        assert road.project(*place, expected_m - 40.0).position_m == pytest.approx(
            expected_m, abs=0.1
        )


def test_of_two_directions_that_of_the_movement_counts() -> None:
    road = _line([(0.0, 0.0), (0.0, 1000.0), (0.5, 1000.0), (0.5, 0.0)], spacing_m=0.5)
    place = _place(road, 980.0)
    out = road.project(*place, 990.0, heading_deg=0.0)
    back = road.project(*place, 990.0, heading_deg=180.0)
    assert out.position_m == pytest.approx(980.0, abs=0.2)
    assert back.position_m == pytest.approx(1020.5, abs=0.2)


def test_the_expected_position_hardly_moves_the_found_one() -> None:
    """3 m off a bend of 100 m, whose vertices are 5 m apart: two segments are about as near."""
    angles = np.linspace(0.0, np.pi, 60)
    road = _line(
        [(100.0 - 100.0 * float(np.cos(a)), 100.0 * float(np.sin(a))) for a in angles], 2.0
    )
    for position_m in np.linspace(20.0, 280.0, 30):
        latitude, longitude, heading = road.locate(position_m)
        aside = np.radians(float(heading) + 90.0)
        place = step_deg(latitude, longitude, 3.0 * np.sin(aside), 3.0 * np.cos(aside))
        place_deg = float(place[0]), float(place[1])
        free, near = road.project(*place_deg), road.project(*place_deg, position_m - 100.0)
        assert near.position_m == pytest.approx(free.position_m, abs=0.2)


FLAT = SlopePreview(np.zeros(1), np.zeros(1))


def turned(quaternion: np.ndarray, vector: tuple[float, float, float]) -> np.ndarray:
    """Turn a vector by the matrix of a quaternion, written out."""
    x, y, z, w = quaternion
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return matrix @ np.array(vector)


def test_a_straight_level_road_is_the_x_axis() -> None:
    poses = RoadCourse(FLAT).poses([-5.0, 0.0, 1234.5], -4.5)
    assert poses.points_m.tolist() == [[-5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1234.5, 0.0, 0.0]]
    assert poses.quaternions().tolist() == [[0.0, 0.0, 0.0, 1.0]] * 3


def test_a_climb_lifts_the_nose() -> None:
    slope = SlopePreview(np.array([-100.0, 300.0]), np.array([0.1, 0.1]))
    poses = RoadCourse(slope).poses([200.0], -4.0)
    assert poses.points_m[0] == pytest.approx([200.0, 0.0, 200.0 * math.sin(0.1)])
    forward = turned(poses.quaternions()[0], (1.0, 0.0, 0.0))
    assert forward[2] / forward[0] == pytest.approx(math.sin(0.1))
    assert np.linalg.norm(poses.quaternions()[0]) == pytest.approx(1.0)
    # Height 0 is where the ego vehicle starts, not where the slope begins.
    assert heights(slope)[1][0] == pytest.approx(-100.0 * math.sin(0.1))


def test_a_car_stands_on_a_bend_with_both_ends() -> None:
    east = RoadLine(np.array([0.0, 0.0, 0.001]), np.array([0.0, 0.001, 0.001]))
    corner_m = float(east.positions_m[1])
    course = RoadCourse(FLAT, east)
    before, at_corner, after = course.poses(
        [corner_m - 10.0, corner_m + 2.0, corner_m + 10.0], -4.0
    ).yaws_rad
    assert before == pytest.approx(0.0, abs=1e-6)
    assert at_corner == pytest.approx(math.radians(45.0), abs=1e-3)
    assert after == pytest.approx(math.radians(90.0))
    # A body that lies ahead of its position looks the same way.
    assert course.poses([corner_m - 2.0], 4.0).yaws_rad[0] == pytest.approx(at_corner, abs=1e-6)
    assert course.points_m([corner_m + 10.0])[0] == pytest.approx([corner_m, 10.0, 0.0], abs=1e-3)
