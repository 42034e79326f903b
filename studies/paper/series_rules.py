"""Checks of statements on series of runs: what rises or falls, levels off, or spreads."""

from __future__ import annotations

import numpy as np
import pandas as pd
from studies.paper.equations import Array
from studies.paper.statements import (
    LEVEL_STEP,
    LONG_STEPS,
    NOT_REPRODUCED,
    REPRODUCED,
    Finding,
    flat,
    graded,
    number,
    percent,
    series,
    worst,
)


def _signed(figure: str) -> tuple[float, str]:
    return (1.0 if figure[0] == "+" else -1.0), figure[1:]


def _contradicted(sign: float, values: Array) -> bool:
    """Whether some step goes the other way by more than a level step."""
    return bool(np.any(sign * np.diff(values) < -LEVEL_STEP * np.abs(values[:-1])))


def trend(row: pd.Series, figures: pd.DataFrame, steps: bool = True) -> Finding:  # noqa: FBT001, FBT002
    """Figures rise or fall along a share of the series, by at least a limit in all."""
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


def trend_ends(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """The same from the first run to the last."""
    found = trend(row, figures, steps=False)
    return Finding(graded(found.verdict == REPRODUCED), found.found)


def not_always(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """Figures do not follow a direction in every step."""
    moved, texts = [], []
    for figure in row.figure.split():
        sign, key = _signed(figure)
        values = figures.loc[flat(series(row.run)), key].to_numpy(dtype=float)
        moved.append(_contradicted(sign, values))
        texts.append(_steps_text("", key, values))
    return Finding(graded(any(moved)), "; ".join(texts))


def opposed(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """In some step, the first figure moves one way and each of the others the other way."""
    runs = flat(series(row.run))
    columns = {name: figures.loc[runs, name].to_numpy(dtype=float) for name in row.figure.split()}
    first, *others = (
        np.where(np.abs(np.diff(values)) > LEVEL_STEP * np.abs(values[:-1]), np.diff(values), 0.0)
        for values in columns.values()
    )
    apart = np.all([first * other < 0.0 for other in others], axis=0)
    text = "; ".join(_steps_text("", name, values) for name, values in columns.items())
    return Finding(graded(bool(apart.any())), text)


def most_steps(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """A figure rises or falls in more than half of the steps of all series."""
    sign, key = _signed(row.figure)
    moved, texts = [], []
    for name, runs in series(row.run).items():
        values = figures.loc[runs, key].to_numpy(dtype=float)
        moved += (sign * np.diff(values) > LEVEL_STEP * np.abs(values[:-1])).tolist()
        texts.append(_steps_text(name, key, values))
    text = f"{sum(moved)} of {len(moved)} steps; {'; '.join(texts)}"
    return Finding(graded(2 * sum(moved) > len(moved)), text)


def levels_off(row: pd.Series, figures: pd.DataFrame) -> Finding:
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


def spread(row: pd.Series, figures: pd.DataFrame) -> Finding:
    """Largest over smallest value, minus one, of the widest figure of each series."""
    holds, texts = [], []
    for name, runs in series(row.run).items():
        part = figures.loc[runs, row.figure.split()]
        spreads = 100.0 * (part.max() / part.min() - 1.0)
        widest = float(spreads.max())
        holds.append(number(row.least, 0.0) <= widest <= number(row.most, np.inf))
        texts.append(f"{name}: {spreads.idxmax()} {widest:.2f} %")
    return Finding(graded(all(holds)), "; ".join(texts))
