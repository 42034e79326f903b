"""Times of a drive: missing, repeated and late ones, a clock that was set, several trips or senders in one.

Rows keep the order in which they were written; a repair moves times or leaves rows out, and is noted.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.road_line import east_north_m
from iptm_core.state import FloatArray

MAX_STEP_S = 60.0
MAX_CLOCK_STEP_S = 10.0
"""A clock that is set back by more is told from another recording by nothing."""
_FEW_LATE_ROWS = 2
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
    table = kept(table, timed, "without a time left out")
    if (usual_s := usual_step_s(table.columns["time_s"])) > MAX_STEP_S:
        raise _of_other_times(table, usual_s, "ms" if usual_s >= 100.0 else "")
    table = _last_trip(_by_receipt(_unwrapped(_oldest_first(table))))
    table = _without_copies(table)
    _refuse_two_senders(table)
    table = _merged(_without_late_rows(table))
    if 0.0 < (usual_s := usual_step_s(table.columns["time_s"])) < _SHORTEST_USUAL_STEP_S:
        raise _of_other_times(table, usual_s, "days")
    return from_zero(table)


def _of_other_times(table: DriveTable, usual_s: float, unit: str) -> RouteError:
    hint = f"; are they in {unit}?" if unit else ""
    return RouteError(
        f"{table.source}: rows are {usual_s:.6g} s apart{hint}; allowed: times in s, steps of up to "
        f"{MAX_STEP_S:g} s"
    )


def kept(table: DriveTable, keep: NDArray[np.bool_], note: str = "") -> DriveTable:
    """Return the rows that are kept; the others are counted in a note, if there is one."""
    lost = int(np.count_nonzero(~keep))
    if not lost:
        return table
    received = None if table.received_s is None else table.received_s[keep]
    columns = {name: values[keep] for name, values in table.columns.items()}
    table = replace(table, columns=columns, rows=table.rows[keep], received_s=received)
    return noted(table, f"{counted(lost, table.counted)} {note}") if note else table


def counted(count: int, what: str) -> str:
    """Return a count with its noun."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def noted(table: DriveTable, note: str) -> DriveTable:
    """Return a table with one more note."""
    return replace(table, notes=(*table.notes, note))


def with_columns(table: DriveTable, **columns: FloatArray | None) -> DriveTable:
    """Return a table with other columns; None removes one."""
    merged = {**table.columns, **columns}
    return replace(table, columns={name: each for name, each in merged.items() if each is not None})


def from_zero(table: DriveTable) -> DriveTable:
    """Return a table whose times begin at 0."""
    times = table.columns["time_s"]
    return with_columns(table, time_s=times - times[0])


