"""Clocks of a drive: set back or ahead while it was recorded, begun again, or in rows from new to old.

Rows keep the order in which they were written; a repair moves times, or leaves rows out, and is noted.
"""

from __future__ import annotations

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable, counted, lengths
from iptm_core.state import FloatArray

MAX_CLOCK_STEP_S = 10.0
"""A clock set back by more cannot be distinguished from another recording."""
_LONGEST_JUMP_S = 5.0
_DAY_S, _WEEK_S = 86400.0, 604800.0
_LONGEST_PAUSE_S = 100.0 * _WEEK_S
_PERIODS = {
    3600.0: "a change of summer time",
    0.5 * _DAY_S: "noon, by a clock of 12 hours",
    _WEEK_S: "the end of a week",
    1024.0 * _WEEK_S: "a rollover of 1024 weeks",
    2.0**32 * 1e-3: "the largest number of ms",
    2.0**32 * 1e-6: "the largest number of us",
}
"""After which clocks begin again, besides days."""


def with_one_clock(table: DriveTable) -> DriveTable:
    """Return a table whose clock goes on: the last trip of several in a bag, by one clock."""
    return _last_trip(_by_receipt(_unwrapped(_oldest_first(table))))


def usual_step_s(times: FloatArray) -> float:
    """Return the median of the steps forward."""
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if forward.size else 0.0


def _oldest_first(table: DriveTable) -> DriveTable:
    """Turn rows, or parts, around that stand in the order from new to old."""
    times = table.columns["time_s"]
    steps, usual_s = np.diff(times), usual_step_s(times)
    if table.received_s is not None or not (steps < 0.0).any():
        return table
    if not (steps > 0.0).any():
        turned = table.in_rows(np.arange(times.size)[::-1])
        return turned.noted(f"{table.counted}s are in the order from new to old: turned around")
    order = np.argsort(times, kind="stable")
    parts = np.flatnonzero(steps < -MAX_CLOCK_STEP_S).size + 1
    # Parts of one drive follow each other without a gap.
    seams = np.flatnonzero(np.diff(order) != 1)
    gaps = np.diff(times[order])[seams]
    if 1 < parts == seams.size + 1 and (gaps > 0.0).all() and (gaps <= 3.0 * usual_s).all():
        return table.in_rows(order).noted(
            f"{parts} parts are not in the order of their times: sorted"
        )
    return table


def _unwrapped(table: DriveTable) -> DriveTable:
    """Let times go on where the clock begins again."""
    times = table.columns["time_s"]
    steps, usual_s = np.diff(times), usual_step_s(times)
    shifts, notes = np.zeros(times.size), []
    midnights = steps < -0.5 * _DAY_S
    if midnights.any() and times.min() >= 0.0 and times.max() <= _DAY_S:
        is_noon = np.abs(steps + 0.5 * _DAY_S) < 3.0 * usual_s
        shifts[1:] += _DAY_S * np.cumsum(midnights & ~is_noon)
        notes += ["times go on past midnight"] if (midnights & ~is_noon).any() else []
    for period_s, words in _PERIODS.items():
        back = np.abs(steps + period_s - usual_s) <= 2.0 * usual_s
        # An hour ahead may be a pause; twenty years are none.
        ahead = (period_s > _LONGEST_PAUSE_S) & (np.abs(steps - period_s) <= 3.0 * usual_s)
        if (back | ahead).any():
            shifts[1:] += period_s * np.cumsum(back.astype(np.int64) - ahead)
            notes.append(f"times go on past {words}")
    if not notes:
        return table
    return table.having(time_s=times + shifts).noted(*notes)


