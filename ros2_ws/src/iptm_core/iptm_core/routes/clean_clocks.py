"""Clocks of a drive: set back or ahead while it was recorded, begun again, or in rows of another order.

A repair sorts rows, moves times, or leaves rows out, and is noted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable, counted, lengths
from iptm_core.state import FloatArray

MAX_CLOCK_STEP_S = 10.0
"""A clock set back by more cannot be distinguished from another recording."""
_LONGEST_JUMP_S = 5.0
_SCATTERED, _MUCH_LESS, _MOST_TRIPS = 0.05, 0.6, 0.1
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
    return _last_trip(_by_receipt(_unwrapped(_sorted(table))))


def usual_step_s(times: FloatArray) -> float:
    """Return the median of the steps forward."""
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if forward.size else 0.0


def _sorted(table: DriveTable) -> DriveTable:
    """Sort rows that are not in the order of their times, if they follow each other in that order."""
    times = table.columns["time_s"]
    steps = np.diff(times)
    if table.received_s is not None or not (steps < 0.0).any():
        return table
    order = np.argsort(times, kind="stable")
    # Parts of one drive follow each other without a gap.
    seams = np.flatnonzero(np.diff(order) != 1)
    gaps = np.diff(times[order])[seams]
    in_parts = (
        np.count_nonzero(steps < -MAX_CLOCK_STEP_S) == seams.size
        and ((gaps > 0.0) & (gaps <= 3.0 * usual_step_s(times))).all()
    )
    # Of few parts, each may be a recording of one and the same drive.
    is_scattered = np.count_nonzero(steps < 0.0) > _SCATTERED * times.size
    if in_parts or (is_scattered and (not (steps > 0.0).any() or _goes_on(table, order))):
        words = f"{table.counted}s are not in the order of their times: sorted"
        return table.in_rows(order).noted(words)
    return table


def _goes_on(table: DriveTable, order: NDArray[np.int64]) -> bool:
    """Return whether places, or else speeds, change much less from row to row in another order."""
    values, times = table.plane(), table.columns["time_s"]
    if values is None and "speed_m_s" in table.columns:
        values = table.columns["speed_m_s"][:, np.newaxis]
    if values is None:
        return False
    rows = order[np.isfinite(values[order]).all(axis=1)]
    changes = [np.abs(np.diff(values[each], axis=0)).sum() for each in (rows, np.sort(rows))]
    return bool((np.diff(times[rows]) > 0.0).all() and changes[0] < _MUCH_LESS * changes[1])


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
    steps, waits, usual_s = np.diff(times), np.diff(received), usual_step_s(times)
    ahead = (steps > max(_LONGEST_JUMP_S, 20.0 * usual_s)) & (waits < 0.25 * steps)
    jumps = (steps < -1.0) | ahead
    is_still = not steps.any()
    went_on_s, waited_s = steps[~jumps].sum(), waits[~jumps].sum()
    same_pace = is_still or abs(waited_s - went_on_s) <= max(1.0, 0.2 * abs(went_on_s))
    goes_on = (waits >= 0.0).all() and waits.any() and same_pace
    if not (jumps.any() or is_still) or not goes_on or _begins_again(table, steps):
        return table
    cause = f"all stamps are {times[0]:g} s"
    if not is_still:
        row = int(np.argmax(jumps)) + 1
        by = f"{steps[row - 1] - usual_s:+.6g} s at {table.counted} {table.rows[row]}"
        cause = f"the clock of the stamps is set by {by}"
    return table.having(time_s=received).noted(f"{cause}: the times of receipt are used")


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
    if begins.size > _MOST_TRIPS * times.size:
        raise RouteError(
            f"{table.source}: the stamps step back {begins.size} times in {table.count(times.size)}: the "
            "clocks of sender and recorder were set; allowed: one of them, or one for each trip"
        )
    before = float(times[: begins[-1]].max() - times[: begins[-1]].min())
    note = f"{counted(begins.size, 'earlier trip')} of {before:.4g} s left out (the clock begins again)"
    keep = np.arange(times.size) >= begins[-1]
    return table.kept(keep).noted(note)


def clock_set_back(table: DriveTable) -> DriveTable:
    """Move the times behind a clock that was set back by seconds; sort blocks that were written late."""
    times, notes = table.columns["time_s"].copy(), []
    usual_s = usual_step_s(times)
    while (back := np.flatnonzero(np.diff(times) < 0.0)).size:
        row = int(back[0]) + 1
        by_s = float(times[row - 1] - times[row])
        late = np.flatnonzero(times[row:] >= times[row - 1])
        if by_s > MAX_CLOCK_STEP_S or not late.size:
            raise set_back_refused(table, times, row)
        end = row + int(late[0])
        jumps = np.diff(times[: end + 1]) > 3.0 * usual_s + 1e-6
        came_ahead = jumps[max(0, row - 3 - int(by_s / usual_s)) : row - 1].any()
        if came_ahead and jumps[row:].any():
            order = np.argsort(times, kind="stable")
            table, times = table.in_rows(order), times[order]
            notes.append(f"{table.count(end - row)} written late and sorted")
        else:
            times[row:] += by_s + usual_s
            where = f"{table.counted} {table.rows[row]}"
            notes.append(f"clock set back by {by_s:.3g} s at {where}: the times after it are moved")
    return table.having(time_s=times).noted(*notes)


def set_back_refused(table: DriveTable, times: FloatArray, row: int) -> RouteError:
    """Return the error for a row whose time is before an earlier one."""
    first = max(row, 1)
    by_s = times[:first].max() - times[first]
    return RouteError(
        f"{table.at(first)}: time is {by_s:.6g} s before an earlier one: another recording begins, or the "
        f"clock was set back; allowed: one recording, a clock set back by up to {MAX_CLOCK_STEP_S:g} s"
    )
