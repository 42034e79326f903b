"""A route: what the leader drives, for how long, on which road, and the course of that road in space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.routes.comprehensive import (
    RouteComposition,
    RouteSegment,
    composition_names,
    comprehensive_cycle,
    hilly_road,
    load_composition,
)
from iptm_core.routes.cycles import (
    CYCLE_NAMES,
    NOTED_NOISE_M_S,
    DrivingCycle,
    LeaderMotion,
    load_cycle,
    smooth_cycle,
    smoothed,
    speed_noise_m_s,
)
from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_core.routes.slope import PEAK_GRADES, SlopeProfile
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import FloatArray, SlopePreview
from iptm_core.user_input import is_path, nearest

ROUTE_CYCLES = (*CYCLE_NAMES, "smooth", *composition_names())
"""Cycle names for `build_route`, which also takes the path of a drive."""

SLOPE_CHOICES = ("as_designed", "flat", *PEAK_GRADES)
"""Slope choices of `build_route`."""

SMOOTH_ROUTE_DURATION_S = 1800

NOTED_ACCELERATION_M_S2 = 6.0
"""Change of the speed in a second above which a note asks for its unit."""
GPX_SUFFIX = ".gpx"
BAG_SUFFIXES = (".mcap", ".db3", ".bag")
"""Of single files; the bag of a run is a folder."""
TABLE_SUFFIXES = (".csv", ".csv.gz", ".txt", ".tsv")
USER_SUFFIXES = (
    *TABLE_SUFFIXES,
    GPX_SUFFIX,
    ".gpx.gz",
    ".xml",
    ".xml.gz",
    ".parquet",
    *BAG_SUFFIXES,
)
USER_FILES = ".csv, .gpx, FILE.xml#VEHICLE of SUMO, FOLDER/BAG#VEHICLE"
"""Accepted files for a cycle, for messages to the user; `#VEHICLE` if there are several."""


@dataclass(frozen=True, eq=False)
class Route:
    """Everything about the trip that lies outside the ego vehicle.

    Attributes:
        leader: motion of the preceding vehicle; it goes on past ``duration_s`` if the trip is cut.
        slope: road slope over position; position 0 is where the ego vehicle starts.
        segments: stretches in driving order, covering the whole cycle without gaps.
        road_line: where the road lies on Earth; a straight test road for cycles that were driven on none.
        notes: repairs of the drive's file.
    """

    name: str
    leader: LeaderMotion
    slope: SlopeProfile
    duration_s: float
    segments: tuple[RouteSegment, ...]
    source: str
    road_line: RoadLine = field(default_factory=RoadLine.test_road)
    notes: tuple[str, ...] = ()


def build_route(
    cycle: str | Path | RouteComposition | UserTrip = "wltc_class3b",
    slope: str = "as_designed",
    *,
    initial_gap_m: float,
    duration_s: float | None = None,
    smooth_s: float = 0.0,
) -> Route:
    """Build a route from a driving cycle and a choice of slope.

    Args:
        cycle: one of `ROUTE_CYCLES`, the path of a drive (see `iptm_core.routes.user_csv`), a drive
            that was read already, or a composition of the comprehensive cycle.
        slope: ``"as_designed"`` takes the road that belongs to the cycle (alternating hills for the
            comprehensive cycles, that in the file of a drive, level for the published cycles, which
            are made for a dynamometer); ``"flat"``, ``"small"`` (2 % at the steepest) and
            ``"large"`` (6 %) replace it, and so does the road of a track: the path of a GPX file, with
            or without times.
        duration_s: length of the trip; None takes the whole cycle. A shorter trip leaves the motion
            of the leader as it is; in a longer one it stands still at the end.
        smooth_s: width of the window over which the speeds are averaged, 0 for none.
    """
    is_road_file = is_path(slope, (GPX_SUFFIX,))
    if slope not in SLOPE_CHOICES and not is_road_file:
        raise RouteError(
            f"slope is {slope!r}; allowed: {', '.join(SLOPE_CHOICES)}, or the path of a track ({GPX_SUFFIX})"
        )
    if not (np.isfinite(initial_gap_m) and initial_gap_m > 0.0):
        raise RouteError(f"initial gap is {initial_gap_m} m; allowed: a positive distance")
    if duration_s is not None and not (np.isfinite(duration_s) and duration_s > 0.0):
        raise RouteError(f"trip is {duration_s} s; allowed: a positive duration")
    trace, segments, profile, line, notes = _designed(cycle)
    notes = (*notes, *_notes_on(trace, smooth_s, duration_s))
    if smooth_s > 0.0:
        trace = smoothed(trace, smooth_s)
    leader = LeaderMotion.from_cycle(trace, initial_gap_m)
    if is_road_file:
        from iptm_core.routes.user_csv import read_road  # noqa: PLC0415

        line, measured = read_road(Path(slope))
        driven_m = float(leader.positions_at(min(duration_s or np.inf, trace.duration_s)))
        if line.length_m < driven_m:
            raise RouteError(
                f"slope is {slope!r}, a road of {line.length_m:.0f} m; allowed: {driven_m:.0f} m or more, "
                "as far as the leader drives"
            )
        profile = measured or SlopeProfile.flat()
        kind = "flat" if measured is None else "measured"
        segments = tuple(replace(segment, slope_kind=kind) for segment in segments)
    elif slope != "as_designed":
        segments = tuple(replace(segment, slope_kind=slope) for segment in segments)
        profile = hilly_road(segments, len(segments), RouteComposition(slope))
    on_earth = {} if line is None else {"road_line": line}
    return Route(
        name=f"{trace.name}, slope {slope}",
        leader=leader,
        slope=profile,
        duration_s=float(trace.duration_s if duration_s is None else duration_s),
        segments=segments,
        source=trace.source,
        notes=notes,
        **on_earth,
    )


def _notes_on(trace: DrivingCycle, smooth_s: float, duration_s: float | None) -> list[str]:
    """Return remarks on the speeds of a drive and on its length."""
    notes = []
    noise_m_s = speed_noise_m_s(trace)
    if noise_m_s > NOTED_NOISE_M_S and not smooth_s:
        notes.append(
            f"the speed trace is noisy ({noise_m_s:.2f} m/s, standard deviation), and savings may be "
            "overstated; smooth_s averages it"
        )
    fastest_m_s2 = float(np.abs(np.diff(trace.speeds_m_s)).max())
    if fastest_m_s2 > NOTED_ACCELERATION_M_S2:
        change = f"speeds change by up to {fastest_m_s2:.1f} m/s from one second to the next"
        notes.append(f"{change}, as no car's do: is their unit right?")
    if duration_s is not None and duration_s > trace.duration_s:
        notes.append(f"the drive ends at {trace.duration_s:g} s: then the leader stands")
    return notes


def _read(path: Path) -> UserTrip:
    # What reads and cleans files of drives is loaded where there is one.
    from iptm_core.routes.user_csv import read_user_trip  # noqa: PLC0415

    return read_user_trip(path)


def _designed(
    cycle: str | Path | RouteComposition | UserTrip,
) -> tuple[DrivingCycle, tuple[RouteSegment, ...], SlopeProfile, RoadLine | None, tuple[str, ...]]:
    if isinstance(cycle, str) and cycle in composition_names():
        cycle = load_composition(cycle)
    if isinstance(cycle, RouteComposition):
        return *comprehensive_cycle(cycle), None, ()
    if isinstance(cycle, (Path, UserTrip)) or is_path(cycle, USER_SUFFIXES):
        trip = cycle if isinstance(cycle, UserTrip) else _read(Path(cycle))
        kind = "flat" if trip.slope is None else "measured"
        segment = _single_segment(trip.cycle, kind)
        return trip.cycle, segment, trip.slope or SlopeProfile.flat(), trip.line, trip.notes
    if cycle == "smooth":
        trace = smooth_cycle(SMOOTH_ROUTE_DURATION_S)
    elif cycle in CYCLE_NAMES:
        trace = load_cycle(cycle)
    else:
        near = nearest(cycle, ROUTE_CYCLES)
        hint = f"did you mean {near!r}? " if near else ""
        raise RouteError(
            f"unknown driving cycle {cycle!r}; {hint}allowed: {', '.join(ROUTE_CYCLES)}, "
            f"or the path of a drive: {USER_FILES}"
        )
    return trace, _single_segment(trace, "flat"), SlopeProfile.flat(), None, ()


def _single_segment(trace: DrivingCycle, slope_kind: str) -> tuple[RouteSegment, ...]:
    return (
        RouteSegment(
            name=trace.name,
            cycle=trace.name,
            slope_kind=slope_kind,
            start_s=0.0,
            end_s=trace.duration_s,
            start_m=0.0,
            end_m=trace.distance_m,
        ),
    )


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
