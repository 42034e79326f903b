"""Places of a drive: points off the road and repeats of a frozen receiver are left out, gaps filled."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import MOST_INVALID, DriveTable, lengths
from iptm_core.state import FloatArray

LONGEST_OUTLIER_S, LONGEST_LOST_FIX_S = 5.0, 60.0
PLACES = ("latitude_deg", "longitude_deg", "east_m", "north_m", "position_m")
_MOST_IN_ONE_RUN = 0.1
_MOST_ROUNDS = 100
"""Each of them leaves out all runs that are clearly odd; what needs more has no way in it."""


def consistent(
    kept_rows: NDArray[np.int64],
    times: FloatArray,
    breaks: Callable[[NDArray[np.int64]], NDArray[np.bool_]],
    longest_s: float,
    *,
    at_ends: bool = True,
    share: float = _MOST_IN_ONE_RUN,
) -> NDArray[np.int64]:
    """Leave out the short runs of rows between breaks, shortest first, until there is none to leave out.

    Args:
        at_ends: also runs with which the rows begin or end.
        share: of the rows that may be left out as one run.
    """
    most = max(3.0, share * kept_rows.size)
    for _ in range(_MOST_ROUNDS):
        if not (broken := breaks(kept_rows)).any():
            break
        bounds = np.concatenate([[0], np.flatnonzero(broken) + 1, [kept_rows.size]])
        sizes = np.diff(bounds)
        spans = times[kept_rows[bounds[1:] - 1]] - times[kept_rows[bounds[:-1]]]
        beside = np.minimum(
            np.concatenate([[np.inf], sizes[:-1]]), np.concatenate([sizes[1:], [np.inf]])
        )
        short = (spans <= longest_s) & (sizes <= most)
        inside = short.copy()
        inside[[0, -1]] = False
        for run in np.flatnonzero(inside & (sizes >= beside)):
            # Those on both sides of it agree: it is the odd one, however long.
            inside[run] = not breaks(kept_rows[[bounds[run] - 1, bounds[run + 1]]]).any()
        odd = inside if inside.any() or not at_ends else short & (sizes < beside)
        if not odd.any():
            if not (short.any() and at_ends):
                return kept_rows
            odd[int(np.argmin(np.where(short, sizes, kept_rows.size)))] = True
        kept_rows = kept_rows[~np.repeat(odd, sizes)]
    return kept_rows


def cleaned_places(table: DriveTable) -> DriveTable:
    """Leave out places aside of the way, and those repeated while the receiver was frozen; fill gaps."""
    plane, times = table.plane(), table.columns["time_s"]
    if plane is None:
        return table
    known = np.flatnonzero(np.isfinite(plane).all(axis=1))
    if known.size < 3:
        return table

    def breaks(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        moved, steps = lengths(np.diff(plane[rows], axis=0)), np.diff(times[rows])
        usual = _rolling_median(moved / steps)
        free = 10.0 + 6.0 * np.minimum(steps, 2.0) ** 2 + 2.5 * np.maximum(steps - 2.0, 0.0) ** 2
        leaps: NDArray[np.bool_] = moved > np.minimum(
            1.5 * usual * steps + free, 100.0 * steps + 10.0
        )
        return leaps

    # One place aside comes back at once; one after a leap from a frozen place does not.
    aside = consistent(known, times, breaks, LONGEST_OUTLIER_S, at_ends=False)
    frozen = _frozen(plane, aside, breaks)
    fixes = aside[~frozen]
    whole = consistent(fixes, times, breaks, LONGEST_LOST_FIX_S)
    leaps = breaks(whole)
    if whole.size < (1.0 - MOST_INVALID) * fixes.size:
        raise RouteError(
            f"{table.source}: {known.size - whole.size} of {known.size} places are aside of the way or "
            f"frozen; allowed: {100.0 * MOST_INVALID:g} %"
        )
    if leaps.any():
        step = int(np.argmax(leaps))
        row, before = int(whole[step + 1]), int(whole[step])
        speed = lengths(plane[[row]] - plane[[before]])[0] / (times[row] - times[before])
        raise RouteError(
            f"{table.at(row)}: {speed:.0f} m/s from the point before; allowed: the speeds of a car, and "
            "single places aside of its way"
        )
    lost = {
        "without a place": times.size - known.size,
        "with a frozen place": int(frozen.sum()),
        "with a place aside of the way": known.size - aside.size + fixes.size - whole.size,
    }
    notes = [f"{table.count(count)} {what}: interpolated" for what, count in lost.items() if count]
    if not notes:
        return table
    names = [each for each in PLACES if each in table.columns]
    filled: dict[str, FloatArray | None] = {}
    for name in names:
        values = table.columns[name][whole]
        if name == "longitude_deg":
            values = np.asarray(np.unwrap(values, period=360.0), np.float64)
        filled[name] = np.interp(times, times[whole], values)
    table = table.having(**filled).noted(*notes)
    first, last = whole[0], whole[-1]
    ends = (np.arange(times.size) < first) | (np.arange(times.size) > last)
    # Before the first fix and after the last one nothing states a place.
    return table.kept(~ends).from_zero() if "speed_m_s" not in table.columns else table


def _rolling_median(values: FloatArray, half: int = 5) -> FloatArray:
    if not values.size:
        return values
    padded = np.pad(values, half, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    result: FloatArray = np.nanmedian(around, axis=1)
    return result


def _frozen(
    plane: FloatArray,
    known: NDArray[np.int64],
    breaks: Callable[[NDArray[np.int64]], NDArray[np.bool_]],
) -> NDArray[np.bool_]:
    """Return which places only repeat the one before a leap: the receiver had no fix."""
    same = np.concatenate([[False], (np.diff(plane[known], axis=0) == 0.0).all(axis=1)])
    frozen = np.zeros(known.size, dtype=np.bool_)
    for step in np.flatnonzero(breaks(known)):
        row = int(step)
        while same[row]:
            frozen[row] = True
            row -= 1
    return frozen
