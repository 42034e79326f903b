"""Checks of statements that order runs: better than, between, second best, best choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from iptm_core.metrics.figures import Figure
from iptm_reproduction.check import Check, Finding, graded
from iptm_reproduction.figures import label, labels
from iptm_reproduction.printed import printed_value
from iptm_reproduction.runs import Results, name_of, names_of

_MOST_FAILURES = 4

Lookup = Callable[[str, Figure], float]
"""Figure of a run: ours or the printed one."""


@dataclass(frozen=True)
class _Count:
    """How many comparisons hold, and which do not."""

    total: int
    failures: tuple[str, ...]

    @property
    def held(self) -> int:
        return self.total - len(self.failures)

    def text(self) -> str:
        """Return the count in words; the failures by name."""
        shown = "; ".join(self.failures[:_MOST_FAILURES])
        more = len(self.failures) - _MOST_FAILURES
        against = f"; not: {shown}" if self.failures else ""
        against += f"; and {more} more" if more > 0 else ""
        return f"{self.held} of {self.total} comparisons hold{against}"


def all_lower(
    lower: tuple[str, ...],
    higher: tuple[str, ...],
    figures: tuple[Figure, ...],
    needed_share: float = 1.0,
) -> Check:
    """Check that each run of one list is below each run of another one in each figure.

    Args:
        lower: runs that should have the lower figures.
        higher: runs that should have the higher ones.
        figures: what is compared.
        needed_share: part of the comparisons that must hold.
    """

    def count(lookup: Lookup) -> _Count:
        triples = [(low, high, figure) for low in lower for high in higher for figure in figures]
        failures = tuple(
            f"{label(figure)} {name_of(low)} {figure.with_unit(lookup(low, figure))} "
            f"against {name_of(high)} {figure.with_unit(lookup(high, figure))}"
            for low, high, figure in triples
            if not lookup(low, figure) < lookup(high, figure)
        )
        return _Count(len(triples), failures)

    share = "all" if needed_share >= 1.0 else f"{100.0 * needed_share:.0f} %"
    rule = (
        f"Reproduced if {share} of the comparisons hold: {labels(figures)} of {names_of(lower)} below that "
        f"of {names_of(higher)}."
    )
    return _counted(rule, (*lower, *higher), figures, count, needed_share)


def between(run: str, ends: tuple[str, str], figures: tuple[Figure, ...]) -> Check:
    """Check that a run lies between two others in each figure."""

    def count(lookup: Lookup) -> _Count:
        failures = []
        for figure in figures:
            value = lookup(run, figure)
            low, high = sorted(lookup(end, figure) for end in ends)
            if not low <= value <= high:
                failures.append(
                    f"{label(figure)} {figure.with_unit(value)}, ends {figure.with_unit(low)} and "
                    f"{figure.with_unit(high)}"
                )
        return _Count(len(figures), tuple(failures))

    rule = (
        f"Reproduced if each of {labels(figures)} of {name_of(run)} lies between those of "
        f"{names_of(ends)}."
    )
    return _counted(rule, (run, *ends), figures, count, 1.0)


def _counted(
    rule: str,
    runs: tuple[str, ...],
    figures: tuple[Figure, ...],
    count: Callable[[Lookup], _Count],
    needed_share: float,
) -> Check:
    """Return a check that counts comparisons, here and, where they are printed, in print."""
    printed = _printed(runs, figures)

    def judge(results: Results) -> Finding:
        ours = count(results.value)
        return Finding(
            graded(ours.held >= needed_share * ours.total),
            ours.text(),
            count(printed).text() if printed else "",
        )

    return Check(rule, runs, judge, figures)


def _printed(runs: tuple[str, ...], figures: tuple[Figure, ...]) -> Lookup | None:
    """Return the lookup of printed figures, None unless all of them are printed."""
    table = {
        (run, figure): value
        for run in runs
        for figure in figures
        if (value := printed_value(run, figure)) is not None
    }
    complete = all((run, figure) in table for run in runs for figure in figures)
    return (lambda run, figure: table[run, figure]) if complete else None


def rank(run: str, among: tuple[str, ...], figures: tuple[Figure, ...], place: int) -> Check:
    """Check that a run takes a place among others in each figure, 1 being the lowest value."""

    def places(lookup: Lookup) -> dict[str, int]:
        return {
            label(figure): 1 + sum(lookup(other, figure) < lookup(run, figure) for other in among)
            for figure in figures
        }

    printed = _printed(among, figures)

    def judge(results: Results) -> Finding:
        ours = places(results.value)
        return Finding(
            graded(set(ours.values()) == {place}),
            _places_text(ours),
            _places_text(places(printed)) if printed else "",
        )

    return Check(
        f"Reproduced if {name_of(run)} takes rank {place} (1 = lowest) among {len(among)} runs in "
        f"{labels(figures)}.",
        among,
        judge,
        figures,
    )


def _places_text(places: Mapping[str, int]) -> str:
    return ", ".join(f"{name}: rank {place}" for name, place in places.items())


def best_choice(
    candidates: Mapping[str, tuple[str, ...]], expected: tuple[str, ...], figure: Figure
) -> Check:
    """Check a ranking of candidates by the mean of a figure over the groups.

    Args:
        candidates: by name, one run per group.
        expected: names with which the ranking should start, lowest first.
        figure: what is ranked.
    """
    groups = len(next(iter(candidates.values())))

    def judge(results: Results) -> Finding:
        table = {
            name: np.array([results.value(run, figure) for run in runs])
            for name, runs in candidates.items()
        }
        means = {name: float(np.mean(values)) for name, values in table.items()}
        ranking = sorted(means, key=means.__getitem__)
        found = "ranking " + ", ".join(f"{name} ({figure.text(means[name])})" for name in ranking)
        if groups > 1:
            best = np.array(list(table))[np.argmin(list(table.values()), axis=0)]
            wins = int(np.sum(best == expected[0]))
            found += f"; {expected[0]} is best in {wins} of {groups} groups"
        return Finding(graded(tuple(ranking[: len(expected)]) == expected), found)

    over = f", mean over {groups} groups" if groups > 1 else ""
    return Check(
        f"Candidates ranked by {label(figure)}{over}: reproduced if the ranking starts with "
        f"{', then '.join(expected)}.",
        tuple(run for runs in candidates.values() for run in runs),
        judge,
        (figure,),
    )
