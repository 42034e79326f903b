"""The course of a road on the WGS84 ellipsoid: from a position along it to coordinates, and back.

Distances follow the mid-latitude formula: differences of latitude and longitude times the radii of
curvature at the mean latitude, exact to 1e-9 between points a kilometre apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray

EQUATORIAL_RADIUS_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
_RADIANS_PER_DEGREE = math.pi / 180.0
_SMALL_DEG = 1e-3

MAX_LATITUDE_DEG = 85.0
"""Limit of the local east-north plane of the formula."""
TEST_ROAD_START_DEG = (48.0, 10.0)
TEST_ROAD_LENGTH_M = 400_000.0
_TEST_ROAD_SPACING_M = 1000.0
NEAR_M = 1000.0
"""How far around the expected position a road is looked at."""
EXPECTED_SHARE = 0.005
"""Metres of distance from the road that a metre of distance from the expected position counts for: of several
passes of a road through one place the expected one counts."""
OPPOSITE_M = 20.0
"""What a segment in the opposite direction of a heading counts for in distance from the road."""


@dataclass(frozen=True)
class RoadFix:
    """A point seen from the road.

    Attributes:
        position_m: position along the road of the nearest point on it; before the first and past the last
            vertex the road goes on straight.
        lateral_m: distance from the road, positive to the left of the driving direction.
        heading_deg: driving direction there, clockwise from north.
    """

    position_m: float
    lateral_m: float
    heading_deg: float


def east_north_m(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, origin_deg: tuple[ArrayLike, ArrayLike]
) -> tuple[FloatArray, FloatArray]:
    """Return how far east and north of an origin points lie, in m, shape of the points."""
    latitude, longitude, origin, meridian_deg = (
        np.asarray(values, dtype=np.float64)
        for values in (latitude_deg, longitude_deg, *origin_deg)
    )
    east, north = _east_north(latitude, longitude, origin, meridian_deg, np)
    return east, north


def _east_north(
    latitude: Any, longitude: Any, origin: Any, meridian_deg: Any, functions: Any
) -> tuple[Any, Any]:
    """Return east and north of arrays (``numpy``) or, ten times as fast, of single numbers (``math``)."""
    turns = (longitude - meridian_deg + 180.0) % 360.0 - 180.0
    mean = 0.5 * (latitude + origin) * _RADIANS_PER_DEGREE
    flat = 1.0 - _ECCENTRICITY_2 * functions.sin(mean) ** 2
    prime_vertical = EQUATORIAL_RADIUS_M / functions.sqrt(flat)
    meridian = prime_vertical * (1.0 - _ECCENTRICITY_2) / flat
    east = prime_vertical * functions.cos(mean) * turns * _RADIANS_PER_DEGREE
    return east, meridian * (latitude - origin) * _RADIANS_PER_DEGREE


def check_places(
    latitudes_deg: FloatArray, longitudes_deg: FloatArray, what: str, first: int = 1
) -> None:
    """Refuse places off the Earth, or not a number; they are counted from ``first`` on."""
    limits = ((latitudes_deg, MAX_LATITUDE_DEG, "latitude"), (longitudes_deg, 180.0, "longitude"))
    for values, limit, name in limits:
        for k in np.flatnonzero(~(np.abs(values) <= limit)):
            raise RouteError(
                f"{what} {k + first}: {name} is {values[k]:g}; allowed: -{limit:g} to {limit:g} degrees"
            )


def _apart_deg(first_deg: float, second_deg: float) -> float:
    """Return the angle between two headings, 0 to 180 degrees."""
    return abs((first_deg - second_deg + 180.0) % 360.0 - 180.0)


def step_m(
    latitude_deg: float, longitude_deg: float, origin_deg: tuple[float, float]
) -> tuple[float, float]:
    """Return how far one point lies east and north of another one, in m; see `east_north_m`."""
    return _east_north(latitude_deg, longitude_deg, *origin_deg, math)


def step_deg(
    latitude_deg: ArrayLike,
    longitude_deg: ArrayLike,
    east_m: float | FloatArray,
    north_m: float | FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the points so far east and north of others: the inverse of `east_north_m`, shapes alike."""
    start: FloatArray = np.asarray(latitude_deg, dtype=np.float64)
    meridian: FloatArray = np.asarray(longitude_deg, dtype=np.float64)
    latitude, longitude = start, meridian
    for _ in range(3):
        # The degrees that the formula's own metres at the last guess leave over.
        east, north = east_north_m(latitude, longitude, (start, meridian))
        per_east, _ = east_north_m(latitude, meridian + _SMALL_DEG, (start, meridian))
        _, per_north = east_north_m(latitude + _SMALL_DEG, longitude, (latitude, longitude))
        latitude = latitude + _SMALL_DEG * (north_m - north) / per_north
        longitude = longitude + _SMALL_DEG * (east_m - east) / per_east
    return latitude, longitude


