"""Slopes and heights along a drive: what is missing or not plausible is interpolated along the way."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.clean_places import (
    LONGEST_LOST_FIX_S,
    LONGEST_OUTLIER_S,
    consistent,
)
from iptm_core.routes.contradictions import summed, windows
from iptm_core.routes.drive_table import MOST_INVALID, DriveTable, lengths
from iptm_core.routes.piecewise import cumulative_integral
from iptm_core.routes.slope import MAX_GRADE
from iptm_core.state import FloatArray

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
