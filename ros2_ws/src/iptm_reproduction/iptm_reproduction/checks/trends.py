"""Checks of statements about a figure along a series of runs: it rises, falls, levels off, spreads."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

import numpy as np

from iptm_core.metrics.figures import Figure
from iptm_core.state import FloatArray
from iptm_reproduction.check import Check, Finding, Verdict, graded, worst
from iptm_reproduction.figures import DASH, change_text, label, labels
from iptm_reproduction.runs import Results, name_of, names_of

LEVEL_STEP = 5e-4
"""Relative change from one run to the next that still counts as level."""

Groups = Mapping[str, tuple[str, ...]]
"""Series of runs by name."""


class Direction(Enum):
    """Which way a figure goes along a series; the value is its sign."""

    RISES = 1.0
    FALLS = -1.0

    @property
    def word(self) -> str:
        """The direction inside a sentence."""
        return self.name.lower()

    def overall(self, values: FloatArray) -> bool:
        """Return whether the last value lies in this direction of the first one."""
        return bool(self.value * (values[-1] - values[0]) > 0.0)

    def contradicted(self, values: FloatArray) -> bool:
        """Return whether some step goes the other way by more than a level step."""
        steps = np.diff(values) * self.value
        return bool(np.any(steps < -LEVEL_STEP * np.abs(values[:-1])))


RISES, FALLS = Direction


def trend(
    runs: tuple[str, ...],
    directions: Mapping[Figure, Direction],
    least_change: float = 0.0,
    *,
    every_step: bool = True,
) -> Check:
    """Check that figures rise or fall along a series of runs.

    Args:
        runs: the series.
        directions: which way each figure should go.
        least_change: by which part of the first value it must change in all.
        every_step: whether it must go that way from run to run, too.
    """

    def verdict(direction: Direction, values: FloatArray) -> Verdict:
        total = direction.value * (values[-1] - values[0])
        enough = bool(total >= least_change * abs(values[0]))
        steady = not (every_step and direction.contradicted(values))
        overall = direction.overall(values)
        return graded(overall and enough and steady, overall)

    def judge(results: Results) -> Finding:
        series = {figure: _series(results, runs, figure) for figure in directions}
        return Finding(
            worst(verdict(directions[figure], values) for figure, values in series.items()),
            "; ".join(_steps_text(figure, values) for figure, values in series.items()),
        )

    wanted = ", ".join(f"{label(figure)} {way.word}" for figure, way in directions.items())
    size = f" by at least {100.0 * least_change:g} % in all" if least_change else ""
    rule = (
        f"Along {names_of(runs)}: {wanted}. Reproduced if so from run to run (a step of "
        f"{100.0 * LEVEL_STEP:g} % counts as level){size}; in sign only if so from the first to the last run."
        if every_step
        else f"From {name_of(runs[0])} to {name_of(runs[-1])}: reproduced if {wanted}{size}."
    )
    return Check(rule, runs, judge, tuple(directions))


def not_always(runs: tuple[str, ...], figures: tuple[Figure, ...], direction: Direction) -> Check:
    """Check that figures do not follow a direction along the whole series ("not always decrease")."""

    def judge(results: Results) -> Finding:
        series = {figure: _series(results, runs, figure) for figure in figures}
        return Finding(
            graded(any(map(direction.contradicted, series.values()))),
            "; ".join(_steps_text(figure, values) for figure, values in series.items()),
        )

    return Check(
        f"Along {names_of(runs)}: reproduced if {labels(figures)} not always {direction.word} (at least one "
        f"figure moves the other way by more than {100.0 * LEVEL_STEP:g} % in a step).",
        runs,
        judge,
        figures,
    )


def trend_in_groups(
    groups: Groups, figure: Figure, direction: Direction, needed_share: float = 1.0
) -> Check:
    """Check that a figure rises or falls along a share of several series."""

    def judge(results: Results) -> Finding:
        series = {name: _series(results, runs, figure) for name, runs in groups.items()}
        overall = [values for values in series.values() if direction.overall(values)]
        steady = [values for values in overall if not direction.contradicted(values)]
        needed = needed_share * len(groups)
        totals = "; ".join(
            f"{name}: {change_text(float(values[-1] / values[0] - 1.0))}"
            for name, values in series.items()
        )
        return Finding(
            graded(len(steady) >= needed, len(overall) >= needed),
            f"{label(figure)} {direction.word} from first to last run in {len(overall)} and at every "
            f"step in {len(steady)} of {len(groups)} series ({totals})",
        )

    share = "each" if needed_share >= 1.0 else f"at least {100.0 * needed_share:.0f} %"
    return Check(
        f"{figure.label} {direction.word} along {share} of the series {', '.join(groups)}: reproduced if so "
        f"from run to run (a step of {100.0 * LEVEL_STEP:g} % counts as level), in sign only if so from "
        "first to last run.",
        _all_runs(groups),
        judge,
        (figure,),
    )


def levels_off(groups: Groups, positions: tuple[float, ...], figures: tuple[Figure, ...]) -> Check:
    """Check that what one more step of a series gains becomes less; gains count per unit of the positions."""

    def judge(results: Results) -> Finding:
        verdicts, texts = [], []
        for name, runs in groups.items():
            for figure in figures:
                values = _series(results, runs, figure)
                gains = -np.diff(values) / np.diff(positions) / values[0]
                saves = bool(values[-1] < values[0])
                verdicts.append(graded(saves and bool(gains[-1] < gains[0]), saves))
                texts.append(
                    f"{name}, {label(figure)}: {100.0 * gains[0]:.3f} % per unit at first, "
                    f"{100.0 * gains[-1]:.3f} % at last"
                )
        return Finding(worst(verdicts), "; ".join(texts))

    return Check(
        f"Along {'; '.join(groups)}: reproduced if the last step saves less of each of {labels(figures)} per "
        "unit than the first step, and the whole series saves something; in sign only if the series saves "
        "something.",
        _all_runs(groups),
        judge,
        figures,
    )


def spread(
    groups: Groups,
    figures: tuple[Figure, ...],
    *,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Check:
    """Check how far figures depend on a choice: largest over smallest value of each group, minus one."""

    def judge(results: Results) -> Finding:
        texts, holds = [], True
        for name, runs in groups.items():
            series = {figure: _series(results, runs, figure) for figure in figures}
            spreads = {
                figure: float(np.max(values) / np.min(values) - 1.0)
                for figure, values in series.items()
            }
            widest = max(spreads, key=spreads.__getitem__)
            enough = at_least is None or spreads[widest] >= at_least
            small = at_most is None or spreads[widest] <= at_most
            holds = holds and enough and small
            texts.append(f"{name}: {label(widest)} {100.0 * spreads[widest]:.2f} %")
        return Finding(graded(holds), "; ".join(texts))

    bounds = " and ".join(
        f"{word} {100.0 * bound:g} %"
        for word, bound in (("at least", at_least), ("at most", at_most))
        if bound is not None
    )
    return Check(
        f"Largest over smallest value minus one within {', '.join(groups)}: reproduced if in each group one "
        f"of {labels(figures)} spreads {bounds}.",
        _all_runs(groups),
        judge,
        figures,
    )


def _all_runs(groups: Groups) -> tuple[str, ...]:
    return tuple(run for runs in groups.values() for run in runs)


def _series(results: Results, runs: tuple[str, ...], figure: Figure) -> FloatArray:
    return np.array([results.value(run, figure) for run in runs], dtype=np.float64)


def _steps_text(figure: Figure, values: FloatArray) -> str:
    *first, last = values.tolist()
    steps = " → ".join([*map(figure.text, first), figure.with_unit(last)])
    total = change_text(float(values[-1] / values[0] - 1.0)) if values[0] != 0.0 else DASH
    return f"{label(figure)} {steps} ({total})"
