"""The page of a campaign: what was drawn, what held, and every run in which something did not."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from iptm_core.declaration import parameter_specs
from iptm_core.markdown import markdown_table
from iptm_core.parameters import field_specs
from iptm_core.settings import PreviewSettings
from iptm_faults.kinds import FaultKind
from iptm_studies.random_cars.draws import (
    ALWAYS,
    FAULT_SHARE,
    FAULT_SIZES,
    IMPERFECT_SHARE,
    LASTING_SHARE,
    MOST_FAULTS,
    PREVIEWS,
    SETTINGS,
    SOMETIMES,
    TOGETHER_SHARE,
    Draw,
    Uniform,
)
from iptm_studies.random_cars.verdicts import REQUIREMENTS, Fallback, Judgement, fallback_text
from iptm_studies.run_spec import RunSpec

NOTICE = "<!-- Made by scripts/campaign from stored runs; do not edit. -->"


@dataclass(frozen=True)
class JudgedRun:
    """A run of the campaign and what became of it.

    Attributes:
        name: name of its case.
        spec: its specification.
        judgement: what was found; None if it failed.
        failure: why it failed, empty if it did not.
    """

    name: str
    spec: RunSpec
    judgement: Judgement | None
    failure: str = ""


def campaign_page(command: str, runs: Sequence[JudgedRun]) -> str:
    """Return the page as Markdown.

    Args:
        command: what makes it.
        runs: the runs in order, without the twins.
    """
    parts = [
        f"# Random cars\n\n{NOTICE}",
        (
            f"Made by `{command}`: {_sizes(runs)}. Every run is a car, a climate, a cycle and a grid drawn "
            "at random; whatever the parameter files accept is legal."
        ),
        "## What must hold, and did it\n\n" + _verdict_table(runs),
        _fallback_part(runs),
        "## Runs in which something did not hold\n\n" + _breach_table(runs),
        "## What is drawn\n\n" + _draw_table(),
    ]
    return "\n\n".join(parts) + "\n"


def verdict_lines(runs: Sequence[JudgedRun]) -> list[str]:
    """Return one line per verdict, for a terminal."""
    return [
        f"{REQUIREMENTS[key].title:32} {len(_breached(runs, key)):4} of {len(_amounts(runs, key)):4} runs"
        for key in REQUIREMENTS
        if math.isfinite(REQUIREMENTS[key].limit)
    ]


def _judged(runs: Iterable[JudgedRun]) -> list[Judgement]:
    return [run.judgement for run in runs if run.judgement is not None]


def _amounts(runs: Iterable[JudgedRun], key: str) -> list[float]:
    return [found.amounts[key] for found in _judged(runs) if key in found.amounts]


def _breached(runs: Iterable[JudgedRun], key: str) -> list[float]:
    return [amount for amount in _amounts(runs, key) if amount > REQUIREMENTS[key].limit]


def _sizes(runs: Sequence[JudgedRun]) -> str:
    judged = _judged(runs)
    ticks = sum(found.ticks for found in judged)
    text = f"{len(judged)} runs, {ticks} ticks"
    failed = len(runs) - len(judged)
    return f"{text}, {failed} runs failed" if failed else text


def _verdict_table(runs: Sequence[JudgedRun]) -> str:
    rows = []
    for key, verdict in REQUIREMENTS.items():
        amounts = _amounts(runs, key)
        report_only = math.isinf(verdict.limit)
        beyond = (
            sum(amount > 0.0 for amount in amounts) if report_only else len(_breached(runs, key))
        )
        allowed = "report only" if report_only else f"{verdict.limit:g} {verdict.unit}"
        worst = f"{max(amounts):.4g} {verdict.unit}" if amounts else "–"
        mark = "" if report_only else ("✗" if beyond else "✓")
        rows.append(
            (verdict.title, verdict.rule, allowed, len(amounts), f"{beyond} {mark}".strip(), worst)
        )
    heads = ("verdict", "measured by", "allowed in a run", "runs", "runs beyond", "most")
    return markdown_table(heads, rows)


def _fallback_part(runs: Sequence[JudgedRun]) -> str:
    judged = _judged(runs)
    ticks = sum(found.ticks for found in judged)
    causes: Counter[Fallback] = Counter()
    for found in judged:
        causes.update(found.fallbacks)
    share = f"{causes.total()} of {ticks} ticks were driven on a fallback"
    if not causes:
        return f"## Fallbacks by cause\n\n{share}."
    share += f", {1e3 * causes.total() / ticks:.2f} in 1000."
    rows = [(fallback_text(cause), count) for cause, count in causes.most_common()]
    return f"## Fallbacks by cause\n\n{share}\n\n" + markdown_table(
        ("command, solve", "ticks"), rows
    )


def _breach_table(runs: Sequence[JudgedRun]) -> str:
    rows: list[tuple[object, ...]] = []
    for run in runs:
        what = f"{run.spec.describe()}, slope {run.spec.slope}"
        if run.judgement is None:
            rows.append((run.name, "failed", "–", run.failure, what))
            continue
        for key in run.judgement.breaches:
            amount = f"{run.judgement.amounts[key]:.4g} {REQUIREMENTS[key].unit}"
            cause = run.judgement.causes.get(key, "")
            rows.append((run.name, REQUIREMENTS[key].title, amount, cause, what))
            what = "as above"
    if not rows:
        return "None."
    return markdown_table(("run", "verdict", "amount", "cause", "specification"), rows)


def _draw_table() -> str:
    rows = [(f"`{name}`", _draw_text(draw, ""), "every run") for name, draw in SETTINGS.items()]
    for draws, where in ((ALWAYS, "every run"), (SOMETIMES, "half of the runs")):
        rows += [
            (f"`{key}`", _draw_text(draw, field_specs()[key].unit), where)
            for key, draw in draws.items()
        ]
    units = {spec.name: spec.unit for spec in parameter_specs(PreviewSettings)}
    where = f"half of the {100.0 * IMPERFECT_SHARE:g} % of the runs without a perfect preview"
    rows += [(f"`{name}`", _draw_text(draw, units[name]), where) for name, draw in PREVIEWS.items()]
    kinds = [
        f"`{kind}`" + (f" {_draw_text(sizes, kind.spec.unit)}" if sizes else "")
        for kind in FaultKind
        if kind.spec.headless
        for sizes in [FAULT_SIZES.get(kind)]
    ]
    share = f"{100.0 * FAULT_SHARE:g} % of the runs by default"
    rows.append((f"1 to {MOST_FAULTS} faults", ", ".join(kinds), share))
    lasts = f"1 to 30 s; until the end of the trip ({100.0 * LASTING_SHARE:g} %)"
    together = f"while the one before it lasts ({100.0 * TOGETHER_SHARE:g} %), else at any instant"
    rows += [("duration of a fault", lasts, ""), ("beginning of a further fault", together, "")]
    return markdown_table(("setting or parameter", "drawn from", "in"), rows)


def _draw_text(draw: Draw, unit: str) -> str:
    if isinstance(draw, Uniform):
        return f"{draw.low:g} to {draw.high:g} {unit}".removesuffix(" 1").strip()
    first, *others = (f"{value}" for value in draw.values)
    share = f"{first} ({100.0 * draw.first:.0f} %)"
    return ", ".join((share, *others)) if others else first
