"""Checks of printed numbers: a change, a range of changes, a bound, a value."""

from __future__ import annotations

from collections.abc import Mapping

from iptm_core.metrics.figures import Figure
from iptm_reproduction.check import (
    CHANGE_FLOOR,
    CHANGE_SHARE,
    Check,
    Finding,
    Verdict,
    accepted_deviation,
    compared,
    graded,
    worst,
)
from iptm_reproduction.figures import change_text, label, labels, relative_change
from iptm_reproduction.printed import printed_value
from iptm_reproduction.runs import Results, name_of

_WITHIN = (
    f"the larger of {100.0 * CHANGE_FLOOR:g} percentage point(s) and "
    f"{100.0 * CHANGE_SHARE:g} % of the printed change"
)


def change(run: str, base: str, figure: Figure, printed: float) -> Check:
    """Check a printed relative change of a figure from a base run to a run."""

    def judge(results: Results) -> Finding:
        found = results.change(run, base, figure)
        if found is None:
            return _from_nothing(figure, base)
        return Finding(compared(found, printed), change_text(found), change_text(printed))

    return Check(
        f"Change of {label(figure)} from {name_of(base)} to {name_of(run)}: reproduced within {_WITHIN} "
        f"(here {100.0 * accepted_deviation(printed):.2f} points); in sign only with the same sign.",
        (run, base),
        judge,
        (figure,),
    )


def changes_in_range(
    runs: tuple[str, ...], base: str, figure: Figure, lowest: float, highest: float
) -> Check:
    """Check a printed range of relative changes over several runs, at both of its ends."""

    def judge(results: Results) -> Finding:
        found = [value for run in runs if (value := results.change(run, base, figure)) is not None]
        if len(found) < len(runs):
            return _from_nothing(figure, base)
        ends = (min(found), max(found))
        return Finding(
            worst(map(compared, ends, (lowest, highest))),
            f"{change_text(ends[0])} to {change_text(ends[1])}",
            f"{change_text(lowest)} to {change_text(highest)}",
        )

    return Check(
        f"Smallest and largest change of {label(figure)} against {name_of(base)} over {len(runs)} runs: "
        f"reproduced if both lie within {_WITHIN}; in sign only if all runs have the sign of the printed "
        "range.",
        (*runs, base),
        judge,
        (figure,),
    )


def reduction_at_least(run: str, base: str, figures: tuple[Figure, ...], reduction: float) -> Check:
    """Check a printed bound on the reduction of several figures ("more than 12 %")."""

    def judge(results: Results) -> Finding:
        found = {label(figure): results.change(run, base, figure) for figure in figures}
        known = [value for value in found.values() if value is not None]
        if len(known) < len(found):
            return _from_nothing(figures[0], base)
        printed = {
            label(figure): relative_change(printed_value(run, figure), printed_value(base, figure))
            for figure in figures
        }
        return Finding(
            graded(max(known) <= -reduction, max(known) < 0.0),
            _changes_text(found),
            f"at least {100.0 * reduction:g} %"
            if None in printed.values()
            else _changes_text(printed),
        )

    return Check(
        f"Reduction of {labels(figures)} from {name_of(base)} to {name_of(run)}: reproduced if each is at "
        f"least {100.0 * reduction:g} %; in sign only if each is a reduction.",
        (run, base),
        judge,
        figures,
    )


def value(run: str, figure: Figure, printed: float, share: float, floor: float) -> Check:
    """Check a printed value of a figure; it may deviate by a share of it, at least by the floor."""

    def judge(results: Results) -> Finding:
        found = results.value(run, figure)
        return Finding(
            compared(found, printed, share, floor),
            figure.with_unit(found),
            figure.with_unit(printed),
        )

    accepted = accepted_deviation(printed, share, floor)
    return Check(
        f"{figure.label} of {name_of(run)}: reproduced within {accepted:g} {figure.unit} of the printed "
        "value; in sign only with the same sign.",
        (run,),
        judge,
        (figure,),
    )


def value_between(
    run: str, figure: Figure, lowest: float | None = None, highest: float | None = None
) -> Check:
    """Check that a figure lies inside bounds, in the unit of the figure; None means unbounded."""

    def judge(results: Results) -> Finding:
        found = results.value(run, figure)
        holds = (lowest is None or found >= lowest) and (highest is None or found <= highest)
        return Finding(graded(holds), f"{label(figure)} {figure.with_unit(found)}")

    bounds = " and ".join(
        f"{word} {bound:g} {figure.unit}".strip()
        for word, bound in (("at least", lowest), ("at most", highest))
        if bound is not None
    )
    return Check(
        f"Reproduced if {label(figure)} of {name_of(run)}: {bounds}.", (run,), judge, (figure,)
    )


def _from_nothing(figure: Figure, base: str) -> Finding:
    return Finding(
        Verdict.NOT_TESTED, f"{label(figure)} of {name_of(base)} is 0: no change is defined"
    )


def _changes_text(changes: Mapping[str, float | None]) -> str:
    return ", ".join(f"{name} {change_text(value)}" for name, value in changes.items())
