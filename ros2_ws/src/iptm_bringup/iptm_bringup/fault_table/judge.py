"""The verdict on one fault of a trip: collision avoidable or not, commands bounded, a word, normal again.

What the brakes allow is computed: a car that brakes with full jerk and full deceleration from the first tick
at which the fault can be seen, behind the leader as it drove.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_bringup.fault_table.catalogue import Entry, Said, Way
from iptm_bringup.fault_table.observed import QUIET, Happened, ObservedTrip, Statement
from iptm_core.decision_record import Rung
from iptm_core.metrics.constraints import check_constraints
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_faults.fault import Fault
from iptm_faults.kinds import FaultPlace
from iptm_interfaces.diagnostics import Level
from iptm_studies.random_cars.bounds import gaps_when_braking

STEADY_TICKS = 3
"""Ticks in a row that count as normal again."""
GRACE_TICKS = 2
"""Ticks for a word after the beginning: what is missing is missed when its time is over."""
LATER_TICKS = 10
"""Ticks after the end of a fault in which a word still counts as one about it, where one is asked for."""

BRAKING_TOLERANCE_M = 0.5
"""What a collision that cannot be avoided may be worse than with full braking."""


@dataclass(frozen=True)
class TrialOutcome:
    """What became of one fault.

    Attributes:
        entry: row of the table.
        way: how the trip was driven.
        cycle: what the leader drove.
        said: reasons that were given, in order, with the node.
        level: worst level while it lasted.
        changes: changes of what was said from its beginning until all was normal.
        normal_after: ticks after its end, NaN if it never was.
        smallest_gap_m: from its beginning until all was normal.
        braking_gap_m: the same with full braking from the first tick at which it could be seen.
        problems: what did not hold, empty for green.
        never_came: whether the trip was over before.
    """

    entry: Entry
    way: Way
    cycle: str
    said: tuple[str, ...] = ()
    level: Level = Level.OK
    changes: int = 0
    normal_after: float = math.nan
    smallest_gap_m: float = math.nan
    braking_gap_m: float = math.nan
    problems: tuple[str, ...] = ()
    never_came: bool = False


def judge_trip(trip: ObservedTrip, twin: ObservedTrip) -> list[TrialOutcome]:
    """Judge every fault of a trip.

    Args:
        trip: with the faults.
        twin: the same trip without ROS and without faults: what is said there is nobody's fault.
    """
    pairs = zip(trip.plan.entries, trip.happened, strict=True)
    return [_judge(trip, twin, entry, fault, happened) for (entry, fault), happened in pairs]


def _judge(
    trip: ObservedTrip, twin: ObservedTrip, entry: Entry, fault: Fault, happened: Happened | None
) -> TrialOutcome:
    way, cycle = trip.plan.way, trip.plan.cycle
    if happened is None:
        why = trip.ended or "the trip was over before"
        return TrialOutcome(
            entry, way, cycle, problems=(f"never came to pass: {why}",), never_came=True
        )
    run = trip.trajectory
    times = run.time_s
    first = int(np.searchsorted(times, happened.start_s - 1e-9))
    end = min(int(np.searchsorted(times, happened.end_s - 1e-9)), len(run) - 1)
    if first >= len(run):
        return TrialOutcome(
            entry, way, cycle, problems=("no tick was observed after its beginning",)
        )
    worst = trip.worst()
    levels = [said.level for said in worst]
    normal = _normal_row(trip, twin, worst, end)
    last = len(run) - 1 if normal is None else min(normal + LATER_TICKS, len(run) - 1)
    normal_after = math.nan if normal is None else float(times[normal] - happened.end_s)
    problems = _words(trip, entry, levels, happened.start_s, first, end)
    if not entry.ends:
        if normal is None:
            problems.append("not normal again before the trip ended")
        elif normal_after > entry.normal_within:
            problems.append(f"normal after {normal_after:g} ticks")
        if trip.ended and happened is trip.happened[-1]:
            problems.append(trip.ended)
    smallest_m = float(run.closest_m[first : last + 1].min())
    braking_m = _braking_gap_m(trip, fault, first, last)
    if smallest_m <= 0.0 < braking_m:
        problems.append(f"collision that brakes avoid (gap {smallest_m:.1f} m)")
    elif smallest_m < min(braking_m, 0.0) - BRAKING_TOLERANCE_M:
        problems.append(f"{braking_m - smallest_m:.1f} m worse than full braking")
    problems += _unbounded(trip, first, last)
    since_s, until_s = happened.start_s - 1e-9, times[last] + 1e-9
    around = [one for one in trip.statements if since_s <= one.time_s <= until_s]
    reasons = [f"{one.node}: {one.reason}" for one in around if one.level is not Level.OK]
    if entry.ends and trip.ended:
        reasons.append(trip.ended)
    while_it_lasts = levels[first : max(end, first + 1)]
    return TrialOutcome(
        entry,
        way,
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
    trip: ObservedTrip, twin: ObservedTrip, worst: Sequence[Statement], end: int
) -> int | None:
    """Return the first row from the end of a fault on with optimal commands and nothing to complain about."""
    times = trip.trajectory.time_s.tolist()
    at_twin = dict(zip(twin.trajectory.time_s.tolist(), twin.worst(), strict=True))
    steady = 0
    for row in range(end, len(times)):
        calm = worst[row].is_calm or at_twin.get(times[row], QUIET).level is not Level.OK
        good = calm and trip.rungs.get(times[row], Rung.OPTIMAL) is Rung.OPTIMAL
        steady = steady + 1 if good else 0
        if steady == STEADY_TICKS:
            return row - STEADY_TICKS + 1
    return None


def _words(
    trip: ObservedTrip, entry: Entry, levels: Sequence[Level], start_s: float, first: int, end: int
) -> list[str]:
    """Return what is amiss with what was said."""
    asked = entry.asked(trip.plan.way)
    if asked is Said.NOTHING or (entry.ends and trip.ended):
        return []
    silent = [row for row in range(first + GRACE_TICKS, end) if levels[row] is Level.OK]
    if asked is Said.ALWAYS and silent:
        return [f"{len(silent)} of {end - first} ticks without a word"]
    later_s = trip.trajectory.time_s[end] + LATER_TICKS
    since_s = min(trip.trajectory.time_s[first], start_s) - 1e-9
    words = [said for said in trip.statements if since_s <= said.time_s <= later_s]
    if not any(said.level is not Level.OK for said in words) and len(silent) == max(
        end - first - GRACE_TICKS, 0
    ):
        return ["nothing was said"]
    return []


def _braking_gap_m(trip: ObservedTrip, fault: Fault, first: int, last: int) -> float:
    """Return the smallest gap of a car that does nothing but brake."""
    seen = first
    if fault.spec.place is FaultPlace.TRAFFIC:
        apart = np.flatnonzero(trip.leader_apart[first:])
        # What cannot be seen before all is over (a cut-in farther away than the leader) is none.
        seen += int(apart[0]) if apart.size and first + apart[0] <= last else 0
    return float(gaps_when_braking(trip.trajectory, trip.parameters, seen, last).min())


def _unbounded(trip: ObservedTrip, first: int, last: int) -> list[str]:
    """Return the hard limits of the inputs that the actuated commands broke."""
    rows = slice(max(first - 1, 0), last + 1)
    arrays = trip.trajectory.to_arrays()
    part = Trajectory.from_arrays({name: arrays[name][rows] for name in TRAJECTORY_COLUMNS})
    return [
        f"{check.label} beyond its limit by {check.worst_excess:.3g} {check.unit}"
        for check in check_constraints(part, trip.parameters)
        if check.hard and check.violations and check.key != "collision"
    ]
