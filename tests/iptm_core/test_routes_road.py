"""The road: generated hills and slopes, its course on the ellipsoid, and in space."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import SlopeProfile
from iptm_core.routes.road_line import RoadLine, east_north_m, step_deg
from iptm_core.routes.route import RoadCourse, heights
from iptm_core.routes.slope import Hills
from iptm_core.state import SlopePreview

LENGTHS_M = st.floats(50.0, 60000.0)
VARIANTS = st.integers(0, 50)


def hilly(length_m: float, peak_grade: float, variant: int) -> SlopeProfile:
    return SlopeProfile.from_hills([Hills(0.0, length_m, peak_grade, variant)])


def heights_m(profile: SlopeProfile, positions_m: np.ndarray) -> np.ndarray:
    """Heights above the first position, by the trapezoidal rule on the sine of the slope."""
    sines = np.sin(profile.slope_at(positions_m))
    return np.append(0.0, np.cumsum(0.5 * (sines[1:] + sines[:-1]) * np.diff(positions_m)))


@given(LENGTHS_M, VARIANTS, st.sampled_from([0.0, 0.02, 0.06, 0.3]))
def test_hills_have_the_peak_zero_mean_and_vanish_at_the_ends(
    length_m: float, variant: int, peak: float
) -> None:
    hills = Hills(100.0, length_m, peak, variant)
    positions = np.linspace(100.0, 100.0 + length_m, 20001)
    slopes = hills.slope_at(positions)
    limit = np.arctan(peak)
    assert np.max(np.abs(slopes)) == pytest.approx(limit, rel=2e-3)
    # The mean is zero analytically; on equal steps the trapezoidal rule is exact for it too.
    assert abs(np.mean(slopes[:-1])) < 1e-15
    assert slopes[0] == slopes[-1] == 0.0
    end_gradient = np.abs(slopes[[1, -2]]) / (positions[1] - positions[0])
    assert np.all(end_gradient <= 0.01 * np.max(np.abs(np.gradient(slopes, positions))))


@given(LENGTHS_M, VARIANTS)
def test_grid_interpolation_is_within_1e_4_rad_of_the_formula(
    length_m: float, variant: int
) -> None:
    hills = Hills(0.0, length_m, 0.06, variant)
    profile = SlopeProfile.from_hills([hills])
    between = np.linspace(0.0, length_m, 30011)
    error = profile.slope_at(between) - hills.slope_at(between)
    assert np.max(np.abs(error)) < 1e-4


def test_hills_are_deterministic_and_variants_differ() -> None:
    first, again, other = (hilly(5000.0, 0.02, variant) for variant in (3, 3, 4))
    np.testing.assert_array_equal(first.slopes_rad, again.slopes_rad)
    assert np.max(np.abs(first.slopes_rad - other.slopes_rad)) > 0.005


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 49.0, 0.06), "at least 50 m"),
        ((np.nan, 100.0, 0.06), "finite"),
        ((0.0, np.inf, 0.06), "finite"),
        ((0.0, 100.0, 0.31), r"0\.31; allowed: 0 to 0\.3"),
        ((0.0, 100.0, -0.1), "allowed: 0 to"),
        ((0.0, 100.0, 0.1, -1), "integer >= 0"),
    ],
)
def test_malformed_hills_are_refused(arguments: tuple[float, ...], message: str) -> None:
    with pytest.raises(RouteError, match=message):
        Hills(*arguments)  # type: ignore[arg-type]


def test_slope_is_zero_outside_the_hills() -> None:
    hills = Hills(100.0, 500.0, 0.06)
    np.testing.assert_array_equal(hills.slope_at([-1e6, 0.0, 99.9, 600.1, 1e6]), np.zeros(5))


def test_slope_is_interpolated_and_held_at_the_ends() -> None:
    profile = SlopeProfile(np.array([10.0, 20.0]), np.array([0.01, 0.03]))
    np.testing.assert_allclose(
        profile.slope_at([0.0, 10.0, 15.0, 20.0, 99.0]), [0.01, 0.01, 0.02, 0.03, 0.03]
    )
    assert profile.slope_at(15.0).shape == ()


def test_profile_from_elevations_returns_the_heights() -> None:
    positions = np.arange(0.0, 3001.0, 5.0)
    heights = 250.0 + 8.0 * np.sin(2.0 * np.pi * positions / 1500.0)
    profile = SlopeProfile.from_elevations(positions, heights)
    sines = 8.0 * 2.0 * np.pi / 1500.0 * np.cos(2.0 * np.pi * positions / 1500.0)
    inner = (positions > 20.0) & (positions < 2980.0)
    np.testing.assert_allclose(
        profile.slope_at(positions)[inner], np.arcsin(sines)[inner], atol=1e-4
    )
    climbs = heights_m(profile, positions)
    np.testing.assert_allclose(climbs, heights - heights[0], atol=0.05)


def test_noise_of_elevations_is_not_amplified_by_dense_points() -> None:
    positions = np.arange(0.0, 1000.0, 0.5)
    noise = 0.05 * np.where(np.arange(positions.size) % 2 == 0, 1.0, -1.0)
    profile = SlopeProfile.from_elevations(positions, noise)
    assert np.max(np.abs(profile.slopes_rad)) <= 0.1 / 19.0


@pytest.mark.parametrize(("positions", "heights"), [([3.0], [100.0]), ([0.0, 5.0], [7.0, 7.0])])
def test_short_elevation_profiles_are_level(positions: list[float], heights: list[float]) -> None:
    profile = SlopeProfile.from_elevations(positions, heights)
    np.testing.assert_array_equal(profile.slopes_rad, [0.0])


def test_too_steep_profiles_are_refused() -> None:
    with pytest.raises(RouteError, match=r"31\.0 % at 5\.0 m; allowed: -30 % to 30 %"):
        SlopeProfile(np.array([0.0, 5.0]), np.array([0.0, np.arctan(0.31)]))
    SlopeProfile(np.array([0.0]), np.array([np.arctan(0.3)]))
    with pytest.raises(RouteError, match="allowed: -30 % to 30 %"):
        SlopeProfile.from_elevations([0.0, 100.0], [0.0, 500.0])


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
