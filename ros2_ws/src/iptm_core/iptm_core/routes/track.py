"""A recorded drive: raw points of a satellite receiver, and the trip that is read out of them.

Speeds come from the receiver where the file has them. Else they are the slopes of local lines through the
places (tricube weights, 4 s to either side), and speeds below walking pace are set to zero. Heights are
smoothed along the road in the same way (150 m to either side), because their noise, differentiated over the
metres between two points, would be steeper than any road; the grade is the slope of the local lines, bounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import cumulative_integral
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_core.routes.slope import ELEVATION_SPACING_M, SlopeProfile
from iptm_core.state import FloatArray

_MOST_WIDENINGS = 12


def local_line(
    nodes: FloatArray, values: FloatArray, at: FloatArray, half_width: float
) -> tuple[FloatArray, FloatArray]:
    """Fit a straight line around each point, weighted by the tricube of the distance.

    Args:
        nodes: abscissae of the samples, shape (n,), increasing, n >= 2.
        values: the samples, shape (n,).
        at: where to evaluate, shape (m,), increasing.
        half_width: samples farther away than this have no weight; doubled where fewer than three are nearer.

    Returns:
        Values and slopes of the lines, shape (m,) each.
    """
    smooth, slopes = np.empty_like(at), np.empty_like(at)
    for index, point in enumerate(at.tolist()):
        width = half_width
        for _ in range(_MOST_WIDENINGS):
            first, last = np.searchsorted(nodes, (point - width, point + width))
            if last - first >= 3 or last - first == nodes.size:
                break
            width *= 2.0
        distance = nodes[first:last] - point
        weight = (1.0 - np.minimum(np.abs(distance) / width, 1.0) ** 3) ** 3
        total = weight.sum()
        if last - first < 2 or total <= 0.0:
            smooth[index], slopes[index] = np.interp(point, nodes, values), 0.0
            continue
        mean = (weight * distance).sum() / total
        height = (weight * values[first:last]).sum() / total
        spread = (weight * (distance - mean) ** 2).sum()
        covered = (weight * (distance - mean) * (values[first:last] - height)).sum()
        slopes[index] = covered / spread if spread > 0.0 else 0.0
        smooth[index] = height - slopes[index] * mean
    return smooth, slopes


SPEED_WINDOW_S = 4.0
HEIGHT_WINDOW_M = 150.0
MAX_RECORDED_GRADE = 0.15
"""Steeper is noise: public roads are hardly ever."""
STANDSTILL_M_S = 0.7
LINE_SPACING_M = 10.0


_Heights = tuple[FloatArray, FloatArray]
"""Positions along the road, and the smoothed heights there."""


def steps_m(latitudes_deg: FloatArray, longitudes_deg: FloatArray) -> FloatArray:
    """Return the distances from point to point, shape (n - 1,)."""
    before = (latitudes_deg[:-1], longitudes_deg[:-1])
    steps: FloatArray = np.hypot(*east_north_m(latitudes_deg[1:], longitudes_deg[1:], before))
    return steps


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A trip read out of a track.

    Attributes:
        raw: the recording, after repairs.
        times_s: whole seconds, shape (m,).
        speeds_m_s: smoothed speeds, shape (m,).
        point_positions_m: position of every raw point along the road, shape (n,).
        slope: the slope along the road, None without heights.
        bounded_m: length of the road on which the grade had to be bounded.
    """

    raw: DriveTable
    times_s: FloatArray
    speeds_m_s: FloatArray
    point_positions_m: FloatArray
    line: RoadLine
    slope: SlopeProfile | None
    bounded_m: float


