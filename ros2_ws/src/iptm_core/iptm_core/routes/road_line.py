"""The course of a road on the WGS84 ellipsoid: from a position along it to coordinates, and back.

Distances are those of the mid-latitude formula: differences of latitude and longitude times the radii of
curvature at the mean latitude, exact to 1e-9 between points a kilometre apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray

EQUATORIAL_RADIUS_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)

MAX_LATITUDE_DEG = 85.0
"""Beyond it the local east-north plane of the formula is no plane."""
TEST_ROAD_START_DEG = (48.0, 10.0)
TEST_ROAD_LENGTH_M = 400_000.0
_TEST_ROAD_SPACING_M = 1000.0
NEAR_M = 1000.0
"""How far around the expected position a road is looked at."""


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
    """Return how far points lie east and north of an origin.

    Args:
        latitude_deg: latitudes, any shape.
        longitude_deg: longitudes, same shape.
        origin_deg: latitude and longitude of the origin, or of one for each point.

    Returns:
        East and north in m, shape of the points.
    """
    latitude, longitude, origin, meridian_deg = (
        np.asarray(values, dtype=np.float64)
        for values in (latitude_deg, longitude_deg, *origin_deg)
    )
    turns = (longitude - meridian_deg + 180.0) % 360.0 - 180.0
    mean = np.radians(0.5 * (latitude + origin))
    flat = 1.0 - _ECCENTRICITY_2 * np.sin(mean) ** 2
    prime_vertical = EQUATORIAL_RADIUS_M / np.sqrt(flat)
    meridian = prime_vertical * (1.0 - _ECCENTRICITY_2) / flat
    east: FloatArray = prime_vertical * np.cos(mean) * np.radians(turns)
    north: FloatArray = meridian * np.radians(latitude - origin)
    return east, north


@dataclass(frozen=True, eq=False)
class RoadLine:
    """A polyline; position 0 is its first vertex, where the host starts.

    Attributes:
        latitudes_deg: latitudes of the vertices, shape (n,), n >= 2.
        longitudes_deg: longitudes, shape (n,).
        positions_m: positions of the vertices along the road, shape (n,); follows from the others.

    Raises:
        RouteError: fewer than two vertices, coordinates off the Earth, or two equal vertices in a row.
    """

    latitudes_deg: FloatArray
    longitudes_deg: FloatArray
    positions_m: FloatArray = field(init=False)
    _headings_deg: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        latitudes = np.array(self.latitudes_deg, dtype=np.float64)
        longitudes = np.array(self.longitudes_deg, dtype=np.float64)
        if latitudes.ndim != 1 or latitudes.shape != longitudes.shape or latitudes.size < 2:
            raise RouteError(
                f"road line: shapes {latitudes.shape} and {longitudes.shape}; "
                "allowed: equally many latitudes and longitudes, at least two"
            )
        limits = ((latitudes, MAX_LATITUDE_DEG, "latitude"), (longitudes, 180.0, "longitude"))
        for values, limit, name in limits:
            bad = ~(np.abs(values) <= limit)
            if bad.any():
                first = int(np.flatnonzero(bad)[0])
                raise RouteError(
                    f"road line: {name} is {values[first]} at vertex {first}; allowed: "
                    f"-{limit:g} to {limit:g} degrees"
                )
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

    @classmethod
    def test_road(cls) -> RoadLine:
        """Return a straight road due north, for cycles that were driven on no road."""
        latitude, longitude = TEST_ROAD_START_DEG
        count = round(TEST_ROAD_LENGTH_M / _TEST_ROAD_SPACING_M)
        _, metres_per_degree = east_north_m(latitude + 0.5, longitude, TEST_ROAD_START_DEG)
        step = _TEST_ROAD_SPACING_M / (2.0 * float(metres_per_degree))
        latitudes: FloatArray = latitude + step * np.arange(count + 1, dtype=np.float64)
        return cls(latitudes, np.full(count + 1, longitude))

    def begun_earlier(self, way_m: float) -> RoadLine:
        """Return the line with a straight way of so many metres in front of it."""
        latitude, longitude, _ = self.locate(-way_m)
        return RoadLine(
            np.concatenate([[float(latitude)], self.latitudes_deg]),
            np.concatenate([[float(longitude)], self.longitudes_deg]),
        )

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
        self, latitude_deg: float, longitude_deg: float, near_m: float | None = None
    ) -> RoadFix:
        """Return where a point lies as seen from the road.

        Args:
            latitude_deg: latitude of the point.
            longitude_deg: longitude.
            near_m: where it is expected: only the road around it is looked at, which is quick and knows
                one direction of a road that returns from the other; None looks at all of it.
        """
        first, last = 0, self.positions_m.size
        if near_m is not None:
            window = np.searchsorted(self.positions_m, (near_m - NEAR_M, near_m + NEAR_M))
            first = int(np.clip(window[0] - 1, 0, last - 2))
            last = int(np.clip(window[1] + 1, first + 2, last))
        part = slice(first, last)
        east, north = east_north_m(
            self.latitudes_deg[part], self.longitudes_deg[part], (latitude_deg, longitude_deg)
        )
        step_east, step_north = np.diff(east), np.diff(north)
        lengths = np.hypot(step_east, step_north)
        along = -(east[:-1] * step_east + north[:-1] * step_north) / lengths
        inside = np.clip(along, 0.0, lengths)
        # The ends go on straight.
        inside[0] = min(inside[0], along[0])
        inside[-1] = max(inside[-1], along[-1])
        away = np.hypot(
            east[:-1] + step_east * inside / lengths, north[:-1] + step_north * inside / lengths
        )
        best = int(np.argmin(away))
        cross = step_north[best] * east[best] - step_east[best] * north[best]
        start_m, end_m = self.positions_m[first + best : first + best + 2]
        return RoadFix(
            position_m=float(start_m + inside[best] * (end_m - start_m) / lengths[best]),
            lateral_m=float(cross / lengths[best]),
            heading_deg=float(self._headings_deg[first + best]),
        )
