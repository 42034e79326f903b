"""The one pass that makes a drive of a table, whatever file it is from.

Times are put in order first (`iptm_drives.clean_times`). A value that is missing, invalid or not
plausible costs that value: it is interpolated. Speeds are compared with places, heights with slopes
(`iptm_drives.contradictions`). Every repair is a note; what cannot be repaired is refused with its row.
Values that need no repair are left as they are, to the last bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable, counted, lengths
from iptm_core.routes.track import SPEED_WINDOW_S, STANDSTILL_M_S, local_line
from iptm_core.routes.user_csv import MAX_STEP_S
from iptm_core.state import FloatArray
from iptm_drives.clean_motion import MAX_ACCELERATION_M_S2, cleaned_motion
from iptm_drives.clean_places import cleaned_road
from iptm_drives.clean_times import in_order, usual_step_s

_TOLD_GAP_S = 10.0
_DRIVES_M_S = 5.0
_Which = NDArray[np.bool_]
"""Which steps, shape (n,)."""


def clean(table: DriveTable) -> DriveTable:
    """Return the drive of a table: times from 0 on, at most `MAX_STEP_S` apart, and no value missing.

    Places are kept where they are on Earth. Speeds are missing where places are the only source.

    Raises:
        RouteError: a row cannot be repaired, two sources contradict, or it lasts less than two seconds.
    """
    table = cleaned_motion(_united(in_order(table)))
    table = cleaned_road(_speeds_filled(_without_pauses(table)))
    stands = "speed_m_s" in table.columns and not table.columns["speed_m_s"].any()
    return table.noted(f"{table.named('speed_m_s')[0]} is 0 throughout") if stands else table


def _united(table: DriveTable) -> DriveTable:
    """Give the rows of a sparse table all quantities, at the times of the speed, or else of the place."""
    known = {name: np.isfinite(values) for name, values in table.columns.items()}
    empty = [name for name, rows in known.items() if not rows.any()]
    if empty:
        gone = ", ".join(table.named(name)[0] for name in empty)
        table = table.having(**dict.fromkeys(empty)).noted(f"{gone} without a value")
    if not {"latitude_deg", "longitude_deg"} <= table.columns.keys():
        table = table.having(latitude_deg=None, longitude_deg=None)
    if not table.sparse:
        return table
    times = table.columns["time_s"]
    main = next((name for name in ("speed_m_s", "latitude_deg") if name in table.columns), "time_s")
    others = {
        name: np.interp(times, times[known[name]], values[known[name]])
        for name, values in table.columns.items()
        if name != main
    }
    return table.having(**others).kept(known[main]).from_zero()


def _kinds_of_steps(
    table: DriveTable, steps: FloatArray
) -> tuple[_Which, _Which, _Which, FloatArray]:
    """Return which steps are pauses, of a clock set ahead, and filled up; and how long they become."""
    plane, speeds = table.plane(), table.columns.get("speed_m_s")
    reach, none = np.minimum(steps, MAX_STEP_S), np.zeros(steps.size, dtype=np.bool_)
    if plane is None or not np.isfinite(plane).all():
        if speeds is None:
            return none, none, none, reach
        slow = np.nan_to_num(speeds, nan=np.inf) <= STANDSTILL_M_S
        return (steps > MAX_STEP_S) & slow[1:] & slow[:-1], none, none, reach
    long = steps > 2.0 * SPEED_WINDOW_S
    moved = lengths(np.diff(plane, axis=0))
    stands = long & (moved <= STANDSTILL_M_S * reach)
    before, after = _speeds_beside(speeds, moved / steps)
    # It cannot have braked to standstill on so short a way.
    braking_m = 0.5 * (before**2 + after**2) / MAX_ACCELERATION_M_S2
    set_ahead = stands & (np.minimum(before, after) > _DRIVES_M_S) & (moved < braking_m)
    reach = np.where(set_ahead, 2.0 * moved / np.maximum(before + after, 1e-9), reach)
    filled_up = long & ~stands & (steps <= MAX_STEP_S) if speeds is None else none
    return stands & ~set_ahead, set_ahead, filled_up, reach


def _without_pauses(table: DriveTable) -> DriveTable:
    """Shorten pauses to `MAX_STEP_S`, and add rows at standstill to those longer than the window of speeds.

    A device that stops recording while the car stands leaves a gap. In a pause the car moves slower than
    walking; without places, it stands before and after.
    """
    times, columns = table.columns["time_s"], table.columns
    steps = np.diff(times)
    stands, set_ahead, filled_up, reach = _kinds_of_steps(table, steps)
    gone_on = (steps > MAX_STEP_S) & ~stands & ~set_ahead
    if gone_on.any():
        row = int(np.argmax(gone_on)) + 1
        raise RouteError(
            f"{table.at(row)}, column time_s: value {times[row]:.12g}, {steps[row - 1]:g} s after the one "
            f"before; allowed: more than 0 and up to {MAX_STEP_S:g} s, or a pause at one place"
        )
    long = (steps > max(_TOLD_GAP_S, 10.0 * usual_step_s(times))) & ~stands & ~set_ahead
    if long.any():
        row = int(np.argmax(np.where(long, steps, 0.0)))
        what = f"{counted(int(long.sum()), 'gap')} of up to {steps[row]:.3g} s while driving"
        table = table.noted(
            f"{what}, at {table.counted} {table.rows[row + 1]}: evenly interpolated"
        )
    for row in np.flatnonzero(set_ahead).tolist():
        by = f"{steps[row] - reach[row]:.3g} s at {table.counted} {table.rows[row + 1]}"
        table = table.noted(f"clock set ahead by {by}: the times after it are moved")
    if not (stands | set_ahead | filled_up).any():
        return table
    pause_s = float(steps[stands].sum())
    if pause_s:
        kept_s = float(reach[stands].sum())
        told = f", {kept_s:.4g} s kept" if pause_s > kept_s else ""
        table = table.noted(f"{counted(int(stands.sum()), 'pause')} of {pause_s:.4g} s{told}")
    removed = np.where(stands | set_ahead, steps - reach, 0.0)
    moved_times = times - np.concatenate([[0.0], np.cumsum(removed)])
    count = np.where(stands | filled_up, np.ceil(reach).astype(np.int64) - 1, 0)
    at = np.repeat(np.arange(count.size), count)
    inside = np.arange(at.size) - np.repeat(np.cumsum(count) - count, count) + 1.0
    filled: dict[str, FloatArray | None] = {
        name: np.insert(
            values, at + 1, values[at] + (values[at + 1] - values[at]) * inside / reach[at]
        )
        for name, values in columns.items()
    }
    filled["time_s"] = np.insert(moved_times, at + 1, moved_times[at] + inside)
    if "speed_m_s" in columns:
        filled["speed_m_s"] = np.insert(columns["speed_m_s"], at + 1, 0.0)
    return replace(
        table.having(**filled),
        rows=np.insert(table.rows, at + 1, table.rows[at]),
        received_s=None,
    )


def _speeds_beside(speeds: FloatArray | None, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the speeds before and after each step: as stated, or of the steps beside it."""
    if speeds is not None:
        known = np.nan_to_num(speeds)
        return known[:-1], known[1:]
    return np.concatenate([[0.0], rates[:-1]]), np.concatenate([rates[1:], [0.0]])


