"""Two sources of one quantity in a drive, compared over the trip by their ratio and their correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iptm_core.routes.cycles import cumulative_integral
from iptm_core.routes.drive_table import lengths
from iptm_core.state import FloatArray
from iptm_drives.clean_times import usual_step_s

FACTORS = {
    3.6: "km/h and m/s",
    2.236936: "mph and m/s",
    1.943844: "knots and m/s",
    1.852: "knots and km/h",
    1.609344: "mph and km/h",
    3.28084: "ft and m",
    57.29578: "degrees and rad",
    1.745329: "degrees and percent",
    100.0: "percent and fraction",
    1000.0: "a thousandth and one",
}
"""Ratios between units that are taken for each other, which also occur the other way round."""
_CLOSE, _ALONE, _NEAR_NONE = 0.02, 3.5, 0.06
"""Tolerance of factors, and of the large ones, which are near no other factor."""
_AGREES, _SAME_M = 0.2, 5.0
_MOST_APART = 0.3
"""Share of the windows in which two sources may differ."""
WINDOW_STEPS, _STEP_S = 5, 2.0


@dataclass(frozen=True, eq=False)
class SourceComparison:
    """What two sources state for the windows of a trip.

    Attributes:
        first: amounts of the first source, shape (n,).
        second: values of the second one, shape (n,).
        edges: first and last row of every window, shape (n, 2).
    """

    first: FloatArray
    second: FloatArray
    edges: NDArray[np.int64]

    @property
    def ratio(self) -> float:
        """The first source divided by the second one: the median of windows, or the ratio of the sums."""
        clear = (np.abs(self.second) > _SAME_M) & (np.abs(self.first) > _SAME_M)
        if np.count_nonzero(clear) >= 3:
            return float(np.median(self.first[clear] / self.second[clear]))
        total = float(np.abs(self.second).sum())
        return float(np.abs(self.first).sum()) / total if total else np.inf

    @property
    def correlation(self) -> float:
        """Of the amounts, 0 where one of them does not change."""
        if self.first.size < 2 or not (self.first.std() and self.second.std()):
            return 0.0
        return float(np.corrcoef(self.first, self.second)[0, 1])

    def apart(self, ratio: float = 1.0) -> NDArray[np.bool_]:
        """Return the windows in which the sources differ by more than measuring does, shape (n,)."""
        first = self.first / ratio
        most = np.maximum(np.abs(first), np.abs(self.second))
        result: NDArray[np.bool_] = np.abs(first - self.second) > _SAME_M + _AGREES * most
        return result

    def agrees(self, ratio: float = 1.0) -> bool:
        """Return whether the sources agree once the first one is divided by a ratio."""
        return bool(np.count_nonzero(self.apart(ratio)) <= _MOST_APART * self.first.size)

    def named_factor(self) -> tuple[float, str] | None:
        """Return a factor by which the sources differ, and its units; None if there is none."""
        return next((found for found in factors_near(self.ratio) if self.agrees(found[0])), None)

    def in_words(self) -> str:
        """Return ratio and correlation."""
        return f"ratio {self.ratio:.3g}, correlation {self.correlation:.2f}"


def factors_near(ratio: float) -> list[tuple[float, str]]:
    """Return the factors between units that a ratio may be, and these units."""
    found = []
    for value, units in FACTORS.items():
        tolerance = _NEAR_NONE if value > _ALONE else _CLOSE
        near = [each for each in (value, 1.0 / value) if abs(ratio / each - 1.0) < tolerance]
        found += [(factor, units) for factor in near]
    return found


def windows(times: FloatArray) -> NDArray[np.int64]:
    """Return rows at least two seconds apart, first to last, shape (m,)."""
    step_s = max(_STEP_S, 2.0 * usual_step_s(times))
    _, rows = np.unique(np.floor((times - times[0]) / step_s), return_index=True)
    return np.asarray(rows, np.int64)


def distances(times: FloatArray, speeds: FloatArray, plane: FloatArray) -> SourceComparison:
    """Compare the distances by speeds (first) and by places (second), in windows of ten seconds or more.

    Args:
        times: times, shape (n,).
        speeds: speeds, shape (n,).
        plane: places, shape (n, 2).
    """
    rows = windows(times)
    by_speed = np.diff(cumulative_integral(times, np.abs(speeds))[rows])
    by_place = lengths(np.diff(plane[rows], axis=0))
    return summed(by_speed, by_place, rows)


def summed(first: FloatArray, second: FloatArray, rows: NDArray[np.int64]) -> SourceComparison:
    """Return the comparison of steps between rows, put together in windows."""
    starts = np.arange(0, max(first.size, 1), WINDOW_STEPS)
    ends = np.minimum(starts + WINDOW_STEPS, first.size)
    edges = np.column_stack([rows[starts], rows[ends]])
    if not first.size:
        return SourceComparison(first, second, edges[:0])
    return SourceComparison(np.add.reduceat(first, starts), np.add.reduceat(second, starts), edges)
