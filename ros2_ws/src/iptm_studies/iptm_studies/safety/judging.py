"""Verdicts on disturbed trials: collision avoidable or not, reported in time, impact with weak brakes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultKind, FaultPlace
from iptm_studies.random_cars.bounds import gaps_when_braking, seen_from
from iptm_studies.run import VEHICLE, WEAK_BRAKES, Report

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
_OF_THE_GAP = (FaultKind.GAP_NOISE, FaultKind.GAP_BIAS, FaultKind.LEADER_JUMPING)


@dataclass(frozen=True)
class Verdict:
    """What became of a trial.

    Attributes:
        smallest_gap_m: over the trip.
        collided_at_s: end of the interval in which the gap closed first, NaN for never.
        impact_m_s: largest speed difference around the collision, 0 without one.
        bound_m: smallest gap of the stated brakes from the best row before a collision, NaN without one.
        report_ticks: ticks from the first service braking to a report, NaN where it did not brake.
        noticed_s: time of braking until weak brakes were reported, NaN where they never were or are sound.
        problems: what did not hold, empty for all well.
    """

    smallest_gap_m: float
    collided_at_s: float = np.nan
    impact_m_s: float = 0.0
    bound_m: float = np.nan
    report_ticks: float = np.nan
    noticed_s: float = np.nan
    problems: tuple[str, ...] = ()


def judge_trial(
    trip: Trajectory,
    parameters: ModelParameters,
    faults: Sequence[Fault],
    reports: Sequence[Report],
) -> Verdict:
    """Judge a disturbed trial.

    Args:
        trip: what happened.
        parameters: of the vehicle.
        faults: what was disturbed.
        reports: of controller and vehicle.
    """
    # Measurements of a faulty sensor between two rows are not distances.
    falsified = any(fault.kind in _OF_THE_GAP for fault in faults)
    gaps_m = trip.gap_m if falsified else trip.closest_m
    problems: list[str] = []
    collided_at_s = bound_m = np.nan
    impact = 0.0
    touching = np.flatnonzero(gaps_m <= 0.0)
    if touching.size:
        first = int(touching[0])
        rows = slice(max(first - 1, 0), first + 1)
        collided_at_s = float(trip.time_s[first])
        impact = max(float((trip.speed_m_s[rows] - trip.leader_speed_m_s[rows]).max()), 0.0)
        bound_m = _best_stop(trip, parameters, faults, first)
        problems += _collision_problems(faults, bound_m, impact)
    report_ticks = _report_ticks(trip, reports)
    if report_ticks > REPORTED_WITHIN_TICKS:
        problems.append("service braking not reported in time")
    noticed_s, braked_s = _noticed_s(trip, faults, reports)
    if noticed_s > NOTICED_WITHIN_S or (np.isnan(noticed_s) and braked_s > NOTICED_WITHIN_S):
        problems.append(f"weak brakes not reported within {NOTICED_WITHIN_S:g} s of braking")
    return Verdict(
        float(gaps_m.min()),
        collided_at_s,
        impact,
        bound_m,
        report_ticks,
        noticed_s,
        tuple(problems),
    )


def _collision_problems(faults: Iterable[Fault], bound_m: float, impact_m_s: float) -> list[str]:
    if bound_m <= 0.0:
        return []
    if brake_share(faults) < SOUND_SHARE:
        hard = impact_m_s > WEAK_IMPACT_M_S
        return [f"impact at {impact_m_s:.1f} m/s with weak brakes"] if hard else []
    return ["avoidable collision"]


def brake_share(faults: Iterable[Fault]) -> float:
    """Return the smallest share of the brakes in a trial, 1 for sound ones."""
    return min((f.magnitude for f in faults if f.kind is FaultKind.BRAKES_WEAK), default=1.0)


def _best_stop(
    trip: Trajectory, parameters: ModelParameters, faults: Iterable[Fault], first: int
) -> float:
    """Return the largest smallest gap that the stated brakes could keep before a collision.

    They act from any row from which on the lead vehicle is seen to do what it does: behind an event in
    traffic from its beginning on, otherwise from where it begins to lose speed.
    """
    start, last = min(seen_from(trip, first), first - 1), len(trip) - 1
    for event in at_places(faults, FaultPlace.TRAFFIC):
        if event.start_s < trip.time_s[first]:
            start = min(start, int(np.searchsorted(trip.time_s, event.start_s - 1e-9)))
    return max(
        float(gaps_when_braking(trip, parameters, row, last, REACTION_S).min())
        for row in range(start, first)
    )


def _report_ticks(trip: Trajectory, reports: Iterable[Report]) -> float:
    """Return the ticks from the end of the first interval with service braking to a report of the vehicle."""
    braked = np.flatnonzero(trip.service_braking_s > 0.0)
    if not braked.size:
        return np.nan
    since_s = float(trip.time_s[int(braked[0])])
    reported = (
        one.time_s
        for one in reports
        if one.source == VEHICLE and one.text and one.time_s >= since_s - 1e-9
    )
    return (min(reported, default=np.inf) - since_s) / float(trip.intervals_s[0])


def _noticed_s(
    trip: Trajectory, faults: Iterable[Fault], reports: Iterable[Report]
) -> tuple[float, float]:
    """Return the time of braking before weak brakes were reported, and that of the whole trip."""
    weak = [
        fault
        for fault in faults
        if fault.kind is FaultKind.BRAKES_WEAK and fault.magnitude < SOUND_SHARE
    ]
    if not weak:
        return np.nan, 0.0
    # A fault of the actuators acts on whole intervals, from the first one that begins with it.
    begins_s = trip.time_s - trip.intervals_s[0]
    acting = (begins_s >= weak[0].start_s - 1e-9) & (trip.time_s <= weak[0].end_s)
    braking = acting & (trip.acceleration_m_s2 < -BRAKING_M_S2) & (trip.speed_m_s >= MOVING_M_S)
    braked_s = np.cumsum(np.where(braking, np.diff(trip.time_s, prepend=trip.time_s[:1]), 0.0))
    reported = (one.time_s for one in reports if WEAK_BRAKES in one.text)
    reported_s = min(reported, default=np.inf)
    if not np.isfinite(reported_s):
        return np.nan, float(braked_s[-1])
    row = int(np.searchsorted(trip.time_s, reported_s - 1e-9))
    return float(braked_s[row]), float(braked_s[-1])
