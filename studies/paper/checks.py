"""Statements of the paper checked on figures of runs: a verdict, and the finding.

Figures are a table with a row per address and a column per figure.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from studies.paper import series_rules
from studies.paper.statements import (
    AT_BATTERY,
    Finding,
    changes,
    claims,
    compared,
    expanded,
    flat,
    graded,
    number,
    numbers,
    percent,
    printed_table,
    series,
    worst,
)


def check(row: pd.Series, figures: pd.DataFrame, reading: dict[str, str] | None = None) -> Finding:
    """Check a statement.

    Args:
        row: of `claims`.
        figures: by address and key.
        reading: figures that stand for others.
    """
    needed = [address for cell in (row.run, row.base) for address in flat(series(cell))]
    lacking = [address for address in needed if address not in figures.index]
    if lacking:
        return Finding("–", f"missing: {', '.join(lacking[:3])}")
    read = row.copy()
    for name, other in (reading or {}).items():
        read["figure"] = re.sub(rf"\b{name}\b", other, read.figure)
    return CHECKS[row.check](read, figures)


def all_checks(figures: pd.DataFrame) -> pd.DataFrame:
    """Every statement checked.

    Returns:
        ``verdict``; what was ``found``; the verdict ``at_battery`` where that can differ, or an empty text.
    """
    rows = {}
    for key, row in claims().iterrows():
        found = check(row, figures)
        other = any(name in row.figure for name in AT_BATTERY)
        at_battery = check(row, figures, AT_BATTERY).verdict if other else ""
        rows[key] = {"verdict": found.verdict, "found": found.found, "at_battery": at_battery}
    return pd.DataFrame.from_dict(rows, orient="index")


def in_print(row: pd.Series) -> str:
    """What the paper prints: its number, or the check on its Table IV where that suffices."""
    if row.check in {"change", "change_within"} and row.printed:
        return " to ".join(percent(value) for value in numbers(row.printed))
    printed = printed_table()
    keys = {name.lstrip("+-") for name in row.figure.split()}
    if row.printed and row.check not in {"rank", "best"}:
        return str(row.printed)
    if not row.figure or not keys <= set(printed.columns):
        return "–"
    needed = [address for cell in (row.run, row.base) for address in flat(series(cell))]
    if not set(needed) <= set(printed.index):
        return "–"
    return check(row, printed).found


def change_ends(row: pd.Series, figures: pd.DataFrame) -> list[tuple[float, float]]:
    """A found and the printed change in percent, or the smallest and largest one of several runs."""
    wanted = numbers(row.printed)
    found = changes(figures, flat(series(row.run)), row.base, row.figure)
    ends = [float(found[0])] if len(wanted) == 1 else [float(found.min()), float(found.max())]
    return list(zip(ends, wanted, strict=True))


def _change(row: pd.Series, figures: pd.DataFrame) -> Finding:
    ends = change_ends(row, figures)
    verdict = worst(compared(found, wanted) for found, wanted in ends)
    return Finding(verdict, " to ".join(percent(found) for found, _ in ends))


def _change_within(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A bound on changes; in sign only if all are reductions."""
    names = row.figure.split()
    found = [float(changes(figures, [row.run], row.base, name)[0]) for name in names]
    text = ", ".join(f"{name} {percent(x)}" for name, x in zip(names, found, strict=True))
    return Finding(graded(max(found) <= float(row.most), max(found) < 0.0), text)


