"""How far a candidate is from the paper's strategy table: one number, from its absolute and relative rows.

Every printed number gives a deviation in units of the tolerance for reproduced: of an absolute row, the
logarithm of found over printed against `ABSOLUTE_TOLERANCE`; of a relative change, the difference against the
tolerance of the verdicts. Large deviations count linearly (Huber), so that one row that cannot be met does
not decide the fit. What the paper prints elsewhere plays no part: it is what the fit is tested on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from iptm_reproduction import figures as fig
from iptm_reproduction.names import REFERENCE, STRATEGIES, STRATEGY_NAMES
from iptm_reproduction.printed import printed_change, printed_value
from iptm_reproduction.verdict import CHANGE_SHARE, accepted_deviation

ABSOLUTE_TOLERANCE = CHANGE_SHARE
"""Unit of the deviation of an absolute figure, in its logarithm: the tolerance of the verdicts."""
HUBER = 1.5
"""Deviation from which on the loss grows linearly."""

Figures = Mapping[str, float]
"""Figures of a run by key."""


def deviations(runs: Mapping[str, Figures]) -> dict[tuple[str, str], float]:
    """Return the deviations from every number of the table that the runs give, by strategy and figure.

    Args:
        runs: figures by strategy; the reference must be among them. Relative rows come from the others.
    """
    reference = runs["reference"]
    found: dict[tuple[str, str], float] = {}
    for figure in fig.TABLE_FIGURES:
        printed = printed_value(REFERENCE, figure)
        if printed is not None:
            ratio = reference[figure] / printed
            found["reference", figure] = math.log(ratio) / ABSOLUTE_TOLERANCE
    for name, address in zip(STRATEGY_NAMES, STRATEGIES, strict=True):
        if name == "reference" or name not in runs:
            continue
        for figure in fig.TABLE_FIGURES:
            found[name, figure] = _relative(runs[name], reference, address, figure)
    return found


def _relative(run: Figures, reference: Figures, address: str, figure: str) -> float:
    change = run[figure] / reference[figure] - 1.0
    printed = printed_change(address, figure)
    return (change - printed) / accepted_deviation(printed)


def misfit(runs: Mapping[str, Figures]) -> float:
    """Return the mean loss over the numbers of the table that the runs give; 1 is a deviation of one."""
    losses = [huber(value) for value in deviations(runs).values()]
    return sum(losses) / len(losses)


def huber(deviation: float) -> float:
    """Return the square of a small deviation, and the tangent of that beyond `HUBER`."""
    size = abs(deviation)
    return size * size if size <= HUBER else HUBER * (2.0 * size - HUBER)
