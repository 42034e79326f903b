"""Random legal cars, climates, cycles and grids, and what must hold in every run of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from studies.judged import Judged
from studies.random_cars import draws
from studies.random_cars.draws import FAULT_SHARE, IMPERFECT_SHARE, TWIN, Draw, random_cases
from studies.random_cars.judging import REQUIREMENTS, TICKS, judge, trial_of
from studies.session import Case, Session, inputs_of

from iptm import Run
from iptm.parts import (
    FaultKind,
    PreviewSettings,
    field_specs,
    parameter_specs,
)

SHORT_RUNS, SHORT_S = 4, 60.0


def run(session: Session) -> bool:
    """Run the study; returns whether every requirement holds in every run."""
    options = session.options
    extent = (SHORT_RUNS, SHORT_S) if session.short else (options.runs, options.duration_s or None)
    cases = random_cases(extent[0], options.seed, extent[1])
    found = session.drive(cases)
    runs = judged_runs(cases, dict(zip(found.case, found.run, strict=True)), session.failures)
    session.failures.clear()  # they are problems of their runs
    judged = [one for one in runs if one.figures]
    rows = _requirement_rows(runs)
    fallbacks = sum((Counter(one.counts) for one in judged), Counter[str]())
    session.render(
        runs=len(judged),
        seed=options.seed,
        duration_s=extent[1],
        failed=len(runs) - len(judged),
        ticks=round(sum(one.figures[TICKS] for one in judged)),
        requirements=rows,
        fallbacks=[{"cause": cause, "ticks": count} for cause, count in fallbacks.most_common()],
        breaches=_breach_rows(runs),
        drawn=_drawn_rows(),
    )
    for row in rows:
        if not row["is_report"]:
            session.say(f"{row['title']:32} {row['beyond']:4} of {row['runs']:4} runs")
    return not any(one.problems for one in runs)


def judged_runs(
    cases: Sequence[Case], runs: Mapping[str, Run | None], failures: Mapping[str, str]
) -> list[Judged]:
    """Judge runs, each with its twin if it has one."""
    judged = []
    for case in cases:
        if case.name.endswith(TWIN):
            continue
        driven = runs[case.name]
        if driven is None:
            judged.append(trial_of(case.name, inputs_of(case.call), failures[case.name]))
        else:
            twin = runs.get(f"{case.name}_{TWIN}")
            judged.append(judge(case.name, driven, case.call, twin))
    return judged


def _requirement_rows(runs: Sequence[Judged]) -> list[dict[str, Any]]:
    amounts = pd.DataFrame([run.figures for run in runs], columns=list(REQUIREMENTS))
    rows = []
    for key, one in REQUIREMENTS.items():
        found = amounts[key].dropna()
        beyond = int((found > (0.0 if one.is_report else one.limit)).sum())
        mark = "" if one.is_report else (" ✗" if beyond else " ✓")
        rows.append(
            {
                "title": one.title,
                "rule": one.rule,
                "is_report": one.is_report,
                "allowed": "report only" if one.is_report else f"{one.limit:g} {one.unit}",
                "runs": len(found),
                "beyond": beyond,
                "marked": f"{beyond}{mark}",
                "most": None if found.empty else f"{found.max():.4g} {one.unit}",
            }
        )
    return rows


def _breach_rows(runs: Sequence[Judged]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for run in runs:
        what = run.what
        for key, cause in run.problems.items():
            row = {"run": run.name, "title": key, "amount": None, "cause": cause, "what": what}
            if (one := REQUIREMENTS.get(key)) is not None:
                row |= {"title": one.title, "amount": f"{run.figures[key]:.4g} {one.unit}"}
            rows.append(row)
            what = "as above"
    return rows


def _drawn_rows() -> list[dict[str, str]]:
    previews = {spec.name: spec.unit for spec in parameter_specs(PreviewSettings)}
    imperfect = f"half of the {100.0 * IMPERFECT_SHARE:g} % of the runs without a perfect preview"
    parameters = {key: spec.unit for key, spec in field_specs().items()}
    groups: tuple[tuple[Mapping[str, Draw], Mapping[str, str], str], ...] = (
        (draws.SETTINGS, {}, "every run"),
        (draws.ALWAYS, parameters, "every run"),
        (draws.SOMETIMES, parameters, "half of the runs"),
        (draws.PREVIEWS, previews, imperfect),
    )
    rows = [
        {"name": f"`{name}`", "drawn": _draw_text(draw, units.get(name, "")), "where": where}
        for group, units, where in groups
        for name, draw in group.items()
    ]
    kinds = [
        f"`{kind}`" + (f" {_draw_text(sizes, kind.spec.unit)}" if sizes else "")
        for kind in FaultKind
        if kind.spec.headless and kind not in draws.ORDINARY
        for sizes in [draws.FAULT_SIZES.get(kind)]
    ]
    lasts = f"1 to 30 s; until the end of the trip ({100.0 * draws.LASTING_SHARE:g} %)"
    together = 100.0 * draws.TOGETHER_SHARE
    faults = (
        (
            f"1 to {draws.MOST_FAULTS} faults",
            ", ".join(kinds),
            f"{100.0 * FAULT_SHARE:g} % of the runs by default",
        ),
        ("duration of a fault", lasts, ""),
        (
            "beginning of a further fault",
            f"while the one before it lasts ({together:g} %), else at any instant",
            "",
        ),
    )
    return rows + [dict(zip(("name", "drawn", "where"), row, strict=True)) for row in faults]


def _draw_text(draw: Draw, unit: str) -> str:
    if not isinstance(draw, Mapping):
        low, high = draw
        return f"{low:g} to {high:g} {unit}".removesuffix(" 1").strip()
    first, *others = map(str, draw["values"])
    return ", ".join((f"{first} ({100.0 * draw['first']:.0f} %)", *others)) if others else first
