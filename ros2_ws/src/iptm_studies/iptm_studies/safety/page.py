"""The page of the safety trials: one table for each part, and every trial in which something did not hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iptm_core.markdown import markdown_table, render_page
from iptm_core.metrics import figure_values
from iptm_faults.kinds import FaultKind
from iptm_studies.judging import Judged
from iptm_studies.safety.braking import BrakingOutcomes
from iptm_studies.safety.findings import (
    Findings,
    by_period,
    by_setting,
    energy_percent,
    fallbacks,
    hours,
    savings_percent,
    smallest_margin_m,
)
from iptm_studies.safety.judging import AVOIDABLE, SOUND_SHARE
from iptm_studies.safety.trials import SETTINGS

Rows = list[tuple[object, ...]]


def safety_page(command: str, revision: str, findings: Findings) -> str:
    """Return the page.

    Args:
        command: what made it.
        revision: of the code that was driven.
        findings: what was found.
    """
    return render_page(
        "iptm_studies.safety",
        "page.md.j2",
        table=markdown_table,
        command=command,
        revision=revision,
        findings=findings,
        braking_count=sum(found.time_s.size for found in findings.braking.values()),
        broken=findings.broken(),
        braking=_braking_rows(findings.braking),
        braking_collisions=_braking_collisions(findings.braking),
        trials=[_group_row(name, group) for name, group in _groups(findings.trials).items()],
        collisions=_collisions(findings.trials),
        over_ros=[
            (
                trial.name,
                trial.what,
                f"{trial.figures['smallest_gap_m']:.1f}" if trial.figures else "–",
                trial.problem_text or "✓",
            )
            for trial in findings.over_ros
        ],
        driving=_driving_rows(findings),
        settings=[f"{name}:" for name in SETTINGS],
        savings=[
            (cycle, *(_saving_text(findings, cycle, name, of_cycle) for name in SETTINGS))
            for cycle, of_cycle in savings_percent(findings).items()
        ],
        delays=_delay_rows(findings),
    )


def _braking_rows(outcomes: Mapping[str, BrakingOutcomes]) -> Rows:
    named = {name: [found] for name, found in outcomes.items() if name[0].islower()}
    rows: Rows = []
    for name, group in (named | ({"**all**": list(outcomes.values())} if outcomes else {})).items():
        gaps = np.concatenate([one.smallest_gap_m for one in group])
        rows.append(
            (
                name,
                gaps.size,
                int(sum(one.braked.sum() for one in group)),
                int((gaps <= 0.0).sum()),
                int(sum(one.avoidable.sum() for one in group)),
                f"{gaps.min():.2f}",
                f"{min(one.bound_m.min() for one in group):.2f}",
                f"{max(one.impact_m_s.max() for one in group):.2f}",
            )
        )
    return rows


def _braking_collisions(outcomes: Mapping[str, BrakingOutcomes]) -> Rows:
    return [
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


def _groups(trials: Sequence[Judged]) -> dict[str, list[Judged]]:
    groups: dict[str, list[Judged]] = {"all": list(trials)} if trials else {}
    for trial in trials:
        for name in str(trial.labels["disturbed"]).split(", "):
            if name == "brakes":
                weak = float(trial.labels["brake_share"]) < SOUND_SHARE
                name = "brakes of 60 to 85 %" if weak else "brakes of 85 to 100 %"  # noqa: PLW2901
            groups.setdefault(name, []).append(trial)
    return groups


def _group_row(name: str, group: Sequence[Judged]) -> tuple[object, ...]:
    return (
        f"`{name}`" if name in list(FaultKind) else name,
        len(group),
        sum("collided_at_s" in trial.figures for trial in group),
        sum(AVOIDABLE in trial.problems for trial in group),
        f"{max(trial.figures.get('impact_m_s', 0.0) for trial in group):.1f}",
        sum("report_ticks" in trial.figures for trial in group),
        sum(bool(trial.problems) for trial in group),
    )


def _collisions(trials: Sequence[Judged]) -> Rows:
    return [
        (
            trial.name,
            trial.what,
            f"{trial.figures['collided_at_s']:g}",
            f"{trial.figures['impact_m_s']:.1f}",
            f"{trial.figures['bound_m']:.1f}",
            trial.problem_text or "unavoidable",
        )
        for trial in trials
        if "collided_at_s" in trial.figures
    ]


def _driving_rows(findings: Findings) -> Rows:
    rows: Rows = []
    for measured in (False, True):
        behind = "measured lead vehicles" if measured else "shipped cycles"
        for setting, group in by_setting(findings, measured=measured).items():
            count = sum(one.interventions for one in group)
            length, rate = f"{hours(group):.2f}", f"{count / hours(group):.2f}"
            margin = f"{smallest_margin_m(group):.2f}"
            rows.append(
                (behind, setting, len(group), length, count, rate, fallbacks(group), margin)
            )
    return rows


def _saving_text(findings: Findings, cycle: str, name: str, savings: Mapping[str, float]) -> str:
    if name not in savings:
        return "–"
    earlier = findings.before[0].get(cycle, {}).get(name)
    return f"{savings[name]:.2f}" + ("" if earlier is None else f" ({earlier:.2f})")


def _delay_rows(findings: Findings) -> Rows:
    rows: Rows = []
    for (cycle, period_s), group in by_period(findings).items():
        row: list[object] = [cycle, f"{period_s:g}"]
        for ticks in sorted(group):
            values = figure_values(group[ticks])
            energy = "" if ticks == 0 else f", {energy_percent(group, ticks):+.1f} %"
            row.append(
                f"{values['smallest_margin']:+.2f} m, {values['smallest_gap']:.1f} m, "
                f"{group[ticks].interventions}{energy}"
            )
        rows.append(tuple(row))
    return rows
