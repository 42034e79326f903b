"""A route: what the leader drives, on which road, for how long."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

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
    DrivingCycle,
    LeaderMotion,
    load_cycle,
    smooth_cycle,
)
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.slope import PEAK_GRADES, SlopeProfile
from iptm_core.routes.smoothing import NOTED_NOISE_M_S, smoothed, speed_noise_m_s
from iptm_core.routes.user_csv import (
    GPX_SUFFIX,
    USER_FILES,
    USER_SUFFIXES,
    UserTrip,
    read_gpx_road,
    read_user_trip,
)
from iptm_core.user_input import is_path, nearest

ROUTE_CYCLES = (*CYCLE_NAMES, "smooth", *composition_names())
"""Cycle names for `build_route`, which also takes the path of a drive."""

SLOPE_CHOICES = ("as_designed", "flat", *PEAK_GRADES)
"""Slope choices of `build_route`."""

SMOOTH_ROUTE_DURATION_S = 1800


@dataclass(frozen=True, eq=False)
class Route:
    """Everything about the trip that lies outside the ego vehicle.

    Attributes:
        leader: motion of the preceding vehicle; it goes on past ``duration_s`` if the trip is cut.
        slope: road slope over position; position 0 is where the ego vehicle starts.
        segments: stretches in driving order, covering the whole cycle without gaps.
        road_line: where the road lies on Earth; a straight test road for cycles that were driven on none.
        notes: what was repaired in the file of the drive.
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
    noise_m_s = speed_noise_m_s(trace)
    if smooth_s > 0.0:
        trace = smoothed(trace, smooth_s)
    elif noise_m_s > NOTED_NOISE_M_S:
        noise = (
            f"speeds have noise of {noise_m_s:.2f} m/s (standard deviation), and a control that follows them "
            "pays for it: part of the saving is noise, which smooth_s takes out"
        )
        notes = (*notes, noise)
    if duration_s is not None and duration_s > trace.duration_s:
        notes = (*notes, f"the drive ends at {trace.duration_s:g} s: then the leader stands")
    leader = LeaderMotion.from_cycle(trace, initial_gap_m)
    if is_road_file:
        line, measured = read_gpx_road(Path(slope))
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


def _designed(
    cycle: str | Path | RouteComposition | UserTrip,
) -> tuple[DrivingCycle, tuple[RouteSegment, ...], SlopeProfile, RoadLine | None, tuple[str, ...]]:
    if isinstance(cycle, str) and cycle in composition_names():
        cycle = load_composition(cycle)
    if isinstance(cycle, RouteComposition):
        return *comprehensive_cycle(cycle), None, ()
    if isinstance(cycle, (Path, UserTrip)) or is_path(cycle, USER_SUFFIXES):
        trip = cycle if isinstance(cycle, UserTrip) else read_user_trip(Path(cycle))
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
