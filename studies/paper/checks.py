"""Statements of the paper (``claims.csv``) checked on figures of runs: a verdict, and what was found.

A row names its check, a function of this module, and what that compares: runs by address (``a/b|c`` is a/b
and a/c; ``name=...; name=...`` are series), a base, figures (``+`` rises, ``-`` falls), and numbers. Figures
are a table with a row per address. Relative changes are in percent.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from studies.paper.equations import Array

HERE = Path(__file__).parent
REPRODUCED, SIGN_ONLY, NOT_REPRODUCED = "✓", "≈", "✗"
VERDICTS = {
    REPRODUCED: "reproduced",
    SIGN_ONLY: "reproduced in sign only",
    NOT_REPRODUCED: "not reproduced",
    "–": "not tested",
}
CHANGE_SHARE, CHANGE_FLOOR = 0.25, 1.0
"""A change counts as the printed one within a quarter of it, or one percentage point."""
ABSOLUTE_SHARE = 0.1
"""A figure counts as the printed one within a tenth of it."""
LEVEL_STEP = 5e-4
"""Relative change from one run to the next that still counts as level."""
HELD_BACK_SEED = 36
LONG_STEPS = (5, 10, 12, 15, 20)
AS_LABELLED = {
    "traction_energy_battery": "traction_energy",
    "battery_energy": "total_energy_printed",
}
"""The other reading of the traction row: the integral of P_tra, as labelled, and its sum with cooling."""

Series = dict[str, list[str]]


@dataclass(frozen=True)
class Finding:
    """A verdict and what was found."""

    verdict: str
    found: str


def claims() -> pd.DataFrame:
    """The statements, one row each, in the order of the paper; empty cells are empty texts."""
    return pd.read_csv(HERE / "claims.csv", dtype=str, keep_default_na=False).set_index("id")


def printed_table() -> pd.DataFrame:
    """Table IV: a row per strategy, a column per figure, in the units of the suite's figures."""
    return pd.read_csv(HERE / "printed.csv", index_col="run")


def check(row: pd.Series, figures: pd.DataFrame, reading: dict[str, str] | None = None) -> Finding:
    """Check a statement.

    Args:
        row: of `claims`.
        figures: by address and key.
        reading: figures that stand for others.
    """
    needed = [address for cell in (row.run, row.base) for address in _flat(series(cell))]
    lacking = [address for address in needed if address not in figures.index]
    if lacking:
        return Finding("–", f"missing: {', '.join(lacking[:3])}")
    read = row.copy()
    for name, other in (reading or {}).items():
        read["figure"] = re.sub(rf"\b{name}\b", other, read.figure)
    return CHECKS[row.check](read, figures)


def all_checks(figures: pd.DataFrame) -> pd.DataFrame:
    """Every statement checked: verdict, what was found, and the verdict as labelled where that can differ."""
    rows = {}
    for key, row in claims().iterrows():
        found = check(row, figures)
        other = any(name in row.figure for name in AS_LABELLED)
        as_labelled = check(row, figures, AS_LABELLED).verdict if other else ""
        rows[key] = {"verdict": found.verdict, "found": found.found, "as_labelled": as_labelled}
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
    needed = [address for cell in (row.run, row.base) for address in _flat(series(cell))]
    if not set(needed) <= set(printed.index):
        return "–"
    return check(row, printed).found


