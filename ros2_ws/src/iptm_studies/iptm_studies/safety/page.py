"""The page of the safety trials: one table for each part, and every trial in which something did not hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from iptm_core.markdown import markdown_table
from iptm_core.metrics import figure_values
from iptm_faults.kinds import FaultKind
from iptm_studies.safety.braking import BrakingOutcomes
from iptm_studies.safety.findings import (
    Before,
    Driven,
    Findings,
    JudgedTrial,
    by_period,
    by_setting,
    energy_percent,
    fallbacks,
    hours,
    savings_percent,
    smallest_margin_m,
)
from iptm_studies.safety.judging import SOUND_SHARE, brake_share
from iptm_studies.safety.trials import SETTINGS

NOTICE = "<!-- Made by scripts/safety; do not edit. -->"


def safety_page(command: str, revision: str, findings: Findings) -> str:
    """Return the page.

    Args:
        command: what made it.
        revision: of the code that was driven.
        findings: what was found.
    """
    broken = findings.broken()
    parts = [
        "# Safety trials",
        NOTICE,
        f"Made by `{command}` from revision {revision}. {_summary(findings, broken)}",
        "## Lead vehicle that brakes\n\n" + _braking_part(findings.braking),
        "## Disturbed trials\n\n" + _trial_part(findings.trials),
        "## Over ROS 2\n\n" + _ros_part(findings.over_ros),
        "## Driving without events\n\n" + _driving_part(findings),
        "## Delayed commands\n\n" + _delay_part(findings.delays),
        "## What did not hold\n\n" + ("\n".join(f"- {line}" for line in broken) or "Nothing."),
    ]
    return "\n\n".join(parts) + "\n"


def _summary(findings: Findings, broken: Sequence[str]) -> str:
    braking = sum(found.time_s.size for found in findings.braking.values())
    return (
        f"{braking} trials with a braking lead vehicle, {len(findings.trials)} disturbed trials, "
        f"{len(findings.over_ros)} of them over ROS 2 as well, {len(findings.driving)} drives without "
        f"events, {len(findings.delays)} with delayed commands; {len(broken)} did not hold."
    )


# --- braking


def _braking_part(outcomes: Mapping[str, BrakingOutcomes]) -> str:
    text = (
        "From any instant of an undisturbed drive the lead vehicle brakes to a standstill with 2 to 9 m/s^2, "
        "while the commands go on as in the undisturbed drive: only the safety monitor acts. *Bound* is an "
        "independent computation of a vehicle that does nothing but brake as hard as stated, one sampling "
        "period and the delay of the brakes after the lead vehicle."
    )
    rows = [_braking_row(name, [found]) for name, found in outcomes.items() if name[0].islower()]
    if outcomes:
        rows.append(_braking_row("**all**", list(outcomes.values())))
    heads = (
        "drive", "trials:", "monitor braked:", "collisions:", "avoidable:", "smallest gap (m):",
        "smallest gap of the bound (m):", "largest impact (m/s):",
    )  # fmt: skip
    return f"{text}\n\n{markdown_table(heads, rows)}\n\n{_braking_collisions(outcomes)}"


def _braking_row(name: str, found: Sequence[BrakingOutcomes]) -> tuple[object, ...]:
    gaps = np.concatenate([one.smallest_gap_m for one in found])
    return (
        name,
        gaps.size,
        int(sum(one.braked.sum() for one in found)),
        int((gaps <= 0.0).sum()),
        int(sum(one.avoidable.sum() for one in found)),
        f"{gaps.min():.2f}",
        f"{min(one.bound_m.min() for one in found):.2f}",
        f"{max(one.impact_m_s.max() for one in found):.2f}",
    )


def _braking_collisions(outcomes: Mapping[str, BrakingOutcomes]) -> str:
    rows = [
        (
            name,
            f"{found.time_s[index]:g}",
            f"{found.deceleration_m_s2[index]:.2f}",
            f"{found.impact_m_s[index]:.2f}",
            f"{found.bound_impact_m_s[index]:.2f}",
            f"{found.bound_m[index]:.2f}",
        )
        for name, found in outcomes.items()
        for index in np.flatnonzero(found.smallest_gap_m <= 0.0)
    ]
    if not rows:
        return "No collision."
    heads = (
        "drive", "at (s):", "lead braked (m/s^2):", "impact (m/s):", "impact of the bound (m/s):",
        "gap of the bound (m):",
    )  # fmt: skip
    return markdown_table(heads, rows)


# --- disturbed trials


def _groups(trials: Iterable[JudgedTrial]) -> dict[str, list[JudgedTrial]]:
    groups: dict[str, list[JudgedTrial]] = {}
    for trial in trials:
        groups.setdefault("all", []).append(trial)
        for name in trial.disturbed.split(", "):
            groups.setdefault(_group(name, trial), []).append(trial)
    return groups


def _group(name: str, trial: JudgedTrial) -> str:
    if name != "brakes":
        return name
    weak = brake_share(trial.faults) < SOUND_SHARE
    return "brakes of 60 to 85 %" if weak else "brakes of 85 to 100 %"


def _trial_part(trials: Sequence[JudgedTrial]) -> str:
    text = (
        "Closed-loop trials with an event in traffic and one or two disturbances each. A collision is "
        "avoidable if the stated brakes would have avoided it from any row between the beginning of the "
        "event and the collision; with brakes of 60 to 85 % it may have an impact of up to 5 m/s. Service "
        "braking has to be reported within 2 ticks, weak brakes within 1 s of braking."
    )
    rows = []
    for name, group in _groups(trials).items():
        judged = [trial.verdict for trial in group if trial.verdict is not None]
        collided = [verdict for verdict in judged if not math.isnan(verdict.collided_at_s)]
        rows.append(
            (
                f"`{name}`" if name in list(FaultKind) else name,
                len(group),
                len(collided),
                sum("avoidable collision" in verdict.problems for verdict in judged),
                f"{max((verdict.impact_m_s for verdict in judged), default=0.0):.1f}",
                sum(not math.isnan(verdict.report_ticks) for verdict in judged),
                sum(bool(trial.problems) for trial in group),
            )
        )
    heads = (
        "disturbed", "trials:", "collisions:", "avoidable:", "largest impact (m/s):",
        "with service braking:", "did not hold:",
    )  # fmt: skip
    return f"{text}\n\n{markdown_table(heads, rows)}\n\n{_collision_table(trials)}"


def _collision_table(trials: Iterable[JudgedTrial]) -> str:
    rows = [
        (
            trial.name,
            trial.what,
            f"{trial.verdict.collided_at_s:g}",
            f"{trial.verdict.impact_m_s:.1f}",
            f"{trial.verdict.bound_m:.1f}",
            ", ".join(trial.problems) or "unavoidable",
        )
        for trial in trials
        if trial.verdict is not None and not math.isnan(trial.verdict.collided_at_s)
    ]
    if not rows:
        return "No collision."
    heads = (
        "trial", "what", "at (s):", "impact (m/s):", "gap of the bound (m):", "verdict",
    )  # fmt: skip
    return markdown_table(heads, rows)


def _ros_part(trials: Sequence[JudgedTrial]) -> str:
    if not trials:
        return "None driven."
    rows = [
        (
            trial.name,
            trial.what,
            "–" if trial.verdict is None else f"{trial.verdict.smallest_gap_m:.1f}",
            ", ".join(trial.problems) or "✓",
        )
        for trial in trials
    ]
    return markdown_table(("trial", "what", "smallest gap (m):", "verdict"), rows)


# --- driving without events


def _driving_part(findings: Findings) -> str:
    rows = [
        (
            "measured lead vehicles" if measured else "shipped cycles",
            setting,
            len(group),
            f"{hours(group):.2f}",
            interventions,
            f"{interventions / hours(group):.2f}",
            fallbacks(group),
            f"{smallest_margin_m(group):.2f}",
        )
        for measured in (False, True)
        for setting, group in by_setting(findings.driving, measured=measured).items()
        for interventions in [sum(one.metrics.interventions for one in group)]
    ]
    heads = (
        "behind", "disturbed", "drives:", "hours:", "interventions:", "per hour:", "ticks on a fallback:",
        "smallest margin to s_min (m):",
    )  # fmt: skip
    savings = savings_percent(findings.driving)
    saved = [
        (cycle, *(_saving_text(findings.before, cycle, name, of_cycle) for name in SETTINGS))
        for cycle, of_cycle in savings.items()
    ]
    text = (
        "Ageing saved while driving (cyclic, by the paper's law; [years of use](life.md) have the capacity) "
        "against the undisturbed reference strategy, in percent; in brackets the same "
        f"of the version before. {findings.before.about}"
    )
    return (
        f"{markdown_table(heads, rows)}\n\n{text}\n\n"
        f"{markdown_table(('cycle', *(f'{name}:' for name in SETTINGS)), saved)}"
    )


def _saving_text(before: Before, cycle: str, name: str, savings: Mapping[str, float]) -> str:
    if name not in savings:
        return "–"
    earlier = before.savings.get(cycle, {}).get(name)
    return f"{savings[name]:.2f}" + ("" if earlier is None else f" ({earlier:.2f})")


# --- delays


def _delay_part(delays: Sequence[Driven]) -> str:
    rows = []
    for (cycle, period_s), group in by_period(delays).items():
        row: list[object] = [cycle, f"{period_s:g}"]
        for ticks in sorted(group):
            values = figure_values(group[ticks].metrics)
            energy = "" if ticks == 0 else f", {energy_percent(group, ticks):+.1f} %"
            row.append(
                f"{values['smallest_margin']:+.2f} m, {values['smallest_gap']:.1f} m, "
                f"{group[ticks].metrics.interventions}{energy}"
            )
        rows.append(row)
    text = (
        "Smallest margin to s_min, smallest gap, interventions, and battery energy against no delay, both "
        "packs cooled to one temperature and the kinetic energy returned; with a true preview."
    )
    return f"{text}\n\n" + markdown_table(
        ("cycle", "period (s):", "no delay", "1 tick", "2 ticks"), rows
    )