def read_out(raw: DriveTable) -> RecordedDrive:
    """Return the trip in a track; one that hardly moves or lasts less than two seconds is refused."""
    columns = raw.columns
    times, speeds_m_s = columns["time_s"], columns.get("speed_m_s")
    places = columns["latitude_deg"], columns["longitude_deg"]
    seconds = np.arange(np.floor(times[-1]) + 1.0)
    if seconds.size < 3:
        raise RouteError(f"{raw.source}: it lasts {times[-1]:g} s; allowed: 2 s or more")
    origin = (float(places[0][0]), float(places[1][0]))
    # Degrees are as good as metres to smooth; the slopes become speeds by the scale of the latitude.
    scale_east, _ = east_north_m(origin[0], origin[1] + 1e-3, origin)
    _, scale_north = east_north_m(origin[0] + 1e-3, origin[1], origin)
    latitudes, north_rate = local_line(times, places[0], seconds, SPEED_WINDOW_S)
    unwrapped: FloatArray = np.unwrap(places[1], period=360.0).astype(np.float64)
    longitudes, east_rate = local_line(times, unwrapped, seconds, SPEED_WINDOW_S)
    if speeds_m_s is not None:
        speeds = np.interp(seconds, times, speeds_m_s)
    else:
        narrower = np.cos(np.radians(latitudes)) / np.cos(np.radians(origin[0]))
        speeds = np.hypot(
            east_rate * float(scale_east) * 1e3 * narrower, north_rate * float(scale_north) * 1e3
        )
        speeds = np.where(speeds < STANDSTILL_M_S, 0.0, speeds)
    distances = cumulative_integral(seconds, speeds)
    if distances[-1] < LINE_SPACING_M:
        raise RouteError(
            f"{raw.source}: it covers {distances[-1]:.1f} m; allowed: {LINE_SPACING_M:g} m or more"
        )
    positions = np.interp(times, seconds, distances)
    slope, bounded_m, heights = _slope(columns.get("elevation_m"), positions)
    if "slope_rad" in columns:
        slope = SlopeProfile(*by_position(positions, columns["slope_rad"]))
    line = _line(distances, latitudes, (longitudes + 180.0) % 360.0 - 180.0, heights)
    return RecordedDrive(raw, seconds, speeds, positions, line, slope, bounded_m)


def road_through(
    source: str, latitudes_deg: FloatArray, longitudes_deg: FloatArray, heights_m: FloatArray | None
) -> tuple[RoadLine, SlopeProfile | None]:
    """Return course and slope of a road through places without times, arrays of shape (n,).

    Args:
        heights_m: heights above any datum; None if a place has none.
    """
    steps = steps_m(latitudes_deg, longitudes_deg)
    distances: FloatArray = np.concatenate([[0.0], np.cumsum(steps)])
    if distances[-1] < LINE_SPACING_M:
        raise RouteError(
            f"{source}: it covers {distances[-1]:.1f} m; allowed: {LINE_SPACING_M:g} m or more"
        )
    slope, _, heights = _slope(heights_m, distances)
    return _line(distances, latitudes_deg, longitudes_deg, heights), slope


def _line(
    distances: FloatArray, latitudes: FloatArray, longitudes: FloatArray, heights: _Heights | None
) -> RoadLine:
    """Return a polyline with a vertex every ten metres or, where the car was faster, every second."""
    kept = [0]
    for index in range(1, distances.size):
        if distances[index] - distances[kept[-1]] >= LINE_SPACING_M:
            kept.append(index)
    if len(kept) < 2:
        kept = [0, int(distances.size - 1)]
    # A receiver may repeat a place although the car drives on.
    kept = kept[:1] + [
        index
        for before, index in pairwise(kept)
        if (latitudes[index], longitudes[index]) != (latitudes[before], longitudes[before])
    ]
    heights_m = None if heights is None else np.interp(distances[kept], *heights)
    return RoadLine(latitudes[kept], longitudes[kept], heights_m)


_ROAD_SPACING_M = 5.0


def by_position(distances: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average rows that lie within the same few metres, as at a standstill or at walking pace."""
    bins = np.floor(distances / _ROAD_SPACING_M).astype(np.int64)
    _, index, counts = np.unique(bins, return_inverse=True, return_counts=True)
    return (
        np.bincount(index, weights=distances) / counts,
        np.bincount(index, weights=values) / counts,
    )


def _slope(
    heights_m: FloatArray | None, positions: FloatArray
) -> tuple[SlopeProfile | None, float, _Heights | None]:
    if heights_m is None:
        return None, 0.0, None
    # Points recorded at a standstill are one point of the road.
    places, index = np.unique(np.round(positions), return_inverse=True)
    heights = np.bincount(index, weights=heights_m) / np.bincount(index)
    count = max(2, round(float(places[-1] - places[0]) / ELEVATION_SPACING_M) + 1)
    grid: FloatArray = np.linspace(float(places[0]), float(places[-1]), count, dtype=np.float64)
    if places.size < 2:
        return SlopeProfile.flat(), 0.0, None
    smooth, grades = local_line(places, heights, grid, HEIGHT_WINDOW_M)
    bounded = np.clip(grades, -MAX_RECORDED_GRADE, MAX_RECORDED_GRADE)
    length = float(np.count_nonzero(bounded != grades)) * float(grid[1] - grid[0])
    return SlopeProfile(grid, np.arctan(bounded)), length, (grid, smooth)
