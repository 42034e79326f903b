"""The page of the safety trials: one table for each part, and every trial in which something did not hold."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import pandas as pd
from studies.judged import Judged
from studies.safety.findings import Findings, by_setting, savings_percent
from studies.safety.judging import AVOIDABLE, SOUND_SHARE
from studies.safety.trials import DELAYS, SETTINGS

from iptm.faults.kinds import FaultKind


def safety_values(findings: Findings) -> dict[str, Any]:
    """Return what the template of the page shows."""
    before, about = findings.before
    braking = findings.braking
    return {
        "findings": findings,
        "broken": findings.broken(),
        "braking": _braking_by_drive(braking),
        "braking_collisions": braking[braking.smallest_gap_m <= 0.0],
        "trials": _by_disturbance(findings.trials),
        "collisions": [
            _record(trial, "unavoidable")
            for trial in findings.trials
            if "collided_at_s" in trial.figures
        ],
        "over_ros": [{"smallest_gap_m": None, **_record(one, "✓")} for one in findings.over_ros],
        "driving": by_setting(findings.driving),
        "settings": {f"{name}:": f"{{{name}}}" for name in SETTINGS},
        "savings": [
            dict.fromkeys(SETTINGS)
            | {
                name: _with_before(value, before.get(cycle, {}).get(name))
                for name, value in found.items()
            }
            | {"cycle": cycle}
            for cycle, found in savings_percent(findings.driving).items()
        ],
        "about_before": about,
        "delays": _delays_by_period(findings.delays),
    }


def _record(trial: Judged, held: str) -> dict[str, Any]:
    verdict = trial.problem_text or held
    return {"name": trial.name, "what": trial.what, "verdict": verdict, **trial.figures}


def _braking_by_drive(braking: pd.DataFrame) -> pd.DataFrame:
    """Return a row per shipped cycle and one for all drives."""
    if braking.empty:
        return braking
    shipped = braking[braking.drive.str[0].str.islower()]
    rows = pd.concat([shipped, braking.assign(drive="**all**")])
    found = rows.assign(collided=rows.smallest_gap_m <= 0.0).groupby("drive", sort=False)
    counts = found[["braked", "collided", "avoidable"]].sum().astype(int)
    return counts.assign(
        trials=found.size(),
        gap_m=found.smallest_gap_m.min(),
        bound_m=found.bound_m.min(),
        impact_m_s=found.impact_m_s.max(),
    ).reset_index()


def _by_disturbance(trials: Sequence[Judged]) -> list[dict[str, Any]]:
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


def _with_before(saving: float, before: float | None) -> str:
    return f"{saving:.2f}" + ("" if before is None else f" ({before:.2f})")


def _delays_by_period(delays: pd.DataFrame) -> list[dict[str, Any]]:
    rows: dict[tuple[str, float], dict[str, Any]] = {}
    for one in delays.itertuples():
        energy = f", {one.energy_percent:+.1f} %" if one.ticks else ""
        row = rows.setdefault((one.cycle, one.period_s), dict.fromkeys(map(_late, DELAYS)))
        row |= {"cycle": one.cycle, "period_s": one.period_s}
        row[_late(one.ticks)] = (
            f"{one.smallest_margin:+.2f} m, {one.smallest_gap:.1f} m, {one.interventions:.0f}{energy}"
        )
    return list(rows.values())


def _late(ticks: int) -> str:
    return f"late_{ticks}"
