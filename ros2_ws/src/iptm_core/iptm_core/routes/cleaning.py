"""The one pass that makes a drive of a table, whatever file it is from.

Times are put in order first (`iptm_core.routes.clean_times`). A value that is missing, invalid or not
plausible costs that value: it is interpolated. Speeds are compared with places, heights with slopes
(`iptm_core.routes.contradictions`). Every repair is a note; what cannot be repaired is refused with its row.
Values that need no repair are left as they are, to the last bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.clean_motion import cleaned_motion
from iptm_core.routes.clean_road import cleaned_road
from iptm_core.routes.clean_times import (
    MAX_STEP_S,
    counted,
    from_zero,
    in_order,
    kept,
    lengths,
    noted,
    plane_of,
    usual_step_s,
    with_columns,
)
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.track import SPEED_WINDOW_S, STANDSTILL_M_S, local_line
from iptm_core.state import FloatArray

_TOLD_GAP_S = 10.0


def clean(table: DriveTable) -> DriveTable:
    """Return the drive of a table: times from 0 on, at most `MAX_STEP_S` apart, and no value missing.

    Places are kept where they are on Earth. Speeds are missing where places are the only source.

    Raises:
        RouteError: a row cannot be repaired, two sources contradict, or it lasts less than two seconds.
    """
    table = cleaned_motion(_united(in_order(table)))
    return cleaned_road(_speeds_filled(_without_pauses(table)))


def _united(table: DriveTable) -> DriveTable:
    """Give the rows of a sparse table all quantities; those of the speed, or else of the place, count."""
    empty = {name: None for name in table.columns if not np.isfinite(table.columns[name]).any()}
    gone = ", ".join(table.names.get(name, (name, 1.0))[0] for name in empty)
    table = with_columns(table, **empty)
    if "latitude_deg" not in table.columns or "longitude_deg" not in table.columns:
        table = with_columns(table, latitude_deg=None, longitude_deg=None)
    table = noted(table, f"{gone} without a value") if gone else table
    if not table.sparse:
        return table
    times = table.columns["time_s"]
    main = next((name for name in ("speed_m_s", "latitude_deg") if name in table.columns), "time_s")
    keep = np.isfinite(table.columns[main])
    for name in table.columns:
        known = np.flatnonzero(np.isfinite(table.columns[name]))
        if name != main:
            table = with_columns(
                table, **{name: np.interp(times, times[known], table.columns[name][known])}
            )
    table = kept(table, keep)
    return with_columns(table, time_s=table.columns["time_s"] - table.columns["time_s"][0])


def _without_pauses(table: DriveTable) -> DriveTable:
    """Shorten pauses to `MAX_STEP_S`, and add rows at standstill to those longer than the window of speeds.

    A device that stops recording while the car stands leaves a gap. In a pause the car moves slower than
    walking; without places, it stands before and after.
    """
    times, columns = table.columns["time_s"], table.columns
    steps, plane = np.diff(times), plane_of(table)
    reach = np.minimum(steps, MAX_STEP_S)
    if plane is not None and np.isfinite(plane).all():
        moved = lengths(np.diff(plane, axis=0))
        stands = (steps > 2.0 * SPEED_WINDOW_S) & (moved <= STANDSTILL_M_S * reach)
    elif "speed_m_s" in columns:
        speeds = np.nan_to_num(columns["speed_m_s"], nan=np.inf)
        stands = (steps > MAX_STEP_S) & (np.maximum(speeds[1:], speeds[:-1]) <= STANDSTILL_M_S)
    else:
        stands = np.zeros(steps.size, dtype=np.bool_)
    gone_on = (steps > MAX_STEP_S) & ~stands
    if gone_on.any():
        row = int(np.argmax(gone_on)) + 1
        raise RouteError(
            f"{table.at(row)}, column time_s: value {times[row]:.12g}, {steps[row - 1]:g} s after the one "
            f"before; allowed: more than 0 and up to {MAX_STEP_S:g} s, or a pause at one place"
        )
    long = (steps > max(_TOLD_GAP_S, 10.0 * usual_step_s(times))) & ~stands
    if long.any():
        row = int(np.argmax(np.where(long, steps, 0.0)))
        what = f"{counted(int(long.sum()), 'gap')} of up to {steps[row]:.3g} s while driving"
        table = noted(
            table, f"{what}, at {table.counted} {table.rows[row + 1]}: evenly interpolated"
        )
    if not stands.any():
        return table
    pause_s = float(steps[stands].sum())
    table = noted(
        table,
        f"{counted(int(stands.sum()), 'pause')} of {pause_s:.4g} s"
        + (f", {float(reach[stands].sum()):.4g} s kept" if pause_s > reach[stands].sum() else ""),
    )
    moved_times = times - np.concatenate([[0.0], np.cumsum(np.where(stands, steps - reach, 0.0))])
    count = np.where(stands, np.ceil(reach).astype(np.int64) - 1, 0)
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
        with_columns(table, **filled),
        rows=np.insert(table.rows, at + 1, table.rows[at]),
        received_s=None,
    )


def _speeds_filled(table: DriveTable) -> DriveTable:
    """Fill speeds that are missing from places, else from the rows beside them."""
    times, plane = table.columns["time_s"], plane_of(table)
    has_places = plane is not None and bool(np.isfinite(plane).all())
    speeds = table.columns.get("speed_m_s")
    if speeds is None:
        if plane is None or not has_places:
            raise RouteError(
                f"{table.source}: it states neither speeds nor places; allowed: one of them, or both"
            )
        if "latitude_deg" in table.columns:
            return table
        return with_columns(table, speed_m_s=_speeds_of(plane, times, times))
    missing = np.isnan(speeds)
    if not missing.any():
        return table
    known = np.flatnonzero(~missing)
    if plane is not None and has_places:
        speeds = speeds.copy()
        speeds[missing] = _speeds_of(plane, times, times[missing])
        return with_columns(table, speed_m_s=speeds)
    gaps = np.diff(times[known])
    if gaps.size and gaps.max() > MAX_STEP_S:
        row = int(known[int(np.argmax(gaps)) + 1])
        raise RouteError(
            f"{table.at(row)}: no speed for {gaps.max():g} s; allowed: up to {MAX_STEP_S:g} s"
        )
    table = with_columns(table, speed_m_s=np.interp(times, times[known], speeds[known]))
    inside = (np.arange(times.size) >= known[0]) & (np.arange(times.size) <= known[-1])
    return from_zero(kept(table, inside))


def _speeds_of(plane: FloatArray, times: FloatArray, at: FloatArray) -> FloatArray:
    """Return speeds of places at some times, as slopes of local lines."""
    east, north = (local_line(times, plane[:, axis], at, SPEED_WINDOW_S)[1] for axis in (0, 1))
    speeds = np.hypot(east, north)
    return np.where(speeds < STANDSTILL_M_S, 0.0, speeds)
