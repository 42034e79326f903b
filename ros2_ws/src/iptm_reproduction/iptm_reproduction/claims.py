"""The statements of the paper (``claims.yaml``) and what the stored runs make of them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction import checks_of_figures, checks_of_trips
from iptm_reproduction.checks_of_figures import LEVEL_STEP
from iptm_reproduction.figures import label, labels
from iptm_reproduction.names import expanded, name_of, names_of
from iptm_reproduction.printed import RANGES, printed_change, printed_value
from iptm_reproduction.results import Results
from iptm_reproduction.texts import number_texts, rendered
from iptm_reproduction.trips import HIGH_PERCENTILE, LOW_PERCENTILE
from iptm_reproduction.verdict import (
    CHANGE_FLOOR,
    CHANGE_SHARE,
    Finding,
    Verdict,
    accepted_deviation,
)

NO_CAUSE = "No cause has been written down yet."

_RUN = ("run", "base", "reference")
_RUNS = ("runs", "others", "lower", "higher", "ends", "among")
_GROUPS = ("groups", "candidates")
_FIGURES = ("figure", "figures", "directions")


@dataclass(frozen=True)
class Check:
    """How one statement is checked.

    Attributes:
        rule: the check in words, with its tolerances.
        judge: applies it; called only if each run is there and has each of the figures.
        runs: addresses of the runs without which it cannot be applied.
        figures: figures that each of the runs must have.
        arguments: of the check, by name.
    """

    rule: str
    judge: Callable[..., Finding]
    runs: tuple[str, ...]
    figures: tuple[str, ...]
    arguments: Mapping[str, Any]

    def apply(self, results: Results) -> Finding:
        """Return the finding; not tested if a run or a figure is missing."""
        lacking = results.lacking(self.runs)
        if lacking:
            return Finding(Verdict.NOT_TESTED, results.missing_text(lacking))
        if any(results.find(run, figure) is None for run in self.runs for figure in self.figures):
            return Finding(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.figures)}")
        return self.judge(results, **self.arguments)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, paraphrased.

    Attributes:
        id: short name.
        where: place in the paper.
        statement: the statement.
        check: how it is checked.
        note: remark on how the statement is read; may be empty.
        cause: template of the reason for a difference; may be empty.
    """

    id: str
    where: str
    statement: str
    check: Check
    note: str = ""
    cause: str = ""


@dataclass(frozen=True)
class CheckedClaim:
    """A statement and what the check has found; a cause where it is not simply reproduced."""

    claim: Claim
    finding: Finding
    cause: str

    @property
    def verdict(self) -> Verdict:
        """The outcome."""
        return self.finding.verdict


def make_check(kind: str, **given: Any) -> Check:
    """Return a check by the name of its function, with runs as in ``claims.yaml``."""
    judge = getattr(checks_of_figures, kind, None) or getattr(checks_of_trips, kind)
    parameters = list(inspect.signature(judge).parameters.values())[1:]
    arguments = {
        entry.name: entry.default for entry in parameters if entry.default is not entry.empty
    } | {name: _argument(name, value) for name, value in given.items()}
    if {"printed", *arguments} == {entry.name for entry in parameters} and "printed" not in given:
        arguments["printed"] = _printed(kind, arguments)
    runs: list[str] = []
    figures: list[str] = []
    for name in (entry.name for entry in parameters if entry.name in arguments):
        value = arguments[name]
        if name in _RUN:
            runs.append(value)
        elif name in _RUNS:
            runs += value
        elif name in _GROUPS:
            runs += [run for series in value.values() for run in series]
        elif name in _FIGURES:
            figures += [value] if isinstance(value, str) else value
    return Check(
        rendered(_content()["rules"][kind], **_WORDS, **arguments),
        judge,
        tuple(runs),
        tuple(figures),
        arguments,
    )


def _argument(name: str, value: Any) -> Any:
    if name in _RUNS:
        return expanded(*([value] if isinstance(value, str) else value))
    if name in _GROUPS:
        return {key: _argument("runs", runs) for key, runs in value.items()}
    return value


def _printed(kind: str, arguments: Mapping[str, Any]) -> Any:
    """Return the printed number, or the printed range, that a check compares with."""
    figure = arguments["figure"]
    if kind == "changes_in_range":
        return RANGES[arguments["runs"][0].partition("/")[0]][figure]
    return (printed_change if kind == "change" else printed_value)(arguments["run"], figure)


def _percent(share: float) -> str:
    return f"{100.0 * share:g}"


def _bounds(lowest: float | None, highest: float | None, unit: str) -> str:
    return " and ".join(
        f"{word} {bound:g} {unit}".strip()
        for word, bound in (("at least", lowest), ("at most", highest))
        if bound is not None
    )


_WORDS = {
    "name": name_of,
    "names": names_of,
    "label": label,
    "labels": labels,
    "percent": _percent,
    "bounds": _bounds,
    "accepted": accepted_deviation,
    "decrease": lambda change: f"{-100.0 * change:.2f} %",
    "sizes": lambda ends: (
        " to ".join(f"{size:.4g}" for size in sorted(100.0 * abs(x) for x in ends)) + " %"
    ),
    "tolerance": f"the larger of {_percent(CHANGE_FLOOR)} percentage point(s) and "
    f"{_percent(CHANGE_SHARE)} % of the printed change",
    "FIGURES": FIGURES,
    "LEVEL_STEP": LEVEL_STEP,
    "LOW_PERCENTILE": LOW_PERCENTILE,
    "HIGH_PERCENTILE": HIGH_PERCENTILE,
}
"""What rules and statements are written with."""


@cache
def _content() -> dict[str, Any]:
    source = Path(__file__).with_name("claims.yaml").read_text(encoding="utf-8")
    content: dict[str, Any] = yaml.safe_load(source)
    return content


@cache
def claims_by_topic() -> dict[str, tuple[Claim, ...]]:
    """Return every statement of the paper that is checked, by topic, in the order of the paper."""
    return {topic["title"]: tuple(map(_claim, topic["claims"])) for topic in _content()["topics"]}


def _claim(entry: Mapping[str, Any]) -> Claim:
    ((kind, arguments),) = entry["check"].items()
    check = make_check(kind, **arguments)
    statement = rendered(entry["statement"], **_WORDS, **check.arguments)
    return Claim(
        entry["id"],
        entry["where"],
        statement,
        check,
        entry.get("note", ""),
        entry.get("cause", ""),
    )


def check_claims(claims: tuple[Claim, ...], results: Results) -> tuple[CheckedClaim, ...]:
    """Check statements, in their order; a difference gets its cause, with the numbers of the runs."""
    checked = []
    numbers = number_texts(results)
    for claim in claims:
        finding = claim.check.apply(results)
        cause = rendered(claim.cause, **numbers) or NO_CAUSE if finding.verdict.differs else ""
        checked.append(CheckedClaim(claim, finding, cause))
    return tuple(checked)
