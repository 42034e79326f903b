"""Ageing of a run by several judges: the paper's law, laws of measured cells, and laws of extras."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from iptm.call_cache import cached_calls
from iptm_core.aging_laws.judging import CELL_JUDGES, Exposure, Judge, loss_by_paper
from iptm_core.errors import ScenarioError
from iptm_core.extras import offered
from iptm_core.metrics.figures import PPM
from iptm_core.metrics.saved_share import saved_percent
from iptm_core.user_input import check_known, shown

if TYPE_CHECKING:
    from iptm.run import Run

PAPER, CELLS = BY = ("paper", "cells")
"""Groups that need no extra."""
PAPER_LAW = "paper's law"
LOST, OTHER, SAVED = "lost [ppm]", "lost by other [ppm]", "saved [%]"
CURRENT, TEMPERATURE = "by current alone [%]", "by temperature alone [%]"
EITHER_WAY_PERCENT = 0.1
"""Savings below are taken as neither saved nor lost."""


@dataclass(frozen=True, eq=False)
class Verdicts:
    """What judges make of a run, and of another one of the same trip.

    Attributes:
        table: a row per judge, by group and name: the capacity lost, and against another run what it lost,
            what is saved, and what is saved by the current and by the temperature alone.
        failures: why a judge has no figure, by its name.
    """

    table: pd.DataFrame
    failures: dict[str, str]

    @property
    def summary(self) -> pd.DataFrame:
        """Median, lowest and highest saving of each group, its judges, and how many of them see a loss."""
        if SAVED not in self.table:
            return pd.DataFrame()
        saved = self.table[SAVED].dropna().groupby(level=0, sort=False)
        return pd.DataFrame(
            {
                "median [%]": saved.median(),
                "lowest [%]": saved.min(),
                "highest [%]": saved.max(),
                "judges": saved.size(),
                "see a loss": saved.apply(lambda each: int((each < -EITHER_WAY_PERCENT).sum())),
            }
        )

    @property
    def text(self) -> str:
        """The savings of each group in a line, and whether the judges agree on the sign."""
        lines = []
        for group, row in self.summary.iterrows():
            median, lowest, highest = row.iloc[:3]
            count, against = int(row["judges"]), int(row["see a loss"])
            spread = f" ({lowest:.1f} to {highest:.1f})" if count > 1 else ""
            losses = f", {against} of {count} see a loss" if count > 1 and against else ""
            lines.append(f"{group}: {median:.1f} %{spread}{losses}")
        if lines:
            lines.append(self._agreement)
        return "\n".join(lines)

    @property
    def _agreement(self) -> str:
        saved = self.table[SAVED].dropna()
        gains, losses = (int((sign * saved > EITHER_WAY_PERCENT).sum()) for sign in (1, -1))
        if gains and losses:
            return f"the judges disagree on the sign: {gains} see a saving, {losses} a loss"
        return f"no judge sees a {'loss' if gains else 'saving'}"


def judge(
    run: Run,
    other: Run | None = None,
    by: Sequence[str] = BY,
    *,
    crossed: bool = False,
    workers: int | None = 1,
    cache: str | Path | None = None,
) -> Verdicts:
    """Judge a run by the current and the temperature of its cells; see `iptm_core.aging_laws.judging`.

    Args:
        other: of the same trip; None for the run alone.
        by: groups such as ``cells``, or judges such as ``cells/NCA``; extras add groups.
        crossed: whether each run's current at the temperatures of the other one is judged, too.
        workers: processes, see `iptm.cached_calls`; so is ``cache``, a folder of what has been judged before.

    Raises:
        ScenarioError: a group or judge is unknown, or what it needs is not installed.
        StateError: current or temperature of a run is not known throughout.
    """
    judges = selected(by, run)
    own = Exposure.of(run.trajectory)
    uses = {LOST: own}
    if other is not None:
        uses[OTHER] = Exposure.of(other.trajectory)
        if crossed:
            uses |= {CURRENT: own.at(uses[OTHER]), TEMPERATURE: uses[OTHER].at(own)}
    lost, failures = _judged(judges, uses, workers, cache)
    ran = {LOST: run} if other is None else {LOST: run, OTHER: other}
    for row in (row for row, each in enumerate(judges) if each.group == PAPER_LAW):
        for column, each in ran.items():  # by the plant, which knows the current inside an interval
            lost[column][row] = 0.5 * each.metrics.degradation
    rows = pd.MultiIndex.from_tuples(
        [(each.group, each.name) for each in judges], names=["", "judge"]
    )
    table = PPM * pd.DataFrame(lost, rows)
    if other is not None:
        saved = {column: _saved(table[column], table[OTHER]) for column in table if column != OTHER}
        table.insert(2, SAVED, saved.pop(LOST))
        table = table.assign(**saved)
    return Verdicts(table, failures)


def _saved(own: pd.Series, other: pd.Series) -> list[float]:
    return [saved_percent(*pair) for pair in zip(own, other, strict=True)]


def _judged(
    judges: Sequence[Judge],
    uses: Mapping[str, Exposure],
    workers: int | None,
    cache: str | Path | None,
) -> tuple[dict[str, list[float]], dict[str, str]]:
    """Return what each judge gives for each use, NaN where it has no figure, and why it has none."""
    lost: dict[str, list[float]] = {column: [math.nan] * len(judges) for column in uses}
    failures: dict[str, str] = {}
    for function in dict.fromkeys(each.function for each in judges):
        asked = [
            (row, column)
            for row, each in enumerate(judges)
            if each.function is function
            for column in uses
        ]
        calls = [{**judges[row].arguments, "exposure": uses[column]} for row, column in asked]
        for outcome in cached_calls(function, calls, workers=workers, cache=cache):
            row, column = asked[outcome.index]
            if outcome.failure:
                failures[judges[row].name] = outcome.failure
            else:
                lost[column][row] = outcome.value
    return lost, failures


def selected(by: Sequence[str], run: Run) -> list[Judge]:
    """Return the judges of some groups, or single ones as ``group/name``.

    Raises:
        ScenarioError: unknown, or not installed.
    """
    groups = judge_groups(run)
    found = []
    for wanted in by:
        if not isinstance(wanted, str):
            raise ScenarioError(f"by: {shown(wanted)}; allowed: {', '.join(groups)}")
        group, _, name = wanted.partition("/")
        check_known(group, groups, "by", "group of judges", ScenarioError)
        judges = {each.name: each for each in groups[group]()}
        if name:
            check_known(name, judges, group, "judge", ScenarioError)
            found.append(judges[name])
        else:
            found += judges.values()
    return found


def judge_groups(run: Run | None) -> dict[str, Callable[[], Sequence[Judge]]]:
    """Return the groups of judges by name, extras last; without a run none of its parameters.

    The module ``extra_judges`` of an extra has a mapping ``JUDGES`` of groups to paths ``module:name`` of
    functions that return them.
    """
    groups: dict[str, Callable[[], Sequence[Judge]]] = {
        PAPER: lambda: () if run is None else tuple(_paper_judges(run)),
        CELLS: lambda: CELL_JUDGES,
    }
    for extra in offered("judges"):
        groups |= {
            name: partial(_judges_of_extra, name, path) for name, path in extra.JUDGES.items()
        }
    return groups


def _judges_of_extra(group: str, path: str) -> Sequence[Judge]:
    module, _, function = path.partition(":")
    try:
        judges: Sequence[Judge] = getattr(import_module(module), function)()
    except ModuleNotFoundError as error:
        raise ScenarioError(
            f"by: {group} needs {error.name}, which is not installed; allowed: with the libraries of "
            "requirements/judges.txt"
        ) from None
    return judges


def _paper_judges(run: Run) -> Iterator[Judge]:
    parameters = run.parameters
    yield Judge(PAPER_LAW, PAPER_LAW, loss_by_paper, {"parameters": parameters})
    even = replace(parameters.aging, compensation_factor_j_mol=0.0)
    name = f"{PAPER_LAW} without C-rate term"
    yield Judge(name, name, loss_by_paper, {"parameters": replace(parameters, aging=even)})
