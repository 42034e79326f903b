"""The road in space: from a position along it to a point and a direction in a plane map with heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_core.state import FloatArray, SlopePreview


@dataclass(frozen=True, eq=False)
class RoadPoses:
    """Places on the road with the direction of driving.

    Attributes:
        points_m: x east, y north, z up, shape (n, 3).
        yaws_rad: direction in the plane, counter-clockwise from x, shape (n,).
        grades_rad: angle of climb, positive uphill, shape (n,).
    """

    points_m: FloatArray
    yaws_rad: FloatArray
    grades_rad: FloatArray

    def quaternions(self) -> FloatArray:
        """Return the rotations from the axes of a body on the road to the map's, x y z w, (n, 4)."""
        # About the body's y axis, which points to the left, a climb is a negative turn.
        half_yaw, half_pitch = 0.5 * self.yaws_rad, -0.5 * self.grades_rad
        cos_yaw, sin_yaw = np.cos(half_yaw), np.sin(half_yaw)
        cos_pitch, sin_pitch = np.cos(half_pitch), np.sin(half_pitch)
        columns = (
            -sin_yaw * sin_pitch,
            cos_yaw * sin_pitch,
            sin_yaw * cos_pitch,
            cos_yaw * cos_pitch,
        )
        return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class RoadCourse:
    """Shape and height of a road; position 0, where the ego vehicle starts, is the origin of the map.

    Positions count in the plane; on a slope of 6 % that is 0.2 % off the distance along the road.

    Attributes:
        line: where the road lies on Earth; None for a straight one along x.
    """

    slope: SlopePreview
    line: RoadLine | None = None

    def points_m(self, positions_m: ArrayLike) -> FloatArray:
        """Return the points at positions along the road, shape (n, 3) for n positions."""
        position = np.asarray(positions_m, dtype=np.float64)
        nodes_m, heights_m = heights(self.slope)
        up = np.interp(position, nodes_m, heights_m)
        if self.line is None:
            return np.stack((position, np.zeros_like(position), up), axis=-1)
        latitude, longitude, _ = self.line.locate(position)
        origin = (float(self.line.latitudes_deg[0]), float(self.line.longitudes_deg[0]))
        east, north = east_north_m(latitude, longitude, origin)
        return np.stack((east, north, up), axis=-1)

    def poses(self, positions_m: ArrayLike, length_m: float) -> RoadPoses:
        """Return poses of bodies that stand on the road with both of their ends.

        Args:
            positions_m: positions of the ends that count, shape (n,).
            length_m: from there to the other end, not 0; negative where the body lies behind.
        """
        position = np.atleast_1d(np.asarray(positions_m, dtype=np.float64))
        here = self.points_m(position)
        ahead = np.sign(length_m) * (self.points_m(position + length_m) - here)
        return RoadPoses(
            here,
            np.arctan2(ahead[:, 1], ahead[:, 0]),
            np.arctan2(ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1])),
        )


def heights(slope: SlopePreview) -> tuple[FloatArray, FloatArray]:
    """Return the nodes of a slope (m) and the height of the road there (m), 0 at position 0."""
    positions_m, slopes_rad = slope.positions_m, slope.slopes_rad
    # The position counts along the road, so a piece of it climbs by the sine of its slope.
    climb = np.sin(0.5 * (slopes_rad[1:] + slopes_rad[:-1])) * np.diff(positions_m)
    height_m = np.concatenate(([0.0], np.cumsum(climb)))
    return positions_m, height_m - np.interp(0.0, positions_m, height_m)