def plane_of(table: DriveTable) -> FloatArray | None:
    """Return places in a plane, shape (n, 2), NaN where there is none; None without any."""
    columns = table.columns
    if "latitude_deg" in columns:
        latitudes = columns["latitude_deg"]
        longitudes = columns["longitude_deg"]
        known = np.flatnonzero(np.isfinite(latitudes) & np.isfinite(longitudes))
        if not known.size:
            return None
        origin = (latitudes[known[0]], longitudes[known[0]])
        # Across the date line the nearer way counts.
        nearer = (longitudes - origin[1] + 180.0) % 360.0 - 180.0 + origin[1]
        return np.column_stack(east_north_m(latitudes, nearer, origin))
    if "east_m" in columns:
        return np.column_stack([columns["east_m"], columns["north_m"]])
    if "position_m" in columns:
        return np.column_stack([columns["position_m"], np.zeros(columns["position_m"].size)])
    return None


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors, shape (n, 2)."""
    result: FloatArray = np.hypot(vectors[:, 0], vectors[:, 1])
    return result


def usual_step_s(times: FloatArray) -> float:
    """Return the median of the steps forward."""
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if forward.size else 0.0


def _in_rows(table: DriveTable, order: NDArray[np.int64]) -> DriveTable:
    columns = {name: values[order] for name, values in table.columns.items()}
    return replace(table, columns=columns, rows=table.rows[order])


def _oldest_first(table: DriveTable) -> DriveTable:
    """Turn rows, or parts, around that stand in the order from new to old."""
    times = table.columns["time_s"]
    steps, usual_s = np.diff(times), usual_step_s(times)
    if table.received_s is not None or not (steps < 0.0).any():
        return table
    if not (steps > 0.0).any():
        turned = _in_rows(table, np.arange(times.size)[::-1])
        return noted(turned, f"{table.counted}s are in the order from new to old: turned around")
    order = np.argsort(times, kind="stable")
    parts = np.flatnonzero(steps < -MAX_CLOCK_STEP_S).size + 1
    # Parts of one drive follow each other without a gap.
    seams = np.flatnonzero(np.diff(order) != 1)
    gaps = np.diff(times[order])[seams]
    if 1 < parts == seams.size + 1 and (gaps > 0.0).all() and (gaps <= 3.0 * usual_s).all():
        return noted(
            _in_rows(table, order), f"{parts} parts are not in the order of their times: sorted"
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
    return replace(with_columns(table, time_s=times + shifts), notes=(*table.notes, *notes))


def _by_receipt(table: DriveTable) -> DriveTable:
    """Return a table with the times of receipt where those of the sender jump and these do not."""
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
    return noted(with_columns(table, time_s=received), note)


def _begins_again(table: DriveTable, steps: FloatArray) -> bool:
    """Return whether the vehicle is elsewhere where the clock steps back: another trip begins."""
    plane = plane_of(table)
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
    return noted(kept(table, keep), note)


def _without_copies(table: DriveTable) -> DriveTable:
    """Leave out rows that repeat an earlier one with its time, as logs do that overlap."""
    times = table.columns["time_s"]
    if not (np.diff(times) <= 0.0).any():
        return table
    rows = np.column_stack(list(table.columns.values()))
    _, first = np.unique(np.nan_to_num(rows, nan=-1.25e300), axis=0, return_index=True)
    keep = np.zeros(times.size, dtype=np.bool_)
    keep[first] = True
    return kept(table, keep, "repeated word for word, left out")


def _refuse_two_senders(table: DriveTable) -> None:
    """Refuse rows of which every few jump aside and back, as those of two vehicles on one topic do."""
    plane, speeds = plane_of(table), table.columns.get("speed_m_s")
    values = {
        "place": plane,
        "speed": None if speeds is None else np.column_stack([speeds, np.zeros(speeds.size)]),
    }
    for kind, unit in (("place", "m"), ("speed", "m/s")):
        rows = values[kind]
        if rows is None:
            continue
        known = np.flatnonzero(np.isfinite(rows).all(axis=1))
        rows = rows[known]
        if known.size < 20:
            continue
        there, back = lengths(np.diff(rows, axis=0)), lengths(rows[2:] - rows[:-2])
        aside = np.minimum(there[:-1], there[1:])
        turns = aside > _APART[kind] + 2.0 * back
        if np.count_nonzero(turns) > _SHARE_OF_ANOTHER_SENDER * known.size:
            row = int(known[int(np.argmax(turns)) + 1])
            raise RouteError(
                f"{table.at(row)}: {kind} jumps by {aside[turns].mean():.3g} {unit} and back at "
                f"{np.count_nonzero(turns)} of {known.size} {table.counted}s: two senders in one recording; "
                "allowed: one"
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
        raise _set_back(table, times, int(np.argmax(~keep)))
    return _clock_set_back(kept(table, keep, "out of order left out"))


def _lags_behind(times: FloatArray, first: int, end: int) -> bool:
    """Return whether late rows of an even series lag behind for good, as those of a clock that was set do."""
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


def _clock_set_back(table: DriveTable) -> DriveTable:
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
            raise _set_back(table, times, row)
        if jumps.any() and came_ahead:
            order = np.argsort(times, kind="stable")
            table, times = _in_rows(table, order), times[order]
            notes.append(f"{counted(end - row, table.counted)} written late and sorted")
        else:
            times[row:] += by_s + usual_s
            where = f"{table.counted} {table.rows[row]}"
            notes.append(f"clock set back by {by_s:.3g} s at {where}: the times after it are moved")
    table = with_columns(table, time_s=times)
    return replace(table, notes=(*table.notes, *notes))


def _set_back(table: DriveTable, times: FloatArray, row: int) -> RouteError:
    first = max(row, 1)
    by_s = times[:first].max() - times[first]
    return RouteError(
        f"{table.at(first)}: time is {by_s:.6g} s before an earlier one: another recording begins, or the "
        f"clock was set back; allowed: one recording, a clock set back by up to {MAX_CLOCK_STEP_S:g} s"
    )


def _merged(table: DriveTable) -> DriveTable:
    """Make one row of those with one time: the first value of each quantity counts."""
    times = table.columns["time_s"]
    group = np.cumsum(np.concatenate([[True], np.diff(times) > 0.0])) - 1
    count = int(group[-1]) + 1
    if count == times.size:
        return table
    if count < 3 and times.size > _MOST_PER_TIME:
        raise RouteError(
            f"{table.source}: {times.size} {table.counted}s have {count} different times, such as "
            f"{times[0]:.12g} s; allowed: times that increase"
        )
    first = np.flatnonzero(np.diff(group, prepend=-1))
    merged: dict[str, FloatArray] = {}
    for name, values in table.columns.items():
        merged[name] = np.full(count, np.nan)
        known = np.flatnonzero(np.isfinite(values))
        groups, index = np.unique(group[known], return_index=True)
        merged[name][groups] = values[known[index]]
    repeated = replace(table, columns=merged, rows=table.rows[first], received_s=None)
    if table.sparse:
        return repeated
    lost = counted(times.size - count, table.counted)
    return noted(repeated, f"{lost} with the time of another one left out")
