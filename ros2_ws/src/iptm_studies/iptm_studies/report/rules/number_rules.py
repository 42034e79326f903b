"""Rules for printed numbers: a change, a range of changes, a value, a threshold."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_studies.report.measures import MEASURES, change_text, relative_change
from iptm_studies.report.naming import name_of, names_of
from iptm_studies.report.rules.base import Printed, Rule, changes, label, labels, points
from iptm_studies.report.runs import Results
from iptm_studies.report.verdict import Judgement, Tolerance, Verdict, worst


def _change(results: Results, run: str, base: str, key: str) -> float | None:
    return relative_change(results.measure(run, key), results.measure(base, key))


def _no_figure(keys: tuple[str, ...]) -> Judgement:
    return Judgement(Verdict.NOT_TESTED, f"the stored runs have no {labels(keys)}")


@dataclass(frozen=True)
class Change(Rule):
    """A printed relative change of one figure between two runs."""

    run: str
    base: str
    measure: str
    printed: float

    def needs(self) -> tuple[str, ...]:
        """Both runs."""
        return (self.run, self.base)

    def text(self, printed: Printed) -> str:
        """The rule in words."""
        tolerance = printed.change_tolerance
        return (
            f"Change of {label(self.measure)} from {name_of(self.base)} to {name_of(self.run)}: "
            f"reproduced within {points(tolerance)} "
            f"(here {100.0 * tolerance.accepted(self.printed):.2f} points); in sign only with the same sign."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Compare the change with the printed one."""
        found = _change(results, self.run, self.base, self.measure)
        if found is None:
            return _no_figure((self.measure,))
        verdict = printed.change_tolerance.judge(found, self.printed)
        return Judgement(verdict, change_text(found), change_text(self.printed))


@dataclass(frozen=True)
class ChangesInRange(Rule):
    """A printed range of relative changes over several runs."""

    runs: tuple[str, ...]
    base: str
    measure: str
    lowest: float
    highest: float

    def needs(self) -> tuple[str, ...]:
        """All runs and the base."""
        return (*self.runs, self.base)

    def text(self, printed: Printed) -> str:
        """The rule in words."""
        return (
            f"Smallest and largest change of {label(self.measure)} against {name_of(self.base)} over "
            f"{len(self.runs)} runs: reproduced if both lie within {points(printed.change_tolerance)}; "
            "in sign only if all runs have the sign of the printed range."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Compare both ends of the range."""
        found = [_change(results, run, self.base, self.measure) for run in self.runs]
        known = [value for value in found if value is not None]
        if len(known) < len(found):
            return _no_figure((self.measure,))
        ends = (min(known), max(known))
        verdict = worst(
            [
                printed.change_tolerance.judge(ours, theirs)
                for ours, theirs in zip(ends, (self.lowest, self.highest), strict=True)
            ]
        )
        return Judgement(
            verdict,
            f"{change_text(ends[0])} to {change_text(ends[1])}",
            f"{change_text(self.lowest)} to {change_text(self.highest)}",
        )


@dataclass(frozen=True)
class ChangeAtLeast(Rule):
    """A printed bound on the reduction of several figures ("more than 12 %")."""

    run: str
    base: str
    measures: tuple[str, ...]
    reduction: float
    margin: float = 0.0

    def needs(self) -> tuple[str, ...]:
        """Both runs."""
        return (self.run, self.base)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Reduction of {labels(self.measures)} from {name_of(self.base)} to {name_of(self.run)}: "
            f"reproduced if each is at least {100.0 * (self.reduction - self.margin):g} %; in "
            "sign only if each is a reduction."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Compare each reduction with the bound."""
        found = {label(key): _change(results, self.run, self.base, key) for key in self.measures}
        known = [value for value in found.values() if value is not None]
        if len(known) < len(found):
            return _no_figure(self.measures)
        if all(value <= self.margin - self.reduction for value in known):
            verdict = Verdict.REPRODUCED
        elif all(value < 0.0 for value in known):
            verdict = Verdict.SIGN_ONLY
        else:
            verdict = Verdict.NOT_REPRODUCED
        theirs = {
            label(key): relative_change(printed.value(self.run, key), printed.value(self.base, key))
            for key in self.measures
        }
        known_theirs = all(value is not None for value in theirs.values())
        in_print = changes(theirs) if known_theirs else f"at least {100.0 * self.reduction:g} %"
        return Judgement(verdict, changes(found), in_print)


@dataclass(frozen=True)
class Value(Rule):
    """A printed value of one figure of one run."""

    run: str
    measure: str
    printed: float
    share: float
    floor: float

    def needs(self) -> tuple[str, ...]:
        """The run."""
        return (self.run,)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        accepted = Tolerance(self.share, self.floor).accepted(self.printed)
        unit = MEASURES[self.measure].unit
        return (
            f"{MEASURES[self.measure].label} of {name_of(self.run)}: reproduced within {accepted:g} {unit} "
            "of the printed value; in sign only with the same sign."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the value with the printed one."""
        found = results.measure(self.run, self.measure)
        if found is None:
            return _no_figure((self.measure,))
        measure = MEASURES[self.measure]
        return Judgement(
            Tolerance(self.share, self.floor).judge(found, self.printed),
            measure.with_unit(found),
            measure.with_unit(self.printed),
        )


@dataclass(frozen=True)
class ValueBetween(Rule):
    """Figures of some runs that lie inside bounds; a bound of None does not count."""

    runs: tuple[str, ...]
    measures: tuple[str, ...]
    lowest: float | None = None
    highest: float | None = None

    def needs(self) -> tuple[str, ...]:
        """The runs."""
        return self.runs

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        bounds = [
            f"{word} {value:g} {MEASURES[self.measures[0]].unit}".strip()
            for word, value in (("at least", self.lowest), ("at most", self.highest))
            if value is not None
        ]
        return f"Reproduced if {labels(self.measures)} of {names_of(self.runs)}: {' and '.join(bounds)}."

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare each figure with the bounds."""
        parts, holds = [], True
        for run in self.runs:
            for key in self.measures:
                found = results.measure(run, key)
                if found is None:
                    return _no_figure(self.measures)
                low = self.lowest is None or found >= self.lowest
                high = self.highest is None or found <= self.highest
                holds = holds and low and high
                name = f"{name_of(run)}: " if len(self.runs) > 1 else ""
                parts.append(f"{name}{label(key)} {MEASURES[key].with_unit(found)}")
        verdict = Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED
        return Judgement(verdict, "; ".join(parts))
