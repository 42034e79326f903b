"""Verdict on one fault of a trip: avoidable collisions, input limits, reports and recovery.

The braking reference is computed: a car that brakes with full jerk and full deceleration from the first
tick at which the fault is observable, behind the leader as recorded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_bringup.fault_table.catalogue import DriveMode, Entry, ReportPolicy
from iptm_bringup.fault_table.observed import NO_REPORT, FaultInterval, ObservedTrip, StatusReport
from iptm_core.decision_record import Rung
from iptm_core.metrics.constraints import check_constraints
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_faults.fault import Fault
from iptm_faults.kinds import FaultPlace
from iptm_interfaces.diagnostics import Level
from iptm_studies.random_cars.bounds import gaps_when_braking

STEADY_TICKS = 3
"""Consecutive normal ticks after which operation counts as normal."""
REPORT_DELAY_TICKS = 2
"""Ticks after the start of a fault before a missing report is a problem."""
LATE_REPORT_TICKS = 10
"""Ticks after the end of a fault in which a report is still attributed to it."""

BRAKING_TOLERANCE_M = 0.5
"""Tolerance (m) by which an unavoidable collision may be worse than with full braking."""


@dataclass(frozen=True)
class TrialOutcome:
    """Outcome of one fault.

    Attributes:
        entry: row of the table.
        mode: how the trip was driven.
        cycle: what the leader drove.
        reasons: reported reasons with the node, in order.
        level: worst level during the fault.
        changes: number of status changes from its start until operation was normal.
        normal_after: ticks from its end until operation was normal, NaN if never.
        smallest_gap_m: from its start until operation was normal.
        braking_gap_m: the same with full braking from the first tick at which the fault was observable.
        problems: failed checks, empty if it passed.
        not_reached: whether the trip ended before the fault began.
    """

    entry: Entry
    mode: DriveMode
    cycle: str
    reasons: tuple[str, ...] = ()
    level: Level = Level.OK
    changes: int = 0
    normal_after: float = math.nan
    smallest_gap_m: float = math.nan
    braking_gap_m: float = math.nan
    problems: tuple[str, ...] = ()
    not_reached: bool = False


def judge_trip(trip: ObservedTrip, fault_free: ObservedTrip) -> list[TrialOutcome]:
    """Judge every fault of a trip.

    Args:
        trip: with the faults.
        fault_free: the same trip headless and without faults; its reports are not held against the fault.
    """
    pairs = zip(trip.plan.entries, trip.intervals, strict=True)
    return [_judge(trip, fault_free, entry, fault, interval) for (entry, fault), interval in pairs]


def _judge(
    trip: ObservedTrip,
    fault_free: ObservedTrip,
    entry: Entry,
    fault: Fault,
    interval: FaultInterval | None,
) -> TrialOutcome:
    mode, cycle = trip.plan.mode, trip.plan.cycle
    if interval is None:
        why = trip.ended or "the trip was over before"
        return TrialOutcome(entry, mode, cycle, problems=(f"not reached: {why}",), not_reached=True)
    run = trip.trajectory
    times = run.time_s
    first = int(np.searchsorted(times, interval.start_s - 1e-9))
    end = min(int(np.searchsorted(times, interval.end_s - 1e-9)), len(run) - 1)
    if first >= len(run):
        return TrialOutcome(
            entry, mode, cycle, problems=("no tick was observed after its beginning",)
        )
    worst = trip.worst()
    levels = [report.level for report in worst]
    normal = _normal_row(trip, fault_free, worst, end)
    last = len(run) - 1 if normal is None else min(normal + LATE_REPORT_TICKS, len(run) - 1)
    normal_after = math.nan if normal is None else float(times[normal] - interval.end_s)
    problems = _missing_reports(trip, entry, levels, interval.start_s, first, end)
    if not entry.ends:
        if normal is None:
            problems.append("not normal again before the trip ended")
        elif normal_after > entry.normal_within:
            problems.append(f"normal after {normal_after:g} ticks")
        if trip.ended and interval is trip.intervals[-1]:
            problems.append(trip.ended)
    smallest_m = float(run.closest_m[first : last + 1].min())
    braking_m = _braking_gap_m(trip, fault, first, last)
    if smallest_m <= 0.0 < braking_m:
        problems.append(f"collision that brakes avoid (gap {smallest_m:.1f} m)")
    elif smallest_m < min(braking_m, 0.0) - BRAKING_TOLERANCE_M:
        problems.append(f"{braking_m - smallest_m:.1f} m worse than full braking")
    problems += _unbounded(trip, first, last)
    since_s, until_s = interval.start_s - 1e-9, times[last] + 1e-9
    around = [one for one in trip.reports if since_s <= one.time_s <= until_s]
    reasons = [f"{one.node}: {one.reason}" for one in around if one.level is not Level.OK]
    if entry.ends and trip.ended:
        reasons.append(trip.ended)
    while_it_lasts = levels[first : max(end, first + 1)]
    return TrialOutcome(
        entry,
        mode,
        cycle,
        tuple(dict.fromkeys(reasons)),
        max(while_it_lasts, key=lambda level: (level is not Level.OK, level.value)),
        len(around),
        normal_after,
        smallest_m,
        braking_m,
        tuple(problems),
    )


def _normal_row(
    trip: ObservedTrip, fault_free: ObservedTrip, worst: Sequence[StatusReport], end: int
) -> int | None:
    """Return the first row after the end of a fault with steady optimal commands and normal status."""
    times = trip.trajectory.time_s.tolist()
    fault_free_reports = dict(
        zip(fault_free.trajectory.time_s.tolist(), fault_free.worst(), strict=True)
    )
    steady = 0
    for row in range(end, len(times)):
        calm = (
            worst[row].is_calm
            or fault_free_reports.get(times[row], NO_REPORT).level is not Level.OK
        )
        good = calm and trip.rungs.get(times[row], Rung.OPTIMAL) is Rung.OPTIMAL
        steady = steady + 1 if good else 0
        if steady == STEADY_TICKS:
            return row - STEADY_TICKS + 1
    return None


def _missing_reports(
    trip: ObservedTrip, entry: Entry, levels: Sequence[Level], start_s: float, first: int, end: int
) -> list[str]:
    """Return the problems with the reports on a fault."""
    policy = entry.report_policy(trip.plan.mode)
    if policy is ReportPolicy.NEVER or (entry.ends and trip.ended):
        return []
    silent = [row for row in range(first + REPORT_DELAY_TICKS, end) if levels[row] is Level.OK]
    if policy is ReportPolicy.ALWAYS and silent:
        return [f"{len(silent)} of {end - first} ticks without a report"]
    later_s = trip.trajectory.time_s[end] + LATE_REPORT_TICKS
    since_s = min(trip.trajectory.time_s[first], start_s) - 1e-9
    late = [report for report in trip.reports if since_s <= report.time_s <= later_s]
    if not any(report.level is not Level.OK for report in late) and len(silent) == max(
        end - first - REPORT_DELAY_TICKS, 0
    ):
        return ["no report"]
    return []


def _braking_gap_m(trip: ObservedTrip, fault: Fault, first: int, last: int) -> float:
    """Return the smallest gap of a car that only brakes."""
    seen = first
    if fault.spec.place is FaultPlace.TRAFFIC:
        apart = np.flatnonzero(trip.leader_apart[first:])
        # A change after the judged window (a cut-in beyond the leader) does not count.
        seen += int(apart[0]) if apart.size and first + apart[0] <= last else 0
    return float(gaps_when_braking(trip.trajectory, trip.parameters, seen, last).min())


def _unbounded(trip: ObservedTrip, first: int, last: int) -> list[str]:
    """Return the hard input limits violated by the actuated commands."""
    rows = slice(max(first - 1, 0), last + 1)
    arrays = trip.trajectory.to_arrays()
    part = Trajectory.from_arrays({name: arrays[name][rows] for name in TRAJECTORY_COLUMNS})
    return [
        f"{check.label} beyond its limit by {check.worst_excess:.3g} {check.unit}"
        for check in check_constraints(part, trip.parameters)
        if check.hard and check.violations and check.key != "collision"
    ]
