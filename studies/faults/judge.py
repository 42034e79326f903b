"""Verdict on one fault of a trial: avoidable collisions, input limits, reports and recovery.

The braking reference is computed: a car that brakes with full jerk and full deceleration from the first
tick at which the fault is observable, behind the leader as recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from studies.bounds import gaps_when_braking
from studies.faults.catalogue import Entry, ReportPolicy
from studies.judged import Judged
from studies.trial import NO_REPORT, DriveMode, DrivenTrial, Level, StatusReport

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultPlace
from iptm_core.decision_record import Rung
from iptm_core.metrics.constraints import check_constraints
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

STEADY_TICKS = 3
"""Consecutive normal ticks after which operation counts as normal."""
REPORT_DELAY_TICKS = 2
"""Ticks after the start of a fault before a missing report is a problem."""
LATE_REPORT_TICKS = 10
"""Ticks after the end of a fault in which a report is still attributed to it."""
BRAKING_TOLERANCE_M = 0.5
"""Tolerance (m) by which an unavoidable collision may be worse than with full braking."""


def verdict_of(entry: Entry, mode: DriveMode, cycle: str, **problems: str) -> Judged:
    """Return a verdict without figures."""
    labels = {"fault": entry.name, "mode": mode.value, "cycle": cycle, "level": Level.OK.name}
    return Judged(f"{entry.name}, {mode}, {cycle}", entry.name, labels, problems=problems)


def judge_trial(driven: DrivenTrial, entry: Entry, fault_free: DrivenTrial) -> Judged:
    """Judge the fault of a trial.

    Figures are ``normal_after``, the ticks from the end of the fault until operation was normal, and the
    smallest gap until then, ``smallest_gap_m``, with full braking ``braking_gap_m``. Counts are the reported
    reasons with the node, in order.

    Args:
        driven: with the fault.
        entry: row of the table.
        fault_free: the same trip headless and without faults; its reports are not held against the fault.
    """
    (fault,), (interval,) = driven.trial.placed, driven.intervals
    verdict = verdict_of(entry, driven.trial.mode, driven.trial.cycle)
    if interval is None:
        why = f"not reached: {driven.ended or 'the trip was over before'}"
        return replace(verdict, problems={"not reached": why})
    begins_s, ends_s = interval
    run, times = driven.run.trajectory, driven.run.trajectory.time_s
    first = int(np.searchsorted(times, begins_s - 1e-9))
    end = min(int(np.searchsorted(times, ends_s - 1e-9)), len(run) - 1)
    if first >= len(run):
        return replace(verdict, problems={"ticks": "no tick was observed after its beginning"})
    worst = driven.worst()
    levels = [report.level for report in worst]
    normal = _normal_row(driven, fault_free, worst, end)
    last = len(run) - 1 if normal is None else min(normal + LATE_REPORT_TICKS, len(run) - 1)
    # What a disturbed range sensor measures between two rows is not a distance.
    gaps_m = run.gap_m if fault.spec.place is FaultPlace.LEADER else run.closest_m
    figures = {
        "smallest_gap_m": float(gaps_m[first : last + 1].min()),
        "braking_gap_m": _braking_gap_m(driven, fault, first, last),
    }
    if normal is not None:
        figures["normal_after"] = float(times[normal] - ends_s)
    missing = _missing_report(driven, entry, levels, begins_s, first, end)
    problems = {
        **({"report": missing} if missing else {}),
        **_problems(driven, entry, figures),
        **_limits_broken(driven, first, last),
    }
    since_s, until_s = begins_s - 1e-9, times[last] + 1e-9
    around = [one for one in driven.reports if since_s <= one.time_s <= until_s]
    reasons = [f"{one.node}: {one.reason}" for one in around if one.level is not Level.OK]
    if entry.ends and driven.ended:
        reasons.append(driven.ended)
    while_it_lasts = levels[first : max(end, first + 1)]
    level = max(while_it_lasts, key=lambda level: (level is not Level.OK, level.value))
    return replace(
        verdict,
        labels={**verdict.labels, "level": level.name},
        figures=figures,
        problems=problems,
        counts=dict.fromkeys(reasons, 1),
    )


def _problems(driven: DrivenTrial, entry: Entry, figures: Mapping[str, float]) -> dict[str, str]:
    """Return the problems with recovery and gap."""
    problems: dict[str, str] = {}
    if not entry.ends:
        normal_after = figures.get("normal_after")
        if normal_after is None:
            problems["normal"] = "not normal again before the trip ended"
        elif normal_after > entry.normal_within:
            problems["normal"] = f"normal after {normal_after:g} ticks"
        if driven.ended:
            problems["ended"] = driven.ended
    smallest_m, braking_m = figures["smallest_gap_m"], figures["braking_gap_m"]
    if smallest_m <= 0.0 < braking_m:
        problems["collision"] = f"collision that brakes avoid (gap {smallest_m:.1f} m)"
    elif smallest_m < min(braking_m, 0.0) - BRAKING_TOLERANCE_M:
        problems["collision"] = f"{braking_m - smallest_m:.1f} m worse than full braking"
    return problems


def _normal_row(
    driven: DrivenTrial, fault_free: DrivenTrial, worst: Sequence[StatusReport], end: int
) -> int | None:
    """Return the first row after the end of a fault with steady optimal commands and normal status."""
    times = driven.run.trajectory.time_s.tolist()
    decisions = driven.run.decisions
    rungs = dict(zip(decisions.time_s.tolist(), decisions.rung.tolist(), strict=True))
    usual = dict(zip(fault_free.run.trajectory.time_s.tolist(), fault_free.worst(), strict=True))
    steady = 0
    for row in range(end, len(times)):
        calm = worst[row].is_calm or usual.get(times[row], NO_REPORT).level is not Level.OK
        good = calm and rungs.get(times[row], Rung.OPTIMAL) == Rung.OPTIMAL
        steady = steady + 1 if good else 0
        if steady == STEADY_TICKS:
            return row - STEADY_TICKS + 1
    return None


def _missing_report(
    driven: DrivenTrial,
    entry: Entry,
    levels: Sequence[Level],
    begins_s: float,
    first: int,
    end: int,
) -> str:
    """Return the problem with the reports on a fault, empty for none."""
    reported = entry.reported
    if driven.trial.mode in entry.silent_in or (entry.ends and driven.ended):
        reported = ReportPolicy.NEVER
    if reported is ReportPolicy.NEVER:
        return ""
    silent = [row for row in range(first + REPORT_DELAY_TICKS, end) if levels[row] is Level.OK]
    if reported is ReportPolicy.ALWAYS and silent:
        return f"{len(silent)} of {end - first} ticks without a report"
    later_s = driven.run.trajectory.time_s[end] + LATE_REPORT_TICKS
    since_s = min(driven.run.trajectory.time_s[first], begins_s) - 1e-9
    late = [report for report in driven.reports if since_s <= report.time_s <= later_s]
    is_silent = len(silent) == max(end - first - REPORT_DELAY_TICKS, 0)
    return "no report" if is_silent and all(one.level is Level.OK for one in late) else ""


def _braking_gap_m(driven: DrivenTrial, fault: Fault, first: int, last: int) -> float:
    """Return the smallest gap of a car that only brakes."""
    seen, run, trip = first, driven.run.trajectory, driven.trial.inputs
    if fault.spec.place is FaultPlace.TRAFFIC:
        own_m = trip.route.leader.positions_at(run.time_s)
        apart = np.flatnonzero(np.abs(run.leader_position_m - own_m)[first:] > 1e-6)
        # A change after the judged window (a cut-in beyond the leader) does not count.
        seen += int(apart[0]) if apart.size and first + apart[0] <= last else 0
    return float(gaps_when_braking(run, trip.parameters, seen, last).min())


def _limits_broken(driven: DrivenTrial, first: int, last: int) -> dict[str, str]:
    """Return the hard input limits violated by the actuated commands."""
    rows = slice(max(first - 1, 0), last + 1)
    arrays = driven.run.trajectory.to_arrays()
    part = Trajectory.from_arrays({name: arrays[name][rows] for name in TRAJECTORY_COLUMNS})
    return {
        check.key: f"{check.label} beyond its limit by {check.worst_excess:.3g} {check.unit}"
        for check in check_constraints(part, driven.trial.inputs.parameters)
        if check.hard and check.violations and check.key != "collision"
    }
