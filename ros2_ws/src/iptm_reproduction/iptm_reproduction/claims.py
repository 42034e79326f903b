"""The statements of the paper (``claims.yaml``), what the stored runs make of them, and the numbers in texts.

Texts of the data files are Jinja templates that take numbers from stored runs and from print.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import yaml

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction import checks_of_figures, names, trips
from iptm_reproduction.aging import cooling_payback, reproduced_cooling
from iptm_reproduction.names import (
    DASH,
    change_text,
    expanded,
    label,
    labels,
    name_of,
    names_of,
)
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

NO_CAUSE = "No cause has been written down yet."
_ONE_RUN = {"run", "base", "reference"}
"""Arguments of checks that are one run; others with addresses are several."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, paraphrased, its place there, and how it is checked.

    Attributes:
        rule: the check in words, with its tolerances.
        judge: applies it; called only if each run is there and has each of the figures.
        arguments: of the check, by name.
        note: on how the statement is read.
        cause: template of the reason for a difference.
    """

    id: str
    where: str
    statement: str
    rule: str
    judge: Callable[..., Finding]
    arguments: Mapping[str, Any]
    note: str = ""
    cause: str = ""

    @property
    def runs(self) -> tuple[str, ...]:
        """Addresses of the runs without which it cannot be checked."""
        return tuple(text for text in _texts_in(self.arguments.values()) if "/" in text)

    @property
    def figures(self) -> tuple[str, ...]:
        """Figures that each of the runs must have."""
        return tuple(text for text in _texts_in(self.arguments.values()) if text in FIGURES)

    def check(self, results: Results) -> Finding:
        """Return the finding, with the cause of a difference; not tested if anything is missing."""
        lacking = results.lacking(self.runs)
        if lacking:
            return Finding(Verdict.NOT_TESTED, results.missing_text(lacking))
        if any(results.find(run, figure) is None for run in self.runs for figure in self.figures):
            return Finding(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.figures)}")
        finding = self.judge(results, **self.arguments)
        if not finding.verdict.differs:
            return finding
        return replace(finding, cause=rendered(self.cause, **number_texts(results)) or NO_CAUSE)


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


def make_claim(entry: Mapping[str, Any]) -> Claim:
    """Return a statement as in ``claims.yaml``; its check is given by the name of its function."""
    ((kind, given),) = entry["check"].items()
    judge = getattr(checks_of_figures, kind, None) or getattr(trips, kind)
    parameters = list(inspect.signature(judge).parameters.values())[1:]
    arguments = {
        entry.name: _argument(entry.name, given.get(entry.name, entry.default))
        for entry in parameters
        if entry.name in given or entry.default is not entry.empty
    }
    if any(entry.name == "printed" for entry in parameters) and "printed" not in given:
        arguments["printed"] = _printed(kind, arguments)
    texts = {name: text for name, text in entry.items() if name != "check"}
    texts["statement"] = rendered(entry["statement"], **_WORDS, **arguments)
    rule = rendered(_content()["rules"][kind], **_WORDS, **arguments)
    return Claim(**texts, rule=rule, judge=judge, arguments=arguments)


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
    "LOW_PERCENTILE": trips.LOW_PERCENTILE,
    "HIGH_PERCENTILE": trips.HIGH_PERCENTILE,
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
    return {
        topic["title"]: tuple(map(make_claim, topic["claims"])) for topic in _content()["topics"]
    }


_PERCENTILES = (10.0, 90.0)
# The texts are data of this package and end in Markdown, which is not HTML.
_ENVIRONMENT = jinja2.Environment(undefined=jinja2.StrictUndefined)  # noqa: S701


_compiled = cache(_ENVIRONMENT.from_string)


def rendered(template: str, **context: Any) -> str:
    """Return a text with its expressions filled in, and with single spaces only."""
    return re.sub(r"[ \n]+", " ", _compiled(template).render(context)).strip()


def evaluated(expression: str, **context: Any) -> Any:
    """Return the value of an expression."""
    return _ENVIRONMENT.compile_expression(expression, undefined_to_none=False)(context)


def number_texts(results: Results) -> dict[str, Any]:
    """Return what texts are filled in with: functions to numbers with units, runs and figures by name.

    A dash stands for a missing run.
    """

    def value(run: str, figure: str) -> str:
        return FIGURES[figure].with_unit(results.find(run, figure))

    def printed(run: str, figure: str) -> str:
        return FIGURES[figure].with_unit(printed_value(run, figure))

    def change(run: str, base: str, figure: str) -> str:
        return change_text(results.change(run, base, figure))

    def payback(run: str) -> str:
        """Return the range of times after which cooling with drawn power has paid on a trip."""
        found = cooling_payback(results[run], _PERCENTILES) if run in results else None
        if found is None:
            return f"{DASH} s"
        return f"{min(found.times_s.values()):.0f} to {max(found.times_s.values()):.0f} s"

    def braking_share(run: str) -> str:
        """Return the part of the compressor energy that is spent while braking."""
        share = trips.share_while_braking(results[run].trajectory) if run in results else None
        return f"{DASH} %" if share is None else f"{100.0 * share:.1f} %"

    functions: tuple[Callable[..., str], ...] = (value, printed, change, payback, braking_share)
    constants = {name: entry for name, entry in vars(names).items() if name.isupper()}
    return {
        **constants,
        **{function.__name__: function for function in functions},
        "printed_cooling": reproduced_cooling(),
        "results": results,
    }
