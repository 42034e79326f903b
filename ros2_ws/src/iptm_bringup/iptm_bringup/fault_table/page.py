"""Page of the fault table: one row per fault with the worst of its trips, and the reports."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence

from iptm_bringup.fault_table.catalogue import (
    FIRST_S,
    REAL_TIME_RATE,
    DriveMode,
    Entry,
    ReportPolicy,
)
from iptm_bringup.fault_table.judge import (
    LATE_REPORT_TICKS,
    REPORT_DELAY_TICKS,
    STEADY_TICKS,
    TrialOutcome,
)
from iptm_bringup.fault_table.over_ros import INPUT_TIMEOUT_S
from iptm_core.markdown import markdown_table
from iptm_faults.kinds import FaultKind

NOTICE = "<!-- Made by scripts/faults; do not edit. -->"
_MODES = {
    DriveMode.HEADLESS: "without ROS",
    DriveMode.LOCK_STEP: "lock-step",
    DriveMode.REAL_TIME: "real time",
}
_FOLDER_OF_A_BAG = re.compile(r"/\S*/(?=\S+\.mcap)")
"""Folder part of a bag's path, removed because it depends on the machine."""
_EXPECTED = {
    ReportPolicy.ALWAYS: "every tick",
    ReportPolicy.ONCE: "once",
    ReportPolicy.NEVER: "not required",
}


def faults_page(command: str, verdicts: Sequence[TrialOutcome]) -> str:
    """Return the page.

    Args:
        command: the command that made the page.
        verdicts: of all faults and trips.
    """
    red = [verdict for verdict in verdicts if verdict.problems]
    cycles = ", ".join(dict.fromkeys(verdict.cycle for verdict in verdicts))
    kinds = len({verdict.entry.fault.kind for verdict in verdicts})
    parts = [
        "# Faults",
        NOTICE,
        (
            f"Made with `{command}` on {os.cpu_count()} cores at a load average of "
            f"{os.getloadavg()[1]:.0f}: {kinds} kinds of faults, {len(verdicts)} trials on {cycles}; "
            f"{len(verdicts) - len(red)} passed, {len(red)} failed. What each kind does "
            "and how it is stated in a scenario: [reference](reference/faults.md). Each verdict is that of "
            "its last trial, possibly of an earlier run; the load is that when the page was written."
        ),
        _legend(),
        "## Results",
        markdown_table(
            (
                "fault",
                "required report",
                *_MODES.values(),
                "normal after (ticks; allowed)",
                "smallest gap (m)",
                "with full braking (m)",
            ),
            [_row(entry, of_it) for entry, of_it in _by_entry(verdicts)],
        ),
        "## Failures",
        markdown_table(
            ("fault", "how", "cycle", "what"),
            [(one.entry.name, _MODES[one.mode], one.cycle, "; ".join(one.problems)) for one in red],
        )
        if red
        else "Nothing.",
        "## Reports",
        markdown_table(
            ("fault", "reasons on the diagnostics, worse than OK, and in how many trips"),
            [(entry.name, _reasons(of_it)) for entry, of_it in _by_entry(verdicts)],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _legend() -> str:
    lock_s, real_s = INPUT_TIMEOUT_S[DriveMode.LOCK_STEP], INPUT_TIMEOUT_S[DriveMode.REAL_TIME]
    return (
        "- **Passed (✓)**: no collision that brakes could avoid, none harder than with full braking, all "
        "input bounds and rates kept, the required report made, and normal operation restored in time.\n"
        f"- *Required report*: a status worse than OK at every tick after the first {REPORT_DELAY_TICKS}; "
        f"once during the fault or up to {LATE_REPORT_TICKS} ticks later; or not required (traffic events, "
        "discarded foreign messages, plausible values that cannot be detected).\n"
        f"- *Normal* is {STEADY_TICKS} consecutive ticks with an optimal command and every node at OK. "
        "Limits still violated, such as a gap to be restored after braking, do not count, nor do "
        "reports made at the same tick of the fault-free trip. Ticks count from the end of the fault; for a "
        "process, from when it is restarted or resumed, or its duplicate has ended.\n"
        "- *With full braking*: the smallest gap of a car that brakes with full jerk and deceleration from "
        "the first tick at which the fault is observable, behind the leader as recorded. Both gaps are from "
        "the trip in which brakes left the smallest gap.\n"
        f"- Faults begin at the smallest time headway of the fault-free trip, at {FIRST_S:g} s at the "
        "earliest. Over ROS 2 several faults share a trip. Real time runs "
        f"{REAL_TIME_RATE:g} times as fast as the wall clock; `input_timeout_s` is {lock_s:g} s in lock-step "
        f"and {real_s:g} s in real time. A machine too slow for that pace loses commands in real time, with "
        "or without faults."
    )


def _by_entry(verdicts: Iterable[TrialOutcome]) -> list[tuple[Entry, list[TrialOutcome]]]:
    by_name: dict[str, tuple[Entry, list[TrialOutcome]]] = {}
    for verdict in verdicts:
        by_name.setdefault(verdict.entry.name, (verdict.entry, []))[1].append(verdict)
    order = list(FaultKind)
    return sorted(by_name.values(), key=lambda pair: order.index(pair[0].fault.kind))


def _row(entry: Entry, verdicts: Sequence[TrialOutcome]) -> tuple[object, ...]:
    marks = []
    for mode in _MODES:
        of_way = [verdict for verdict in verdicts if verdict.mode is mode]
        green = sum(not verdict.problems for verdict in of_way)
        mark = "✓" if green == len(of_way) else "✗"
        marks.append(f"{mark} {green} of {len(of_way)}" if of_way else "–")
    known = [verdict for verdict in verdicts if not math.isnan(verdict.braking_gap_m)]
    tightest = min(known, key=lambda verdict: verdict.braking_gap_m, default=None)
    gaps = (
        ("–", "–")
        if tightest is None
        else (f"{tightest.smallest_gap_m:.1f}", f"{tightest.braking_gap_m:.1f}")
    )
    normal = "–" if entry.ends else f"{_slowest(verdicts)}; {entry.normal_within}"
    return (entry.name, _EXPECTED[entry.reported], *marks, normal, *gaps)


def _slowest(verdicts: Sequence[TrialOutcome]) -> str:
    after = [verdict.normal_after for verdict in verdicts]
    return "never" if any(map(math.isnan, after)) else f"{max(after):g}"


def _reasons(verdicts: Sequence[TrialOutcome]) -> str:
    reasons = (reason for verdict in verdicts for reason in verdict.reasons)
    counts = Counter(_FOLDER_OF_A_BAG.sub("", reason) for reason in reasons)
    return "<br>".join(f"{reason} ({count})" for reason, count in counts.most_common()) or "nothing"
