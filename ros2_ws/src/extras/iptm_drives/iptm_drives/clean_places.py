"""Places, slopes and heights along a drive: what is off the road, frozen or not plausible is filled in."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import cumulative_integral
from iptm_core.routes.drive_table import DriveTable, lengths
from iptm_core.routes.slope import MAX_GRADE
from iptm_core.state import FloatArray
from iptm_drives.cells import MOST_INVALID
from iptm_drives.contradictions import summed, windows

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
    if leaps.any() and "speed_m_s" in table.columns:
        row = int(whole[int(np.argmax(leaps)) + 1])
        words = f"the place leaps at {table.counted} {table.rows[row]}: places left out, the speeds count"
        return table.having(**dict.fromkeys(set(PLACES) & table.columns.keys())).noted(words)
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


_LEAP_M, _STEP_M = 20.0, 100.0
_LEVEL_M = 10.0
_LOWEST_M, _HIGHEST_M = -1000.0, 9000.0


def cleaned_road(table: DriveTable) -> DriveTable:
    """Return a table with heights or slopes, none of them missing.

    Raises:
        RouteError: a step that no road has, or heights and slopes that contradict.
    """
    return _heights_against_slopes(_heights(_slopes(table)))


def _way(table: DriveTable) -> FloatArray:
    """Return the distance driven at every row."""
    plane, speeds = table.plane(), table.columns.get("speed_m_s")
    if speeds is not None:
        return cumulative_integral(table.columns["time_s"], speeds)
    if plane is None:
        return np.zeros(table.rows.size)
    return np.concatenate([[0.0], np.cumsum(lengths(np.diff(plane, axis=0)))])


def _slopes(table: DriveTable) -> DriveTable:
    """Fill slopes that are missing or steeper than roads are."""
    slopes = table.columns.get("slope_rad")
    if slopes is None:
        return table
    known, limit = np.isfinite(slopes), float(np.arctan(MAX_GRADE))
    steep = known & (np.abs(slopes) > limit)
    if np.count_nonzero(steep) > MOST_INVALID * np.count_nonzero(known):
        name, unit = table.named("slope_rad")
        if name != "slope_rad":  # stated as a rise
            limit, slopes = MAX_GRADE / unit, np.tan(slopes) / unit
        row = int(np.argmax(steep))
        raise RouteError(
            f"{table.at(row)}, column {name}: value {slopes[row]:.12g}; allowed: -{limit:.6g} to {limit:.6g}"
        )
    return _filled(table, "slope_rad", known & ~steep)


def _filled(table: DriveTable, name: str, usable: NDArray[np.bool_]) -> DriveTable:
    """Interpolate a quantity of the road along the way, where it is not usable."""
    lost = int(np.count_nonzero(~usable))
    if not lost:
        return table
    way, values = _way(table), table.columns[name]
    stretch = float(np.diff(way[usable]).max()) if np.count_nonzero(usable) > 1 else 0.0
    filled = np.where(usable, values, np.interp(way, way[usable], values[usable]))
    what, rows = table.named(name)[0], table.count(lost)
    note = f"{what} missing or not plausible at {rows}: interpolated (up to {stretch:.0f} m)"
    return table.having(**{name: filled}).noted(note)


def _heights(table: DriveTable) -> DriveTable:
    """Fill heights that are missing, or leap from those beside them and back."""
    heights = table.columns.get("elevation_m")
    if heights is None:
        return table
    times, way = table.columns["time_s"], _way(table)
    known = np.flatnonzero((heights > _LOWEST_M) & (heights < _HIGHEST_M))

    def leaps_by(most_m: float, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = np.abs(np.diff(heights[rows])) > most_m + MAX_GRADE * np.diff(
            way[rows]
        )
        return found

    steps, breaks = partial(leaps_by, _STEP_M), partial(leaps_by, _LEAP_M)
    whole = consistent(known, times, steps, LONGEST_LOST_FIX_S, share=MOST_INVALID)
    leaps = steps(whole)
    if leaps.any():
        row = int(whole[int(np.argmax(leaps)) + 1])
        raise table.refuse(row, "elevation_m", f"no step of more than {_STEP_M:g} m; this is one")
    # A smaller step may be one of the receiver; a leap that comes back within seconds is none.
    smaller = consistent(whole, times, breaks, LONGEST_OUTLIER_S)
    whole = smaller if not breaks(smaller).any() else whole
    usable = np.zeros(times.size, dtype=np.bool_)
    usable[whole] = True
    stated = np.flatnonzero(np.isfinite(heights))
    if whole.size < (1.0 - MOST_INVALID) * stated.size:
        row = int(stated[int(np.argmin(usable[stated]))])
        raise table.refuse(
            row, "elevation_m", f"heights of a road; {stated.size - whole.size} leap"
        )
    return _filled(table, "elevation_m", usable)


def _heights_against_slopes(table: DriveTable) -> DriveTable:
    """Compare heights with slopes where both are stated; in a plane the slopes count, else the heights."""
    columns = table.columns
    if not {"elevation_m", "slope_rad"} <= columns.keys():
        return table
    rows, way = windows(columns["time_s"]), _way(table)
    climbed = np.diff(cumulative_integral(way, np.sin(columns["slope_rad"]))[rows])
    found = summed(climbed, np.diff(columns["elevation_m"][rows]), rows)
    chosen = table.having(**{"elevation_m" if "east_m" in columns else "slope_rad": None})
    if np.abs(found.first).sum() < _LEVEL_M and np.abs(found.second).sum() < _LEVEL_M:
        return chosen
    if np.ptp(columns["elevation_m"]) == 0.0:
        return table.having(elevation_m=None).noted("its height never changes: the slope counts")
    named = found.named_factor()
    if found.agrees() and named is None:
        return chosen
    cause = f", as {named[1]} do" if named else ""
    climbs = f"{climbed.sum():.0f} m and {found.second.sum():.0f} m of climb"
    raise RouteError(
        f"{table.source}: slopes and heights contradict: {climbs} ({found.in_words()}){cause}; "
        "allowed: the same within 20 %"
    )
