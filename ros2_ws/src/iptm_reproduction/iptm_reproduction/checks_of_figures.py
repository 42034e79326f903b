"""Checks of statements about figures of runs: printed numbers, orders, and trends along series.

A check is a function from the results, and the arguments that ``claims.yaml`` gives, to a finding; the rule
that it applies is written there. Every run has each of the figures when it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from iptm_core.metrics.figures import FIGURES
from iptm_core.state import FloatArray
from iptm_reproduction.names import DASH, change_text, label, name_of, relative_change
from iptm_reproduction.printed import Finding, Verdict, compared, graded, printed_value, worst
from iptm_reproduction.results import Results

LEVEL_STEP = 5e-4
"""Relative change from one run to the next that still counts as level."""
DIRECTIONS = {"rises": 1.0, "falls": -1.0}
"""Which way a figure goes along a series, and its sign."""
_MOST_FAILURES = 4

Runs = Sequence[str]
Groups = Mapping[str, Runs]
"""Series of runs by name."""
Lookup = Callable[[str, str], float]
"""Figure of a run: ours or the printed one."""


def change(results: Results, run: str, base: str, figure: str, printed: float) -> Finding:
    """Check a printed relative change of a figure from a base run to a run."""
    found = results.change(run, base, figure)
    if found is None:
        return _from_nothing(figure, base)
    return Finding(compared(found, printed), change_text(found), change_text(printed))


def changes_in_range(
    results: Results, runs: Runs, base: str, figure: str, printed: tuple[float, float]
) -> Finding:
    """Check a printed range of relative changes over several runs, at both of its ends."""
    found = [value for run in runs if (value := results.change(run, base, figure)) is not None]
    if len(found) < len(runs):
        return _from_nothing(figure, base)
    ends = (min(found), max(found))
    return Finding(
        worst(map(compared, ends, printed)),
        *(" to ".join(map(change_text, x)) for x in (ends, printed)),
    )


def reduction_at_least(
    results: Results, run: str, base: str, figures: Sequence[str], reduction: float
) -> Finding:
    """Check a printed bound on the reduction of several figures ("more than 12 %")."""
    found = {figure: results.change(run, base, figure) for figure in figures}
    known = [value for value in found.values() if value is not None]
    if len(known) < len(found):
        return _from_nothing(figures[0], base)
    printed = {
        figure: relative_change(printed_value(run, figure), printed_value(base, figure))
        for figure in figures
    }
    bound = f"at least {100.0 * reduction:g} %"
    return Finding(
        graded(max(known) <= -reduction, max(known) < 0.0),
        _changes_text(found),
        bound if None in printed.values() else _changes_text(printed),
    )


def value(
    results: Results, run: str, figure: str, printed: float, share: float, floor: float
) -> Finding:
    """Check a printed value of a figure; it may deviate by a share of it, at least by the floor."""
    found = results.value(run, figure)
    texts = map(FIGURES[figure].with_unit, (found, printed))
    return Finding(compared(found, printed, share, floor), *texts)


def value_between(
    results: Results,
    run: str,
    figure: str,
    lowest: float | None = None,
    highest: float | None = None,
) -> Finding:
    """Check that a figure lies inside bounds, in the unit of the figure; None means unbounded."""
    found = results.value(run, figure)
    holds = (lowest is None or found >= lowest) and (highest is None or found <= highest)
    return Finding(graded(holds), f"{label(figure)} {FIGURES[figure].with_unit(found)}")


def _from_nothing(figure: str, base: str) -> Finding:
    return Finding(
        Verdict.NOT_TESTED, f"{label(figure)} of {name_of(base)} is 0: no change is defined"
    )


def _changes_text(changes: Mapping[str, float | None]) -> str:
    return ", ".join(f"{label(figure)} {change_text(value)}" for figure, value in changes.items())


def all_lower(
    results: Results,
    lower: Runs,
    higher: Runs,
    figures: Sequence[str],
    needed_share: float = 1.0,
) -> Finding:
    """Check that each run of one list is below each run of another one in each figure.

    ``needed_share`` is the part of the comparisons that must hold.
    """

    def failures(lookup: Lookup) -> list[str]:
        def text(run: str, figure: str) -> str:
            return f"{name_of(run)} {FIGURES[figure].with_unit(lookup(run, figure))}"

        return [
            f"{label(figure)} {text(low, figure)} against {text(high, figure)}"
            for low in lower
            for high in higher
            for figure in figures
            if not lookup(low, figure) < lookup(high, figure)
        ]

    total = len(lower) * len(higher) * len(figures)
    return _counted(results, (*lower, *higher), figures, failures, total, needed_share)


def between(results: Results, run: str, ends: Runs, figures: Sequence[str]) -> Finding:
    """Check that a run lies between two others in each figure."""

    def failures(lookup: Lookup) -> list[str]:
        failing = []
        for figure in figures:
            found = lookup(run, figure)
            low, high = sorted(lookup(end, figure) for end in ends)
            if not low <= found <= high:
                text, *texts = map(FIGURES[figure].with_unit, (found, low, high))
                failing.append(f"{label(figure)} {text}, ends {' and '.join(texts)}")
        return failing

    return _counted(results, (run, *ends), figures, failures, len(figures), 1.0)


def _counted(
    results: Results,
    runs: Runs,
    figures: Sequence[str],
    failures: Callable[[Lookup], list[str]],
    total: int,
    needed_share: float,
) -> Finding:
    """Count the comparisons that hold, here and, where all of the figures are printed, in print."""

    def text(failing: list[str]) -> str:
        shown = "; ".join(failing[:_MOST_FAILURES])
        more = len(failing) - _MOST_FAILURES
        against = f"; not: {shown}" if failing else ""
        against += f"; and {more} more" if more > 0 else ""
        return f"{total - len(failing)} of {total} comparisons hold{against}"

    ours, printed = failures(results.value), _printed(runs, figures)
    return Finding(
        graded(total - len(ours) >= needed_share * total),
        text(ours),
        text(failures(printed)) if printed else "",
    )


def _printed(runs: Runs, figures: Sequence[str]) -> Lookup | None:
    """Return the lookup of printed figures, None unless all of them are printed."""
    table = {(run, figure): printed_value(run, figure) for run in runs for figure in figures}
    known = {key: value for key, value in table.items() if value is not None}
    return (lambda run, figure: known[run, figure]) if len(known) == len(table) else None


def rank(results: Results, among: Runs, run: str, figures: Sequence[str], place: int) -> Finding:
    """Check that a run takes a place among others in each figure, 1 being the lowest value."""

    def places(lookup: Lookup) -> list[int]:
        return [
            1 + sum(lookup(other, figure) < lookup(run, figure) for other in among)
            for figure in figures
        ]

    def text(found: list[int]) -> str:
        pairs = zip(figures, found, strict=True)
        return ", ".join(f"{label(figure)}: rank {place}" for figure, place in pairs)

    ours, printed = places(results.value), _printed(among, figures)
    return Finding(
        graded(set(ours) == {place}), text(ours), text(places(printed)) if printed else ""
    )


def best_choice(
    results: Results, candidates: Groups, expected: Sequence[str], figure: str
) -> Finding:
    """Check a ranking of candidates by the mean of a figure over the groups.

    ``candidates`` are by name, one run per group; the ranking should start with ``expected``, lowest first.
    """
    table = {name: results.series(runs, figure) for name, runs in candidates.items()}
    means = {name: float(np.mean(values)) for name, values in table.items()}
    ranking = sorted(means, key=means.__getitem__)
    text = FIGURES[figure].text
    found = "ranking " + ", ".join(f"{name} ({text(means[name])})" for name in ranking)
    groups = len(next(iter(table.values())))
    if groups > 1:
        best = np.array(list(table))[np.argmin(list(table.values()), axis=0)]
        wins = int(np.sum(best == expected[0]))
        found += f"; {expected[0]} is best in {wins} of {groups} groups"
    return Finding(graded(ranking[: len(expected)] == list(expected)), found)


def _overall(direction: str, values: FloatArray) -> bool:
    """Return whether the last value lies in a direction of the first one."""
    return bool(DIRECTIONS[direction] * (values[-1] - values[0]) > 0.0)


def _contradicted(direction: str, values: FloatArray) -> bool:
    """Return whether some step goes the other way by more than a level step."""
    steps = np.diff(values) * DIRECTIONS[direction]
    return bool(np.any(steps < -LEVEL_STEP * np.abs(values[:-1])))


def trend(
    results: Results,
    runs: Runs,
    directions: Mapping[str, str],
    least_change: float = 0.0,
    *,
    every_step: bool = True,
) -> Finding:
    """Check that figures rise or fall along a series of runs.

    ``least_change`` is the part of the first value by which it must change in all; with ``every_step``
    it must go that way from run to run as well.
    """

    def verdict(direction: str, values: FloatArray) -> Verdict:
        total = DIRECTIONS[direction] * (values[-1] - values[0])
        enough = bool(total >= least_change * abs(values[0]))
        steady = not (every_step and _contradicted(direction, values))
        overall = _overall(direction, values)
        return graded(overall and enough and steady, overall)

    series = {figure: results.series(runs, figure) for figure in directions}
    return Finding(
        worst(verdict(directions[figure], values) for figure, values in series.items()),
        _steps_text(series),
    )


def not_always(results: Results, runs: Runs, figures: Sequence[str], direction: str) -> Finding:
    """Check that figures do not follow a direction along the whole series ("not always decrease")."""
    series = {figure: results.series(runs, figure) for figure in figures}
    moved = any(_contradicted(direction, values) for values in series.values())
    return Finding(graded(moved), _steps_text(series))


def _steps_text(series: Mapping[str, FloatArray]) -> str:
    texts = []
    for figure, values in series.items():
        *first, last = values.tolist()
        steps = " → ".join([*map(FIGURES[figure].text, first), FIGURES[figure].with_unit(last)])
        total = change_text(float(values[-1] / values[0] - 1.0)) if values[0] != 0.0 else DASH
        texts.append(f"{label(figure)} {steps} ({total})")
    return "; ".join(texts)


def trend_in_groups(
    results: Results, groups: Groups, figure: str, direction: str, needed_share: float = 1.0
) -> Finding:
    """Check that a figure rises or falls along a share of several series."""
    series = {name: results.series(runs, figure) for name, runs in groups.items()}
    overall = [values for values in series.values() if _overall(direction, values)]
    steady = [values for values in overall if not _contradicted(direction, values)]
    needed = needed_share * len(groups)
    totals = "; ".join(
        f"{name}: {change_text(float(values[-1] / values[0] - 1.0))}"
        for name, values in series.items()
    )
    return Finding(
        graded(len(steady) >= needed, len(overall) >= needed),
        f"{label(figure)} {direction} from first to last run in {len(overall)} and at every "
        f"step in {len(steady)} of {len(groups)} series ({totals})",
    )


def levels_off(
    results: Results, groups: Groups, positions: Sequence[float], figures: Sequence[str]
) -> Finding:
    """Check that what one more step of a series gains becomes less; gains count per unit of the positions."""
    verdicts, texts = [], []
    for name, runs in groups.items():
        for figure in figures:
            values = results.series(runs, figure)
            gains = -np.diff(values) / np.diff(positions) / values[0]
            saves = bool(values[-1] < values[0])
            verdicts.append(graded(saves and bool(gains[-1] < gains[0]), saves))
            texts.append(
                f"{name}, {label(figure)}: {100.0 * gains[0]:.3f} % per unit at first, "
                f"{100.0 * gains[-1]:.3f} % at last"
            )
    return Finding(worst(verdicts), "; ".join(texts))


def spread(
    results: Results,
    groups: Groups,
    figures: Sequence[str],
    at_least: float | None = None,
    at_most: float | None = None,
) -> Finding:
    """Check how far figures depend on a choice: largest over smallest value of each group, minus one."""
    texts, holds = [], True
    for name, runs in groups.items():
        series = {figure: results.series(runs, figure) for figure in figures}
        spreads = {figure: float(np.max(x) / np.min(x) - 1.0) for figure, x in series.items()}
        widest = max(spreads, key=spreads.__getitem__)
        holds = holds and (at_least or 0.0) <= spreads[widest] <= (at_most or np.inf)
        texts.append(f"{name}: {label(widest)} {100.0 * spreads[widest]:.2f} %")
    return Finding(graded(holds), "; ".join(texts))
