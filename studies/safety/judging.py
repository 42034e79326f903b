"""Verdicts on disturbed trials: collision avoidable or not, reported in time, impact with weak brakes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from studies.bounds import gaps_when_braking, seen_from
from studies.judged import Judged
from studies.session import Case

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.run import Report, Reporter
from iptm_core.braking import GRAVITY_M_S2, tyre_deceleration_m_s2
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory

REPORTED_WITHIN_TICKS = 2
NOTICED_WITHIN_S = 1.0
"""Of braking, by which weak brakes have to be reported."""
SOUND_SHARE = 0.85
"""Brakes of this share and more have to avoid what the stated brakes avoid."""
WEAK_IMPACT_M_S = 5.0
"""Allowed impact of the first surprise with weaker brakes."""
REACTION_S = 0.1
"""Granted to the stated brakes: one sampling period of the range sensor."""
BRAKING_M_S2 = 0.3
"""Decelerations from this one on show what the brakes deliver."""
MOVING_M_S = 1.0
"""Below this speed the brakes hold the vehicle, whatever they deliver."""
AVOIDABLE = "avoidable"
_OF_THE_GAP = (
    FaultKind.GAP_NOISE,
    FaultKind.GAP_BIAS,
    FaultKind.GAP_ROUNDED,
    FaultKind.LEADER_JUMPING,
    FaultKind.LEADER_FROZEN,
)
_OF_THE_ROAD = (FaultKind.ROAD_SLIPPERY, FaultKind.ROAD_STEEPER)


def trial_of(case: Case, name: str = "", failure: str = "") -> Judged:
    """Return a trial that is not judged yet, or that failed, under the name of its case or another one."""
    faults = case.call["faults"]
    what = ", ".join([Path(case.call["cycle"]).stem, *(fault.describe() for fault in faults)])
    labels = {"disturbed": case.labels["disturbed"], "brake_share": brake_share(faults)}
    problems = {"failed": failure} if failure else {}
    return Judged(name or case.name, what, labels, problems=problems)


def judge_trial(
    trial: Judged,
    trip: Trajectory,
    parameters: ModelParameters,
    faults: Sequence[Fault],
    reports: Sequence[Report],
) -> Judged:
    """Judge a disturbed trial.

    Its figures are the smallest gap; ``collided_at_s``, the largest speed difference ``impact_m_s`` and the
    smallest gap ``bound_m`` of the stated brakes from the best row before it, where the gap closed; ticks
    from the first service braking to a report of it; and the time of braking until weak brakes were reported.

    Args:
        trial: without figures.
        trip: what happened.
        parameters: of the vehicle.
        faults: what was disturbed.
        reports: of controller and vehicle.
    """
    # Measurements of a faulty sensor between two rows are not distances.
    falsified = any(fault.kind in _OF_THE_GAP for fault in faults)
    gaps_m = trip.gap_m if falsified else trip.closest_m
    figures = {"smallest_gap_m": float(gaps_m.min())}
    problems: dict[str, str] = {}
    touching = np.flatnonzero(gaps_m <= 0.0)
    if touching.size:
        first = int(touching[0])
        rows = slice(max(first - 1, 0), first + 1)
        faster_m_s = float((trip.speed_m_s[rows] - trip.leader_speed_m_s[rows]).max())
        impact_m_s, bound_m = max(faster_m_s, 0.0), _best_stop(trip, parameters, faults, first)
        figures |= {
            "collided_at_s": float(trip.time_s[first]),
            "impact_m_s": impact_m_s,
            "bound_m": bound_m,
        }
        weak = brake_share(faults) < SOUND_SHARE
        if bound_m > 0.0 and not weak:
            problems[AVOIDABLE] = "avoidable collision"
        elif bound_m > 0.0 and impact_m_s > WEAK_IMPACT_M_S:
            problems["impact"] = f"impact at {impact_m_s:.1f} m/s with weak brakes"
    braked = np.flatnonzero(trip.service_braking_s > 0.0)
    if braked.size:
        figures["report_ticks"] = _report_ticks(trip, float(trip.time_s[braked[0]]), reports)
        if figures["report_ticks"] > REPORTED_WITHIN_TICKS:
            problems["report"] = "service braking not reported in time"
    noticed_s, braked_s = _noticed_s(trip, faults, reports)
    if noticed_s is not None:
        figures["noticed_s"] = noticed_s
    if (braked_s if noticed_s is None else noticed_s) > NOTICED_WITHIN_S:
        problems["weak"] = f"weak brakes not reported within {NOTICED_WITHIN_S:g} s of braking"
    return replace(trial, figures=figures, problems=problems)


def brake_share(faults: Iterable[Fault]) -> float:
    """Return the smallest share of the brakes in a trial, 1 for sound ones."""
    return min((f.magnitude for f in faults if f.kind is FaultKind.BRAKES_WEAK), default=1.0)


def road_deceleration_m_s2(parameters: ModelParameters, faults: Iterable[Fault]) -> float:
    """Return the deceleration that brakes, tyres and slope permit while faults of the road last."""
    sizes = {kind: [f.magnitude for f in faults if f.kind is kind] for kind in _OF_THE_ROAD}
    slope_rad = sum(sizes[FaultKind.ROAD_STEEPER])
    force_m_s2 = parameters.brakes.max_deceleration_m_s2
    for friction in sizes[FaultKind.ROAD_SLIPPERY]:
        force_m_s2 = min(force_m_s2, tyre_deceleration_m_s2(friction, slope_rad))
    # Uphill is not drawn on: the fault may end before the vehicle stands.
    return force_m_s2 + min(GRAVITY_M_S2 * math.sin(slope_rad), 0.0)


def _best_stop(
    trip: Trajectory, parameters: ModelParameters, faults: Sequence[Fault], first: int
) -> float:
    """Return the largest smallest gap that the stated brakes could keep before a collision.

    They act from any row from which on the lead vehicle is seen to do what it does: behind an event in
    traffic from its beginning on, otherwise from where it begins to lose speed.
    """
    start, last = min(seen_from(trip, first), first - 1), len(trip) - 1
    for event in at_places(faults, FaultPlace.TRAFFIC):
        if event.start_s < trip.time_s[first]:
            start = min(start, int(np.searchsorted(trip.time_s, event.start_s - 1e-9)))
    hardest_m_s2 = road_deceleration_m_s2(parameters, faults)
    return max(
        float(gaps_when_braking(trip, parameters, row, last, REACTION_S, hardest_m_s2).min())
        for row in range(start, first)
    )


def _report_ticks(trip: Trajectory, since_s: float, reports: Iterable[Report]) -> float:
    """Return the ticks from the end of the first interval with service braking to a report of the vehicle."""
    reported = (
        one.time_s
        for one in reports
        if one.source is Reporter.VEHICLE and one.text and one.time_s >= since_s - 1e-9
    )
    return (min(reported, default=np.inf) - since_s) / float(trip.intervals_s[0])


def _noticed_s(
    trip: Trajectory, faults: Iterable[Fault], reports: Iterable[Report]
) -> tuple[float | None, float]:
    """Return the time of braking before weak brakes were reported (None for never), and of all."""
    weak = [
        fault
        for fault in faults
        if fault.kind is FaultKind.BRAKES_WEAK and fault.magnitude < SOUND_SHARE
    ]
    if not weak:
        return None, 0.0
    # A fault of the actuators acts on whole intervals, from the first one that begins with it.
    begins_s = trip.time_s - trip.intervals_s[0]
    acting = (begins_s >= weak[0].start_s - 1e-9) & (trip.time_s <= weak[0].end_s)
    braking = acting & (trip.acceleration_m_s2 < -BRAKING_M_S2) & (trip.speed_m_s >= MOVING_M_S)
    braked_s = np.cumsum(np.where(braking, np.diff(trip.time_s, prepend=trip.time_s[:1]), 0.0))
    reported_s = min((one.time_s for one in reports if one.weak_brakes), default=np.inf)
    if not np.isfinite(reported_s):
        return None, float(braked_s[-1])
    row = int(np.searchsorted(trip.time_s, reported_s - 1e-9))
    return float(braked_s[row]), float(braked_s[-1])