def _by_receipt(table: DriveTable) -> DriveTable:
    """Return a table with the times of receipt where only the sender's times jump."""
    times, received = table.columns["time_s"], table.received_s
    if received is None or times.size < 3:
        return table
    steps, waits = np.diff(times), np.diff(received)
    usual_s, usual_wait_s = usual_step_s(times), usual_step_s(received)
    ahead = (steps > max(_LONGEST_JUMP_S, 20.0 * usual_s)) & (waits < 0.25 * steps)
    jumps = (steps < -1.0) | ahead
    is_still = times.max() == times.min()
    if not (jumps.any() or is_still):
        return table
    sound = ~jumps
    same_pace = is_still or abs(waits[sound].sum() - steps[sound].sum()) <= max(
        1.0, 0.2 * abs(steps[sound].sum())
    )
    if usual_wait_s <= 0.0 or (waits < 0.0).any() or not same_pace or _begins_again(table, steps):
        return table
    first = int(np.argmax(jumps))
    where = f"{table.counted} {table.rows[first + 1]}"
    cause = (
        f"all stamps are {times[0]:g} s"
        if is_still
        else f"the clock of the stamps is set by {steps[first] - usual_s:+.6g} s at {where}"
    )
    note = f"{cause}: the times of receipt are used"
    return table.having(time_s=received).noted(note)


def _begins_again(table: DriveTable, steps: FloatArray) -> bool:
    """Return whether the vehicle is elsewhere where the clock steps back: another trip begins."""
    plane = table.plane()
    if plane is None:
        return True
    moved = lengths(np.diff(plane, axis=0))
    return bool((moved[steps < -1.0] > 20.0 + 5.0 * float(np.nanmedian(moved))).any())


def _last_trip(table: DriveTable) -> DriveTable:
    """Return the last of several trips in a bag, each with a clock that begins again."""
    times = table.columns["time_s"]
    begins = np.flatnonzero(np.diff(times) < -MAX_CLOCK_STEP_S) + 1
    if table.received_s is None or not begins.size:
        return table
    before = float(times[: begins[-1]].max() - times[: begins[-1]].min())
    note = f"{counted(begins.size, 'earlier trip')} of {before:.4g} s left out (the clock begins again)"
    keep = np.arange(times.size) >= begins[-1]
    return table.kept(keep).noted(note)


def clock_set_back(table: DriveTable) -> DriveTable:
    """Move the times behind a clock that was set back by seconds; sort blocks that were written late."""
    times = table.columns["time_s"].copy()
    usual_s = usual_step_s(times)
    notes: list[str] = []
    while (back := np.flatnonzero(np.diff(times) < 0.0)).size:
        row = int(back[0]) + 1
        by_s = float(times[row - 1] - times[row])
        late = np.flatnonzero(times[row:] >= times[row - 1])
        end = row + int(late[0]) if late.size else times.size
        jumps = np.diff(times[row : end + 1]) > 3.0 * usual_s + 1e-6
        came_ahead = row > 1 and bool(
            (np.diff(times[:row])[-int(by_s / usual_s) - 2 :] > 3.0 * usual_s).any()
        )
        if by_s > MAX_CLOCK_STEP_S or not late.size:
            raise set_back_refused(table, times, row)
        if jumps.any() and came_ahead:
            order = np.argsort(times, kind="stable")
            table, times = table.in_rows(order), times[order]
            notes.append(f"{table.count(end - row)} written late and sorted")
        else:
            times[row:] += by_s + usual_s
            where = f"{table.counted} {table.rows[row]}"
            notes.append(f"clock set back by {by_s:.3g} s at {where}: the times after it are moved")
    table = table.having(time_s=times)
    return table.noted(*notes)


def set_back_refused(table: DriveTable, times: FloatArray, row: int) -> RouteError:
    """Return the error for a row whose time is before an earlier one."""
    first = max(row, 1)
    by_s = times[:first].max() - times[first]
    return RouteError(
        f"{table.at(first)}: time is {by_s:.6g} s before an earlier one: another recording begins, or the "
        f"clock was set back; allowed: one recording, a clock set back by up to {MAX_CLOCK_STEP_S:g} s"
    )
