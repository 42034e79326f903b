"""The page of the safety trials: one table for each part, and every trial in which something did not hold."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from iptm_core.markdown import render_page
from iptm_core.metrics import figure_values
from iptm_faults.kinds import FaultKind
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
from iptm_studies.study import Judged

Records = list[dict[str, Any]]


def safety_page(command: str, revision: str, findings: Findings) -> str:
    """Return the page.

    Args:
        command: what made it.
        revision: of the code that was driven.
        findings: what was found.
    """
    settings, (before, about) = list(SETTINGS), findings.before
    return render_page(
        "iptm_studies.safety",
        "page.md.j2",
        command=command,
        revision=revision,
        findings=findings,
        braking_count=sum(found.time_s.size for found in findings.braking.values()),
        broken=findings.broken(),
        braking=_braking_records(findings.braking),
        braking_collisions=_braking_collisions(findings.braking),
        trials=_group_records(findings.trials),
        collisions=[
            _record(trial, "unavoidable")
            for trial in findings.trials
            if "collided_at_s" in trial.figures
        ],
        over_ros=[{"smallest_gap_m": None, **_record(one, "✓")} for one in findings.over_ros],
        driving=_driving_records(findings),
        settings={f"{name}:": f"{{{name}}}" for name in settings},
        savings=[
            {"cycle": cycle}
            | {name: _saving_text(found, before.get(cycle, {}), name) for name in settings}
            for cycle, found in savings_percent(findings).items()
        ],
        about_before=about,
        delays=_delay_records(findings),
    )


def _record(trial: Judged, held: str) -> dict[str, Any]:
    verdict = trial.problem_text or held
    return {"name": trial.name, "what": trial.what, "verdict": verdict, **trial.figures}


def _braking_records(outcomes: Mapping[str, BrakingOutcomes]) -> Records:
    groups = {name: [found] for name, found in outcomes.items() if name[0].islower()}
    if outcomes:
        groups["**all**"] = list(outcomes.values())
    records: Records = []
    for name, group in groups.items():
        gaps = np.concatenate([one.smallest_gap_m for one in group])
        records.append(
            {
                "drive": name,
                "trials": gaps.size,
                "braked": int(sum(one.braked.sum() for one in group)),
                "collisions": int((gaps <= 0.0).sum()),
                "avoidable": int(sum(one.avoidable.sum() for one in group)),
                "gap_m": gaps.min(),
                "bound_m": min(one.bound_m.min() for one in group),
                "impact_m_s": max(one.impact_m_s.max() for one in group),
            }
        )
    return records


def _braking_collisions(outcomes: Mapping[str, BrakingOutcomes]) -> Records:
    return [
        {"drive": name, **{key: values[index] for key, values in vars(found).items()}}
        for name, found in outcomes.items()
        for index in np.flatnonzero(found.smallest_gap_m <= 0.0)
    ]


def _group_records(trials: Sequence[Judged]) -> Records:
    groups: defaultdict[str, list[Judged]] = defaultdict(list)
    for trial in trials:
        groups["all"].append(trial)
        for name in str(trial.labels["disturbed"]).split(", "):
            if name == "brakes":
                weak = float(trial.labels["brake_share"]) < SOUND_SHARE
                name = "brakes of 60 to 85 %" if weak else "brakes of 85 to 100 %"  # noqa: PLW2901
            groups[name].append(trial)
    return [
        {
            "disturbed": f"`{name}`" if name in list(FaultKind) else name,
            "trials": len(group),
            "collisions": sum("collided_at_s" in trial.figures for trial in group),
            "avoidable": sum(AVOIDABLE in trial.problems for trial in group),
            "impact_m_s": max(trial.figures.get("impact_m_s", 0.0) for trial in group),
            "braked": sum("report_ticks" in trial.figures for trial in group),
            "broken": sum(bool(trial.problems) for trial in group),
        }
        for name, group in groups.items()
    ]


def _driving_records(findings: Findings) -> Records:
    records: Records = []
    for measured in (False, True):
        for setting, group in by_setting(findings, measured=measured).items():
            count = sum(one.interventions for one in group)
            records.append(
                {
                    "behind": "measured lead vehicles" if measured else "shipped cycles",
                    "setting": setting,
                    "drives": len(group),
                    "hours": hours(group),
                    "interventions": count,
                    "per_hour": count / hours(group),
                    "fallbacks": fallbacks(group),
                    "margin_m": f"{smallest_margin_m(group):.2f}",
                }
            )
    return records


def _saving_text(savings: Mapping[str, float], before: Mapping[str, float], name: str) -> str:
    if name not in savings:
        return "–"
    return f"{savings[name]:.2f}" + (f" ({before[name]:.2f})" if name in before else "")


def _delay_records(findings: Findings) -> Records:
    records: Records = []
    for (cycle, period_s), group in by_period(findings).items():
        record: dict[str, Any] = {"cycle": cycle, "period_s": period_s}
        for ticks, metrics in group.items():
            values = figure_values(metrics)
            energy = "" if ticks == 0 else f", {energy_percent(group, ticks):+.1f} %"
            record[f"late_{ticks}"] = (
                f"{values['smallest_margin']:+.2f} m, {values['smallest_gap']:.1f} m, "
                f"{metrics.interventions}{energy}"
            )
        records.append({"late_0": None, "late_1": None, "late_2": None, **record})
    return records
