"""Rules for statements that order runs: better than, between, second best, best choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from iptm_studies.report.measures import MEASURES
from iptm_studies.report.naming import name_of, names_of
from iptm_studies.report.rules.base import Printed, Rule, label, labels, with_unit
from iptm_studies.report.runs import Results
from iptm_studies.report.verdict import Judgement, Verdict

Lookup = Callable[[str, str], float | None]
"""Figure of a run by address and key: ours or the printed one."""


_MOST_FAILURES = 4


@dataclass(frozen=True)
class _Count:
    """How many comparisons hold, and which do not."""

    held: int
    total: int
    failures: tuple[str, ...]

    def text(self) -> str:
        """The count in words; the failures by name."""
        shown = "; ".join(self.failures[:_MOST_FAILURES])
        more = len(self.failures) - _MOST_FAILURES
        against = f"; not: {shown}" if self.failures else ""
        if more > 0:
            against += f"; and {more} more"
        return f"{self.held} of {self.total} comparisons hold{against}"


def _verdict(count: _Count, needed_share: float) -> Verdict:
    if count.held >= needed_share * count.total:
        return Verdict.REPRODUCED
    return Verdict.NOT_REPRODUCED


@dataclass(frozen=True)
class AllLower(Rule):
    """Each run of one list is below each run of another list in each figure."""

    lower: tuple[str, ...]
    higher: tuple[str, ...]
    measures: tuple[str, ...]
    needed_share: float = 1.0

    def needs(self) -> tuple[str, ...]:
        """Both lists."""
        return (*self.lower, *self.higher)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        share = "all" if self.needed_share >= 1.0 else f"{100.0 * self.needed_share:.0f} %"
        return (
            f"Reproduced if {share} of the comparisons hold: {labels(self.measures)} of "
            f"{names_of(self.lower)} below that of {names_of(self.higher)}."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Count the comparisons."""
        ours = self._count(results.measure)
        if ours is None:
            return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.measures)}")
        theirs = self._count(printed.value)
        return Judgement(
            _verdict(ours, self.needed_share),
            ours.text(),
            "" if theirs is None else theirs.text(),
        )

    def _count(self, lookup: Lookup) -> _Count | None:
        failures, held = [], 0
        for low in self.lower:
            for high in self.higher:
                for key in self.measures:
                    small, large = lookup(low, key), lookup(high, key)
                    if small is None or large is None:
                        return None
                    if small < large:
                        held += 1
                    else:
                        failures.append(
                            f"{label(key)} {name_of(low)} {with_unit(key, small)} "
                            f"against {name_of(high)} {with_unit(key, large)}"
                        )
        return _Count(held, held + len(failures), tuple(failures))


@dataclass(frozen=True)
class Between(Rule):
    """A run lies between two others in each figure."""

    run: str
    ends: tuple[str, ...]
    measures: tuple[str, ...]

    def needs(self) -> tuple[str, ...]:
        """The run and both ends."""
        return (self.run, *self.ends)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Reproduced if each of {labels(self.measures)} of {name_of(self.run)} lies between those of "
            f"{names_of(self.ends)}."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Count the figures that lie between."""
        ours = self._count(results.measure)
        if ours is None:
            return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.measures)}")
        theirs = self._count(printed.value)
        return Judgement(_verdict(ours, 1.0), ours.text(), "" if theirs is None else theirs.text())

    def _count(self, lookup: Lookup) -> _Count | None:
        failures, held = [], 0
        for key in self.measures:
            value = lookup(self.run, key)
            ends = [lookup(end, key) for end in self.ends]
            known = [end for end in ends if end is not None]
            if value is None or len(known) < len(ends):
                return None
            if min(known) <= value <= max(known):
                held += 1
            else:
                failures.append(
                    f"{label(key)} {with_unit(key, value)}, ends {with_unit(key, min(known))} and "
                    f"{with_unit(key, max(known))}"
                )
        return _Count(held, held + len(failures), tuple(failures))


@dataclass(frozen=True)
class Rank(Rule):
    """A run takes a rank among others in each figure, 1 being the lowest value."""

    run: str
    among: tuple[str, ...]
    measures: tuple[str, ...]
    rank: int

    def needs(self) -> tuple[str, ...]:
        """All runs."""
        return self.among

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Reproduced if {name_of(self.run)} takes rank {self.rank} (1 = lowest) among "
            f"{len(self.among)} runs in {labels(self.measures)}."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Find the ranks."""
        ours = self._ranks(results.measure)
        if ours is None:
            return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.measures)}")
        theirs = self._ranks(printed.value)
        holds = all(rank == self.rank for rank in ours.values())
        return Judgement(
            Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED,
            _ranks_text(ours),
            "" if theirs is None else _ranks_text(theirs),
        )

    def _ranks(self, lookup: Lookup) -> dict[str, int] | None:
        ranks = {}
        for key in self.measures:
            values = [lookup(run, key) for run in self.among]
            own = lookup(self.run, key)
            known = [value for value in values if value is not None]
            if own is None or len(known) < len(values):
                return None
            ranks[label(key)] = 1 + sum(value < own for value in known)
        return ranks


def _ranks_text(ranks: Mapping[str, int]) -> str:
    return ", ".join(f"{name}: rank {rank}" for name, rank in ranks.items())


@dataclass(frozen=True)
class BestChoice(Rule):
    """Candidates, each with one run per group, ranked by the mean of a figure over the groups."""

    candidates: Mapping[str, tuple[str, ...]]
    expected: tuple[str, ...]
    measure: str

    def needs(self) -> tuple[str, ...]:
        """All runs of all candidates."""
        return tuple(run for runs in self.candidates.values() for run in runs)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        groups = len(next(iter(self.candidates.values())))
        over = f", mean over {groups} groups" if groups > 1 else ""
        return (
            f"Candidates ranked by {label(self.measure)}{over}: reproduced if the ranking starts with "
            f"{', then '.join(self.expected)}."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Rank the candidates."""
        table = {
            name: [results.measure(run, self.measure) for run in runs]
            for name, runs in self.candidates.items()
        }
        known = {
            name: [value for value in values if value is not None] for name, values in table.items()
        }
        if any(len(known[name]) < len(table[name]) for name in table):
            return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {label(self.measure)}")
        means = {name: float(np.mean(values)) for name, values in known.items()}
        ranking = sorted(means, key=means.__getitem__)
        holds = tuple(ranking[: len(self.expected)]) == self.expected
        columns = np.array(list(known.values()))
        wins = int(np.sum(np.array(list(known))[np.argmin(columns, axis=0)] == self.expected[0]))
        found = "ranking " + ", ".join(
            f"{name} ({MEASURES[self.measure].text(means[name])})" for name in ranking
        )
        if columns.shape[1] > 1:
            found += f"; {self.expected[0]} is best in {wins} of {columns.shape[1]} groups"
        return Judgement(Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED, found)
