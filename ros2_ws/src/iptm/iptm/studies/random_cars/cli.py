"""The command behind ``scripts/campaign``: random runs, computed or found, judged, and a page about them."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from iptm.faults.kinds import FaultKind
from iptm.studies.campaign import Campaign
from iptm.studies.laboratory import Laboratory, Session
from iptm.studies.random_cars import draws
from iptm.studies.random_cars.draws import (
    FAULT_SHARE,
    IMPERFECT_SHARE,
    TWIN,
    Draw,
    random_study,
)
from iptm.studies.random_cars.judging import REQUIREMENTS, TICKS, judge, trial_of
from iptm.studies.store import ResultStore
from iptm.studies.study import Judged, planned_run
from iptm_core.declaration import parameter_specs
from iptm_core.markdown import render_page
from iptm_core.parameters import field_specs
from iptm_core.settings import PreviewSettings
from iptm_core.user_input import number, whole_number

PAGE = "random-cars.md"
RUNS = 300
SEED = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    laboratory = Laboratory("campaign", PAGE, __doc__)
    parser = laboratory.parser
    for name, usual, text in (
        ("runs", RUNS, "number of runs"),
        ("seed", SEED, "seed of all draws"),
    ):
        text = f"{text}, {usual} by default"  # noqa: PLW2901
        parser.add_argument(f"--{name}", type=whole_number, default=usual, metavar="N", help=text)
    parser.add_argument(
        "--duration-s", type=number, metavar="T", help="length of all trips instead of those drawn"
    )
    parser.add_argument(
        "--without-twins",
        action="store_true",
        help="leave out the warm twins of cold runs, and the verdict on traction energy with them",
    )
    for name, share, text in (
        ("fault", FAULT_SHARE, "with faults"),
        ("imperfect", IMPERFECT_SHARE, "without a perfect preview"),
    ):
        text = f"share of the runs {text}, {share:g} by default"  # noqa: PLW2901
        parser.add_argument(f"--{name}-share", type=float, default=share, metavar="P", help=text)
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options = session.options
    study = random_study(
        options.runs,
        options.seed,
        options.duration_s,
        with_twins=not options.without_twins,
        fault_share=options.fault_share,
        imperfect_share=options.imperfect_share,
    )
    campaign = Campaign([study])
    if not session.compute(campaign):
        return True
    runs = judged_runs(campaign, session.store)
    rows = _requirement_rows(runs)
    for row in rows:
        if not row["is_report"]:
            print(f"{row['title']:32} {row['beyond']:4} of {row['runs']:4} runs")
    session.write(campaign_page(session.command, runs))
    return not any(run.problems for run in runs)


def judged_runs(campaign: Campaign, store: ResultStore) -> list[Judged]:
    """Judge the runs of a campaign of random cars, each with its twin if it has one."""
    keys = {state.name: state.key for state in campaign.cases if state.metrics is not None}
    judged = []
    for state in campaign.cases:
        name, spec = state.name, state.spec
        if name.endswith(TWIN):
            continue
        if name not in keys:
            judged.append(trial_of(name, spec, state.reason))
            continue
        twin_key = keys.get(f"{name}_{TWIN}")
        twin = None if twin_key is None else store.load(twin_key)
        judged.append(judge(name, store.load(keys[name]), planned_run(spec), twin))
    return judged


def campaign_page(command: str, runs: Sequence[Judged]) -> str:
    """Return the page about runs in order, without the twins, as Markdown; ``command`` makes it."""
    judged = [run for run in runs if run.figures]
    fallbacks = sum((Counter(run.counts) for run in judged), Counter[str]())
    return render_page(
        "iptm.studies.random_cars",
        "page.md.j2",
        command=command,
        runs=len(judged),
        failed=len(runs) - len(judged),
        ticks=round(sum(run.figures[TICKS] for run in judged)),
        requirements=_requirement_rows(runs),
        fallbacks=[{"cause": cause, "ticks": count} for cause, count in fallbacks.most_common()],
        breaches=_breach_rows(runs),
        drawn=_drawn_rows(),
    )


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
        if kind.spec.headless
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


if __name__ == "__main__":
    sys.exit(main())