@dataclass(frozen=True, eq=False)
class RoadLine:
    """A polyline; position 0 is its first vertex, where the ego vehicle starts.

    Attributes:
        latitudes_deg: latitudes of the vertices, shape (n,), n >= 2.
        longitudes_deg: longitudes, shape (n,).
        heights_m: heights of the vertices above one datum, shape (n,); None where they are unknown.
        positions_m: positions of the vertices along the road, shape (n,); follows from the others.
    """

    latitudes_deg: FloatArray
    longitudes_deg: FloatArray
    heights_m: FloatArray | None = None
    positions_m: FloatArray = field(init=False)
    _headings_deg: FloatArray = field(init=False, repr=False)
    _vertices_deg: tuple[tuple[float, float], ...] = field(init=False, repr=False)
    _stations_m: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        latitudes = np.array(self.latitudes_deg, dtype=np.float64)
        longitudes = np.array(self.longitudes_deg, dtype=np.float64)
        if latitudes.ndim != 1 or latitudes.shape != longitudes.shape or latitudes.size < 2:
            raise RouteError(
                f"road line: shapes {latitudes.shape} and {longitudes.shape}; "
                "allowed: equally many latitudes and longitudes, at least two"
            )
        if self.heights_m is not None and self.heights_m.shape != latitudes.shape:
            raise RouteError(
                f"road line: heights of shape {self.heights_m.shape}; allowed: {latitudes.shape}"
            )
        check_places(latitudes, longitudes, "road line, vertex", first=0)
        before = (latitudes[:-1], longitudes[:-1])
        east, north = east_north_m(latitudes[1:], longitudes[1:], before)
        lengths = np.hypot(east, north)
        if not np.all(lengths > 0.0):
            raise RouteError(
                f"road line: vertex {int(np.argmin(lengths)) + 1} equals the one before; "
                "allowed: different ones"
            )
        positions = np.concatenate([[0.0], np.cumsum(lengths)])
        headings = np.degrees(np.arctan2(east, north)) % 360.0
        named = {
            "latitudes_deg": latitudes,
            "longitudes_deg": longitudes,
            "positions_m": positions,
            "_headings_deg": headings,
        }
        for name, values in named.items():
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        # The same as plain numbers, for single points.
        vertices = tuple(zip(latitudes.tolist(), longitudes.tolist(), strict=True))
        object.__setattr__(self, "_vertices_deg", vertices)
        object.__setattr__(self, "_stations_m", tuple(positions.tolist()))

    @classmethod
    def test_road(cls) -> RoadLine:
        """Return a straight road due north, for cycles that were driven on no road."""
        latitude, longitude = TEST_ROAD_START_DEG
        count = round(TEST_ROAD_LENGTH_M / _TEST_ROAD_SPACING_M)
        _, metres_per_degree = east_north_m(latitude + 0.5, longitude, TEST_ROAD_START_DEG)
        step = _TEST_ROAD_SPACING_M / (2.0 * float(metres_per_degree))
        latitudes: FloatArray = latitude + step * np.arange(count + 1, dtype=np.float64)
        return cls(latitudes, np.full(count + 1, longitude))

    def extended_backwards(self, distance_m: float) -> RoadLine:
        """Return the line extended backwards by a straight segment of length `distance_m`."""
        latitude, longitude, _ = self.locate(-distance_m)
        return RoadLine(
            np.concatenate([[float(latitude)], self.latitudes_deg]),
            np.concatenate([[float(longitude)], self.longitudes_deg]),
            None
            if self.heights_m is None
            else np.concatenate([self.heights_m[:1], self.heights_m]),
        )

    def height_at_m(self, position_m: float) -> float | None:
        """Return the height at a position along the road, level before and past its ends; None if unknown."""
        if self.heights_m is None:
            return None
        return float(np.interp(position_m, self.positions_m, self.heights_m))

    @property
    def length_m(self) -> float:
        """Length of the line."""
        return float(self.positions_m[-1])

    def locate(self, position_m: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return latitude, longitude (degrees) and heading at positions along the road, shape of them."""
        position = np.asarray(position_m, dtype=np.float64)
        left = np.clip(
            np.searchsorted(self.positions_m, position, side="right") - 1,
            0,
            self._headings_deg.size - 1,
        )
        start, end = self.positions_m[left], self.positions_m[left + 1]
        share = (position - start) / (end - start)
        latitude = self.latitudes_deg[left] + share * (
            self.latitudes_deg[left + 1] - self.latitudes_deg[left]
        )
        longitude = self.longitudes_deg[left] + share * (
            self.longitudes_deg[left + 1] - self.longitudes_deg[left]
        )
        return latitude, longitude, self._headings_deg[left]

    def project(
        self,
        latitude_deg: float,
        longitude_deg: float,
        near_m: float | None = None,
        around_m: float = NEAR_M,
        heading_deg: float | None = None,
    ) -> RoadFix:
        """Return where a point lies as seen from the road.

        Args:
            near_m: where it is expected: only the road around it is looked at, and of several passes the
                nearest one counts; None looks at all of it.
            heading_deg: direction of movement of the point, which distinguishes the two directions of a road
                that returns on itself; used with `near_m` only.
        """
        if near_m is None:
            first, last = self._around_nearest(latitude_deg, longitude_deg)
        else:
            first, last = (
                int(index)
                for index in np.searchsorted(
                    self.positions_m, (near_m - around_m, near_m + around_m)
                )
            )
        segments = self._headings_deg.size
        first = min(max(first - 1, 0), segments - 1)
        last = min(max(last, first + 1), segments)
        nearest = (math.inf, RoadFix(0.0, 0.0, 0.0))
        point = (latitude_deg, longitude_deg)
        east, north = step_m(*self._vertices_deg[first], point)
        for index in range(first, last):
            start = (east, north)
            east, north = step_m(*self._vertices_deg[index + 1], point)
            away_m, fix = self._seen_from(index, start, (east, north))
            if near_m is not None:
                away_m += EXPECTED_SHARE * abs(fix.position_m - near_m)
                if heading_deg is not None and _apart_deg(heading_deg, fix.heading_deg) > 90.0:
                    away_m += OPPOSITE_M
            if away_m < nearest[0]:
                nearest = (away_m, fix)
        return nearest[1]

    def _around_nearest(self, latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
        """Return the range of the segments around the one that comes nearest to a point."""
        east, north = east_north_m(
            self.latitudes_deg, self.longitudes_deg, (latitude_deg, longitude_deg)
        )
        step_east, step_north = np.diff(east), np.diff(north)
        lengths = np.hypot(step_east, step_north)
        along = -(east[:-1] * step_east + north[:-1] * step_north) / lengths**2
        inside = np.clip(along, 0.0, 1.0)
        away = np.hypot(east[:-1] + step_east * inside, north[:-1] + step_north * inside)
        best = int(np.argmin(away))
        return best + 1, best + 1

    def _seen_from(
        self, index: int, start: tuple[float, float], end: tuple[float, float]
    ) -> tuple[float, RoadFix]:
        """Return the distance from a segment, its ends seen from the point, and the point seen from it."""
        step_east, step_north = end[0] - start[0], end[1] - start[1]
        length = math.hypot(step_east, step_north)
        along = -(start[0] * step_east + start[1] * step_north) / length
        # The ends of the road go on straight.
        if index > 0:
            along = max(along, 0.0)
        if index < self._headings_deg.size - 1:
            along = min(along, length)
        share = along / length
        away = math.hypot(start[0] + step_east * share, start[1] + step_north * share)
        start_m, end_m = self._stations_m[index], self._stations_m[index + 1]
        return away, RoadFix(
            position_m=start_m + share * (end_m - start_m),
            lateral_m=(step_north * start[0] - step_east * start[1]) / length,
            heading_deg=float(self._headings_deg[index]),
        )
