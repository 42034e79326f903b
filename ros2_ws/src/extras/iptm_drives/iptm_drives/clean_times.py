"""Clocks and times of a drive: set back or ahead, begun again, missing, repeated, late, or of two senders.

A repair sorts rows, moves times, or leaves rows out, and is noted.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable, counted, lengths
from iptm_core.routes.user_csv import MAX_STEP_S
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


_FEW_LATE_ROWS = 2
_SHORTEST_USUAL_STEP_S = 5e-5
_MOST_PER_TIME = 10
_APART = {"place": 5.0, "speed": 2.0}
"""Metres or m/s between rows that turn back at once, for them to be of two senders."""
_SHARE_OF_ANOTHER_SENDER = 0.05
_MOST_ROWS_LEFT_OUT = 0.2


def in_order(table: DriveTable) -> DriveTable:
    """Return a table whose times increase, from 0 on.

    Raises:
        RouteError: no row has a time, the clock was set back, or the rows are of two senders.
    """
    times = table.columns["time_s"]
    timed = np.isfinite(times)
    if not timed.any():
        raise RouteError(
            f"{table.source}: {times.size} {table.counted}s with a time; allowed: 2 or more"
        )
    table = table.kept(timed, "without a time left out")
    if (usual_s := usual_step_s(table.columns["time_s"])) > MAX_STEP_S:
        unit = next((name for name, least_s in _COUNTED if usual_s >= least_s), "")
        raise _of_other_times(table, usual_s, unit)
    table = with_one_clock(table)
    table = _without_copies(table)
    _refuse_two_senders(table)
    table = _merged(_without_late_rows(table))
    if 0.0 < (usual_s := usual_step_s(table.columns["time_s"])) < _SHORTEST_USUAL_STEP_S:
        raise _of_other_times(table, usual_s, "days")
    return table.from_zero()


_COUNTED = (("ns", 1e7), ("us", 1e4), ("ms", 100.0))
"""Units of times that are counts, and steps from which times are taken to be in them."""


def _of_other_times(table: DriveTable, usual_s: float, unit: str) -> RouteError:
    hint = f"; are they in {unit}?" if unit else ""
    return RouteError(
        f"{table.source}: rows are {usual_s:.6g} s apart{hint}; allowed: times in s, steps of up to "
        f"{MAX_STEP_S:g} s"
    )


def _without_copies(table: DriveTable) -> DriveTable:
    """Leave out rows that repeat an earlier one with its time, as logs do that overlap."""
    times = table.columns["time_s"]
    if not (np.diff(times) <= 0.0).any():
        return table
    rows = np.column_stack(list(table.columns.values()))
    _, first = np.unique(np.nan_to_num(rows, nan=-1.25e300), axis=0, return_index=True)
    keep = np.zeros(times.size, dtype=np.bool_)
    keep[first] = True
    return table.kept(keep, "repeated word for word, left out")


def _refuse_two_senders(table: DriveTable) -> None:
    """Refuse rows of which every few jump aside and back, as with two vehicles on one topic."""
    speeds = table.columns.get("speed_m_s")
    beside = None if speeds is None else np.column_stack([speeds, np.zeros(speeds.size)])
    for kind, rows, unit in (("place", table.plane(), "m"), ("speed", beside, "m/s")):
        if rows is None:
            continue
        known = np.flatnonzero(np.isfinite(rows).all(axis=1))
        there = lengths(np.diff(rows[known], axis=0))
        aside = np.minimum(there[:-1], there[1:])
        turns = aside > _APART[kind] + 2.0 * lengths(rows[known][2:] - rows[known][:-2])
        count = np.count_nonzero(turns)
        if known.size >= 20 and count > _SHARE_OF_ANOTHER_SENDER * known.size:
            row = int(known[int(np.argmax(turns)) + 1])
            value = (
                f" to {rows[row, 0] / table.named('speed_m_s')[1]:.6g}" if kind == "speed" else ""
            )
            raise RouteError(
                f"{table.at(row)}: {kind} jumps{value} by {aside[turns].mean():.3g} {unit} and back at "
                f"{count} of {known.size} {table.counted}s: two senders in one recording, "
                "or a clock that was set back; allowed: one sender, one clock"
            )


def _without_late_rows(table: DriveTable) -> DriveTable:
    times = table.columns["time_s"]
    if not (np.diff(times) < 0.0).any():
        return table
    keep = _longest_order(times)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], ~keep, [0]])))
    for first, end in edges.reshape(-1, 2):
        if end - first > _FEW_LATE_ROWS or _lags_behind(times, int(first), int(end)):
            keep[first:end] = True  # no odd rows, but a clock that was set
        elif end - first == 1:
            keep[[first, _odder(times, int(first))]] = True, False
    if np.count_nonzero(~keep) > max(_FEW_LATE_ROWS, _MOST_ROWS_LEFT_OUT * times.size):
        raise set_back_refused(table, times, int(np.argmax(~keep)))
    return clock_set_back(table.kept(keep, "out of order left out"))


def _lags_behind(times: FloatArray, first: int, end: int) -> bool:
    """Return whether late rows of an even series lag behind for good, as after a clock was set."""
    usual_s, begin, last = usual_step_s(times), max(first - 2, 0), min(end + 2, times.size - 1)
    back_s = float(-np.diff(times[begin : last + 1]).min())
    even = np.mean(np.abs(np.diff(times) - usual_s) < 0.1 * usual_s) > 0.8
    return bool(
        even and usual_s * (last - begin) - (times[last] - times[begin]) > 0.5 * back_s + usual_s
    )


def _odder(times: FloatArray, row: int) -> int:
    """Return which row of two in the wrong order, one of which is given, fits worse between those around."""
    before = row - 1 if row and times[row] < times[row - 1] else row
    if not 0 < before < times.size - 2:
        return row
    begin, end = times[before - 1], times[before + 2]
    off = np.abs(times[before : before + 2] - begin - (end - begin) * np.array([1.0, 2.0]) / 3.0)
    return before + int(np.argmax(off)) if end >= begin else row


def _longest_order(times: FloatArray) -> NDArray[np.bool_]:
    """Return which rows are in the longest sequence whose times do not decrease."""
    ends: list[float] = []
    last: list[int] = []
    before = np.full(times.size, -1)
    for row, time in enumerate(times.tolist()):
        length = bisect_right(ends, time)
        before[row] = last[length - 1] if length else -1
        ends[length : length + 1] = [time]
        last[length : length + 1] = [row]
    keep = np.zeros(times.size, dtype=np.bool_)
    row = last[-1]
    while row >= 0:
        keep[row] = True
        row = int(before[row])
    return keep


def _merged(table: DriveTable) -> DriveTable:
    """Make one row of those with one time: the first value of each quantity counts."""
    times = table.columns["time_s"]
    first = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0.0)
    count = first.size
    if count == times.size:
        return table
    if count < 3 and times.size > _MOST_PER_TIME:
        raise RouteError(
            f"{table.source}: {times.size} {table.counted}s have {count} different times, such as "
            f"{times[0]:.12g} s; allowed: times that increase"
        )
    merged: dict[str, FloatArray] = {}
    for name, values in table.columns.items():
        known = np.append(np.flatnonzero(np.isfinite(values)), -1)
        next_known = known[np.searchsorted(known[:-1], first)]
        same_time = times[next_known] == times[first]
        merged[name] = np.where(same_time, values[next_known], np.nan)
    repeated = replace(table, columns=merged, rows=table.rows[first], received_s=None)
    if table.sparse:
        return repeated
    lost = table.count(times.size - count)
    return repeated.noted(f"{lost} with the time of another one left out")
