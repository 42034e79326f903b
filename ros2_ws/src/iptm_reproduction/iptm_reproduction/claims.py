"""The statements of the paper (``claims.yaml``) and what the stored runs make of them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction import checks_of_figures, checks_of_trips
from iptm_reproduction.names import expanded, label, labels, name_of, names_of
from iptm_reproduction.printed import (
    CHANGE_FLOOR,
    CHANGE_SHARE,
    RANGES,
    Finding,
    Verdict,
    accepted_deviation,
    printed_change,
    printed_value,
)
from iptm_reproduction.results import Results
from iptm_reproduction.texts import number_texts, rendered
from iptm_reproduction.trips import HIGH_PERCENTILE, LOW_PERCENTILE

NO_CAUSE = "No cause has been written down yet."
_ONE_RUN = {"run", "base", "reference"}
"""Arguments of checks that are one run; others with addresses are several."""


@dataclass(frozen=True)
class Check:
    """How one statement is checked.

    Attributes:
        rule: the check in words, with its tolerances.
        judge: applies it; called only if each run is there and has each of the figures.
        arguments: of the check, by name.
    """

    rule: str
    judge: Callable[..., Finding]
    arguments: Mapping[str, Any]

    @property
    def runs(self) -> tuple[str, ...]:
        """Addresses of the runs without which it cannot be applied."""
        return tuple(text for text in _texts_in(self.arguments.values()) if "/" in text)

    @property
    def figures(self) -> tuple[str, ...]:
        """Figures that each of the runs must have."""
        return tuple(text for text in _texts_in(self.arguments.values()) if text in FIGURES)

    def apply(self, results: Results) -> Finding:
        """Return the finding; not tested if a run or a figure is missing."""
        lacking = results.lacking(self.runs)
        if lacking:
            return Finding(Verdict.NOT_TESTED, results.missing_text(lacking))
        if any(results.find(run, figure) is None for run in self.runs for figure in self.figures):
            return Finding(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.figures)}")
        return self.judge(results, **self.arguments)


def _texts_in(values: Any) -> Iterator[str]:
    """Return the texts in nested lists and mappings, keys included."""
    for value in values:
        if isinstance(value, str):
            yield value
        elif isinstance(value, Mapping):
            yield from value
            yield from _texts_in(value.values())
        elif isinstance(value, list | tuple):
            yield from _texts_in(value)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, paraphrased, and its place there.

    ``note`` is on how the statement is read, ``cause`` the template of the reason for a difference.
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
        entry.name: _argument(entry.name, given.get(entry.name, entry.default))
        for entry in parameters
        if entry.name in given or entry.default is not entry.empty
    }
    if any(entry.name == "printed" for entry in parameters) and "printed" not in given:
        arguments["printed"] = _printed(kind, arguments)
    return Check(rendered(_content()["rules"][kind], **_WORDS, **arguments), judge, arguments)


def _argument(name: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _argument(name, entry) for key, entry in value.items()}
    if name in _ONE_RUN or not any("/" in text for text in _texts_in([value])):
        return value
    return expanded(*([value] if isinstance(value, str) else value))


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


def _sizes(ends: tuple[float, float]) -> str:
    low, high = sorted(100.0 * abs(end) for end in ends)
    return f"{low:.4g} to {high:.4g} %"


_WORDS = {
    "name": name_of,
    "names": names_of,
    "label": label,
    "labels": labels,
    "percent": _percent,
    "bounds": _bounds,
    "sizes": _sizes,
    "decrease": lambda change: f"{-100.0 * change:.2f} %",
    "accepted": accepted_deviation,
    "tolerance": f"the larger of {_percent(CHANGE_FLOOR)} percentage point(s) and "
    f"{_percent(CHANGE_SHARE)} % of the printed change",
    "FIGURES": FIGURES,
    "LEVEL_STEP": checks_of_figures.LEVEL_STEP,
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
    ((kind, given),) = entry["check"].items()
    check = make_check(kind, **given)
    statement = rendered(entry["statement"], **_WORDS, **check.arguments)
    return Claim(**{**entry, "statement": statement, "check": check})


def check_claims(claims: tuple[Claim, ...], results: Results) -> tuple[CheckedClaim, ...]:
    """Check statements, in their order; a difference gets its cause, with the numbers of the runs."""
    checked = []
    numbers = number_texts(results)
    for claim in claims:
        finding = claim.check.apply(results)
        cause = rendered(claim.cause, **numbers) or NO_CAUSE if finding.verdict.differs else ""
        checked.append(CheckedClaim(claim, finding, cause))
    return tuple(checked)
