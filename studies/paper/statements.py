"""Statements of the paper (``claims.csv``), what their cells mean, and the marks that they get.

A row names its check and what that compares: runs by address (``a/b|c`` is a/b and a/c; ``name=...;
name=...`` are series), a base, figures (``+`` rises, ``-`` falls), and numbers. Relative changes are in
percent.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
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
NARROW_SHARE = 0.1
"""The closer of two bounds between which the printed changes are also listed."""
ABSOLUTE_SHARE = 0.1
"""A figure counts as the printed one within a tenth of it."""
LEVEL_STEP = 5e-4
"""Relative change from one run to the next that still counts as level."""
LONG_STEPS = (5, 10, 12, 15, 20)
AT_BATTERY = {
    "traction_energy": "traction_energy_battery",
    "total_energy_printed": "battery_energy",
}
"""The other reading of the row that is labelled as the integral of P_tra: what the pack gives for it."""

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


def flat(found: Series) -> list[str]:
    """Addresses of all series."""
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
