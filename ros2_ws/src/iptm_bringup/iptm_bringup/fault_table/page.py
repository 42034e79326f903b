"""The page of the table: a row for each fault, the worst of all its trips, and what was said."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence

from iptm_bringup.fault_table.catalogue import FIRST_S, REAL_TIME_RATE, Entry, Said, Way
from iptm_bringup.fault_table.judge import GRACE_TICKS, LATER_TICKS, STEADY_TICKS, TrialOutcome
from iptm_bringup.fault_table.over_ros import INPUT_TIMEOUT_S
from iptm_core.markdown import markdown_table
from iptm_faults.kinds import KINDS

NOTICE = "<!-- Made by scripts/faults; do not edit. -->"
_WAYS = {
    Way.HEADLESS: "without ROS",
    Way.LOCK_STEP: "lock-step",
    Way.REAL_TIME: "real time",
}
_FOLDER_OF_A_BAG = re.compile(r"/\S*/(?=\S+\.mcap)")
"""Where a bag lay is the machine's own affair."""
_ASKED = {Said.ALWAYS: "every tick", Said.ONCE: "a word", Said.NOTHING: "nothing"}


def faults_page(command: str, verdicts: Sequence[TrialOutcome]) -> str:
    """Return the page.

    Args:
        command: what it was made with.
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
            f"{os.getloadavg()[1]:.0f}: {kinds} kinds of faults, {len(verdicts)} times on {cycles}; "
            f"{len(verdicts) - len(red)} times everything held, {len(red)} times not. What each kind does "
            "and how it is stated in a scenario: [reference](reference/faults.md). Each verdict is that of "
            "its last trial, maybe in another sitting; the load is that at the writing of the page."
        ),
        _legend(),
        "## What happened",
        markdown_table(
            (
                "fault",
                "asked to be said",
                *_WAYS.values(),
                "normal after (ticks; allowed)",
                "smallest gap (m)",
                "with full braking (m)",
            ),
            [_row(entry, of_it) for entry, of_it in _by_entry(verdicts)],
        ),
        "## What did not hold",
        markdown_table(
            ("fault", "how", "cycle", "what"),
            [(one.entry.name, _WAYS[one.way], one.cycle, "; ".join(one.problems)) for one in red],
        )
        if red
        else "Nothing.",
        "## What was said",
        markdown_table(
            ("fault", "reasons on the diagnostics, worse than OK, and in how many trips"),
            [(entry.name, _reasons(of_it)) for entry, of_it in _by_entry(verdicts)],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _legend() -> str:
    lock_s, real_s = INPUT_TIMEOUT_S[Way.LOCK_STEP], INPUT_TIMEOUT_S[Way.REAL_TIME]
    return (
        "- **Green (✓)** is a fault with which no collision happened that brakes avoid, none was harder than "
        "with full braking, the actuated commands kept all bounds and rates, what is asked to be said was "
        "said, and all was normal again in time.\n"
        f"- *Asked to be said*: every tick has a status worse than OK, the first {GRACE_TICKS} excepted; or "
        f"a word while it lasts or within {LATER_TICKS} ticks; or nothing, where traffic does as it likes, "
        "strangers are turned away, or nobody can know.\n"
        f"- *Normal* is an optimal command and every node at OK, {STEADY_TICKS} ticks in a row. Limits that "
        "the trip still breaks, such as a gap to be made up after braking, are told as long as they last and "
        "do not count, nor does what is said at the same tick of the same trip without faults. Ticks count "
        "from the end of the fault; of a process, from when it is started again, woken up or its double is "
        "gone.\n"
        f"- *With full braking*: the smallest gap of a car that brakes with full jerk and deceleration from "
        "the first tick at which the fault can be seen, behind the leader as it drove. Both gaps are those "
        "of the trip in which brakes left least.\n"
        f"- Faults begin where the sound trip has its smallest time headway, at {FIRST_S:g} s at the "
        "earliest. Over ROS 2 they follow one another in few trips. Real time runs "
        f"{REAL_TIME_RATE:g} times as fast as the wall clock; `input_timeout_s` is {lock_s:g} s in lock-step "
        f"and {real_s:g} s in real time. A machine too busy for that pace loses commands in real time, with "
        "or without faults."
    )


def _by_entry(verdicts: Iterable[TrialOutcome]) -> list[tuple[Entry, list[TrialOutcome]]]:
    by_name: dict[str, tuple[Entry, list[TrialOutcome]]] = {}
    for verdict in verdicts:
        by_name.setdefault(verdict.entry.name, (verdict.entry, []))[1].append(verdict)
    order = list(KINDS)
    return sorted(by_name.values(), key=lambda pair: order.index(pair[0].fault.kind))


def _row(entry: Entry, verdicts: Sequence[TrialOutcome]) -> tuple[object, ...]:
    marks = []
    for way in _WAYS:
        of_way = [verdict for verdict in verdicts if verdict.way is way]
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
    return (entry.name, _ASKED[entry.said], *marks, normal, *gaps)


def _slowest(verdicts: Sequence[TrialOutcome]) -> str:
    after = [verdict.normal_after for verdict in verdicts]
    return "never" if any(map(math.isnan, after)) else f"{max(after):g}"


def _reasons(verdicts: Sequence[TrialOutcome]) -> str:
    said = (reason for verdict in verdicts for reason in verdict.said)
    counts = Counter(_FOLDER_OF_A_BAG.sub("", reason) for reason in said)
    return "<br>".join(f"{reason} ({count})" for reason, count in counts.most_common()) or "nothing"