def held_back() -> list[str]:
    """Statements that the search of the numbers did not see: a third, drawn with a seed."""
    drawn = np.random.default_rng(HELD_BACK_SEED).permutation(claims().index.to_numpy())
    return sorted(drawn[: len(drawn) // 3].tolist())


def series(cell: str) -> Series:
    """Addresses of a cell by series; the name of the only one is empty."""
    if not cell:
        return {}
    parts = [part.strip().rpartition("=") for part in cell.split(";")]
    return {name: expanded(patterns) for name, _, patterns in parts}


def expanded(patterns: str) -> list[str]:
    """Addresses of patterns separated by blanks."""
    return [
        "/".join(parts)
        for pattern in patterns.split()
        for parts in itertools.product(*(part.split("|") for part in pattern.split("/")))
    ]


def _flat(found: Series) -> list[str]:
    return list(itertools.chain(*found.values()))


def numbers(cell: str) -> list[float]:
    """The numbers of a cell."""
    return [float(word) for word in cell.split()]


def number(cell: str, default: float) -> float:
    """The number of a cell that may be empty."""
    return float(cell) if cell else default


def graded(holds: bool, in_sign: bool = False) -> str:  # noqa: FBT001, FBT002
    """The verdict on a statement that holds, or holds in sign."""
    return REPRODUCED if holds else SIGN_ONLY if in_sign else NOT_REPRODUCED


def worst(verdicts: Iterable[str]) -> str:
    """The verdict on a statement with several parts."""
    return max(verdicts, key=list(VERDICTS).index)


def compared(
    found: float, printed: float, share: float = CHANGE_SHARE, floor: float = CHANGE_FLOOR
) -> str:
    """Whether a number has the sign of the printed one and lies within a share of it, at least the floor."""
    same_sign = found * printed > 0.0
    return graded(same_sign and abs(found - printed) <= max(floor, share * abs(printed)), same_sign)


def absolute(found: float, printed: float) -> str:
    """Whether a figure itself is the printed one."""
    return graded(abs(found - printed) <= ABSOLUTE_SHARE * abs(printed))


def percent(value: float) -> str:
    """A relative change in percent as it stands on the page."""
    return f"{value:+.2f} %"


def changes(figures: pd.DataFrame, runs: Sequence[str], base: str, figure: str) -> Array:
    """Relative changes from a base run in percent, shape (runs,)."""
    values = figures.loc[list(runs), figure].to_numpy(dtype=float)
    before = float(figures.at[base, figure])
    return 100.0 * (values / before - 1.0) if before else np.full(values.shape, np.nan)


def _change(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A printed change, or the smallest and largest one of several runs."""
    wanted = numbers(row.printed)
    found = changes(figures, _flat(series(row.run)), row.base, row.figure)
    ends = [float(found[0])] if len(wanted) == 1 else [float(found.min()), float(found.max())]
    return Finding(worst(map(compared, ends, wanted)), " to ".join(map(percent, ends)))


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
    runs = _flat(series(row.run))
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
        itertools.product(_flat(series(row.run)), _flat(series(row.base)), row.figure.split())
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
        bases = _flat(series(row.base))
        theirs = [float(figures.at[base, other]) for base in bases]
        holds.append(all(mine < each if sign == "<" else mine > each for each in theirs))
        texts.append(f"{own} {mine:.4g}, {other} {', '.join(f'{each:.4g}' for each in theirs)}")
    return Finding(graded(all(holds), any(holds)), "; ".join(texts))


def _between(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A run between two others in each figure."""
    failing = []
    for name in row.figure.split():
        found = float(figures.at[row.run, name])
        low, high = sorted(float(figures.at[end, name]) for end in expanded(row.base))
        if not low <= found <= high:
            failing.append(f"{name} {found:.6g}, ends {low:.6g} and {high:.6g}")
    return _counted(len(row.figure.split()), failing)


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


def _signed(figure: str) -> tuple[float, str]:
    return (1.0 if figure[0] == "+" else -1.0), figure[1:]


def _contradicted(sign: float, values: Array) -> bool:
    """Whether some step goes the other way by more than a level step."""
    return bool(np.any(sign * np.diff(values) < -LEVEL_STEP * np.abs(values[:-1])))


def _trend(row: pd.Series, figures: pd.DataFrame, steps: bool = True) -> Finding:  # noqa: FBT001, FBT002
    """Figures rise or fall along a share of the series, by at least so much in all."""
    verdicts, texts = [], []
    for name, runs in series(row.run).items():
        parts = []
        for figure in row.figure.split():
            sign, key = _signed(figure)
            values = figures.loc[runs, key].to_numpy(dtype=float)
            total = sign * (values[-1] - values[0])
            enough = total >= 0.01 * number(row.least, 0.0) * abs(values[0])
            steady = not (steps and _contradicted(sign, values))
            parts.append(graded(bool(total > 0.0 and enough and steady), bool(total > 0.0)))
            texts.append(_steps_text(name, key, values))
        verdicts.append(worst(parts))
    needed = number(row.share, 1.0) * len(verdicts)
    whole = sum(verdict == REPRODUCED for verdict in verdicts)
    signs = sum(verdict != NOT_REPRODUCED for verdict in verdicts)
    return Finding(graded(whole >= needed, signs >= needed), "; ".join(texts))


def _steps_text(name: str, key: str, values: Array) -> str:
    steps = " → ".join(f"{value:.5g}" for value in values)
    total = percent(100.0 * (values[-1] / values[0] - 1.0)) if values[0] else "–"
    return f"{name + ', ' if name else ''}{key} {steps} ({total})"


def _trend_ends(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """The same from the first run to the last."""
    found = _trend(row, figures, steps=False)
    return Finding(graded(found.verdict == REPRODUCED), found.found)


def _not_always(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """Figures do not follow a direction in every step."""
    moved, texts = [], []
    for figure in row.figure.split():
        sign, key = _signed(figure)
        values = figures.loc[_flat(series(row.run)), key].to_numpy(dtype=float)
        moved.append(_contradicted(sign, values))
        texts.append(_steps_text("", key, values))
    return Finding(graded(any(moved)), "; ".join(texts))


def _levels_off(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """The last step of a series saves less a unit than the first one; in sign only if the series saves."""
    verdicts, texts = [], []
    for name, runs in series(row.run).items():
        for figure in row.figure.split():
            values = figures.loc[runs, figure].to_numpy(dtype=float)
            gains = -100.0 * np.diff(values) / np.diff(LONG_STEPS) / values[0]
            saves = bool(values[-1] < values[0])
            verdicts.append(graded(saves and bool(gains[-1] < gains[0]), saves))
            texts.append(
                f"{name}, {figure}: {gains[0]:.3f} % a step at first, {gains[-1]:.3f} % at last"
            )
    return Finding(worst(verdicts), "; ".join(texts))


def _spread(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """Largest over smallest value, minus one, of the widest figure of each series."""
    holds, texts = [], []
    for name, runs in series(row.run).items():
        part = figures.loc[runs, row.figure.split()]
        spreads = 100.0 * (part.max() / part.min() - 1.0)
        widest = float(spreads.max())
        holds.append(number(row.least, 0.0) <= widest <= number(row.most, np.inf))
        texts.append(f"{name}: {spreads.idxmax()} {widest:.2f} %")
    return Finding(graded(all(holds)), "; ".join(texts))


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
    "trend": _trend,
    "trend_ends": _trend_ends,
    "not_always": _not_always,
    "levels_off": _levels_off,
    "spread": _spread,
    "aging_falls": _aging_falls,
    "aging_exponential": _aging_exponential,
}