def _value(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A printed value, within a share of it or a floor."""
    found = float(figures.at[row.run, row.figure])
    verdict = compared(found, float(row.printed), float(row.share), float(row.least))
    return Finding(verdict, f"{found:.3f}")


def _within(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A figure of each run within bounds; in sign only above `share`."""
    runs = flat(series(row.run))
    values = figures.loc[runs, row.figure].to_numpy(dtype=float)
    holds = values.min() >= number(row.least, -np.inf) and values.max() <= number(row.most, np.inf)
    in_sign = bool(row.share) and values.min() > float(row.share)
    text = "; ".join(f"{run} {value:.4g}" for run, value in zip(runs, values, strict=True))
    return Finding(graded(bool(holds), in_sign), f"{row.figure}: {text}")


def _settles(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A temperature near the printed one; in sign only between that and the start."""
    found, start = (float(figures.at[row.run, key]) for key in (row.figure, "start_temperature"))
    printed = float(row.printed)
    between = min(printed, start) <= found <= max(printed, start)
    return Finding(graded(abs(found - printed) <= float(row.least), between), f"{found:.2f} °C")


def _lower(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """Each run below each base in each figure, or a share of these comparisons."""
    pairs = list(
        itertools.product(flat(series(row.run)), flat(series(row.base)), row.figure.split())
    )
    failing = [
        f"{name} {figures.at[low, name]:.6g} ({low}) against {figures.at[high, name]:.6g} ({high})"
        for low, high, name in pairs
        if not figures.at[low, name] < figures.at[high, name]
    ]
    return _counted(len(pairs), failing, number(row.share, 1.0))


def _counted(total: int, failing: Sequence[str], share: float = 1.0) -> Finding:
    holding = total - len(failing)
    shown = f"; not: {'; '.join(failing[:4])}" if failing else ""
    more = f"; and {len(failing) - 4} more" if len(failing) > 4 else ""
    return Finding(
        graded(holding >= share * total), f"{holding} of {total} comparisons hold{shown}{more}"
    )


def _ordered(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """Pairs of figures ``a<b`` or ``a>b`` of a run and of each base; in sign only if one pair holds."""
    holds, texts = [], []
    for pair in row.figure.split():
        sign = "<" if "<" in pair else ">"
        own, other = pair.split(sign)
        mine = float(figures.at[row.run, own])
        bases = flat(series(row.base))
        theirs = [float(figures.at[base, other]) for base in bases]
        holds.append(all(mine < each if sign == "<" else mine > each for each in theirs))
        texts.append(f"{own} {mine:.4g}, {other} {', '.join(f'{each:.4g}' for each in theirs)}")
    return Finding(graded(all(holds), any(holds)), "; ".join(texts))


def _between(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A run between two others in each figure, or in a share of them."""
    failing = []
    for name in row.figure.split():
        found = float(figures.at[row.run, name])
        low, high = sorted(float(figures.at[end, name]) for end in expanded(row.base))
        if not low <= found <= high:
            failing.append(f"{name} {found:.6g}, ends {low:.6g} and {high:.6g}")
    return _counted(len(row.figure.split()), failing, number(row.share, 1.0))


def _rank(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """The place of a run among others, 1 being the lowest, in each figure."""
    places = {
        name: 1 + int((figures.loc[expanded(row.base), name] < figures.at[row.run, name]).sum())
        for name in row.figure.split()
    }
    text = ", ".join(f"{name}: rank {place}" for name, place in places.items())
    return Finding(graded(set(places.values()) == {int(row.printed)}), text)


def _best(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A ranking of series by their mean, which should start as printed."""
    means = {
        name: float(figures.loc[runs, row.figure].mean()) for name, runs in series(row.run).items()
    }
    ranking = sorted(means, key=means.__getitem__)
    wanted = row.printed.split("; ")
    text = ", ".join(f"{name} ({means[name]:.4f})" for name in ranking)
    return Finding(graded(ranking[: len(wanted)] == wanted), f"ranking {text}")


def _aging_falls(_: pd.Series, figures: pd.DataFrame) -> Finding:
    """Degradation falls with current and with temperature everywhere on the map of Fig. 4."""
    loss = figures.attrs["aging_map"]
    by_current = bool(np.all(np.diff(loss, axis=1) > 0.0))
    by_temperature = bool(np.all(np.diff(loss.iloc[:, 1:], axis=0) > 0.0))
    words = ["everywhere" if holds else "not everywhere" for holds in (by_current, by_temperature)]
    text = f"with current: {words[0]}, with temperature: {words[1]}"
    return Finding(graded(by_current and by_temperature, by_current or by_temperature), text)


def _aging_exponential(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """At 30 degC the loss per ampere-hour grows exponentially with current."""
    loss = figures.attrs["aging_map"]
    at_30_c = loss.loc[30.0].iloc[1:]
    steps = np.diff(np.log(at_30_c / at_30_c.index))
    straight = bool(np.ptp(steps) <= 1e-6 * np.max(np.abs(steps)))
    one_c, two_c = at_30_c.iloc[len(at_30_c) // 2 - 1], at_30_c.iloc[-1]
    factor = float(two_c / one_c)
    text = f"loss per hour from 1C to 2C times {factor:.2f}"
    return Finding(
        graded(straight and factor >= 2.0 * (1.0 + float(row.least)), factor > 2.0), text
    )


CHECKS: dict[str, Callable[[pd.Series, pd.DataFrame], Finding]] = {
    "change": _change,
    "change_within": _change_within,
    "value": _value,
    "within": _within,
    "settles": _settles,
    "lower": _lower,
    "ordered": _ordered,
    "between": _between,
    "rank": _rank,
    "best": _best,
    "trend": series_rules.trend,
    "trend_ends": series_rules.trend_ends,
    "not_always": series_rules.not_always,
    "opposed": series_rules.opposed,
    "most_steps": series_rules.most_steps,
    "levels_off": series_rules.levels_off,
    "spread": series_rules.spread,
    "aging_falls": _aging_falls,
    "aging_exponential": _aging_exponential,
}