def _speeds_filled(table: DriveTable) -> DriveTable:
    """Fill speeds that are missing from places, else from the rows beside them."""
    times, plane = table.columns["time_s"], table.plane()
    has_places = plane is not None and bool(np.isfinite(plane).all())
    speeds = table.columns.get("speed_m_s")
    if speeds is None:
        if plane is None or not has_places:
            raise RouteError(
                f"{table.source}: it states neither speeds nor places; allowed: one of them, or both"
            )
        if "latitude_deg" in table.columns:
            return table
        return table.having(speed_m_s=_speeds_of(plane, times, times))
    known = np.flatnonzero(np.isfinite(speeds))
    if known.size == times.size:
        return table
    if plane is not None and has_places:
        filled = speeds.copy()
        filled[~np.isfinite(speeds)] = _speeds_of(plane, times, times[~np.isfinite(speeds)])
        return table.having(speed_m_s=filled)
    gaps = np.diff(times[known])
    if gaps.size and gaps.max() > MAX_STEP_S:
        row = int(known[int(np.argmax(gaps)) + 1])
        raise RouteError(
            f"{table.at(row)}: no speed for {gaps.max():g} s; allowed: up to {MAX_STEP_S:g} s"
        )
    inside = (times >= times[known[0]]) & (times <= times[known[-1]])
    table = table.having(speed_m_s=np.interp(times, times[known], speeds[known]))
    return table.kept(inside).from_zero()


def _speeds_of(plane: FloatArray, times: FloatArray, at: FloatArray) -> FloatArray:
    """Return speeds of places at some times, as slopes of local lines."""
    east, north = (local_line(times, plane[:, axis], at, SPEED_WINDOW_S)[1] for axis in (0, 1))
    speeds = np.hypot(east, north)
    return np.where(speeds < STANDSTILL_M_S, 0.0, speeds)
