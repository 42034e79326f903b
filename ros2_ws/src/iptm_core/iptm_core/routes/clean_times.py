"""Times of a drive: missing, repeated and late ones, and rows of two senders.

A repair moves times or leaves rows out, and is noted; see `iptm_core.routes.clean_clocks`, too.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.clean_clocks import (
    clock_set_back,
    set_back_refused,
    usual_step_s,
    with_one_clock,
)
from iptm_core.routes.drive_table import DriveTable, lengths
from iptm_core.state import FloatArray

MAX_STEP_S = 60.0
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
        raise _of_other_times(table, usual_s, "ms" if usual_s >= 100.0 else "")
    table = with_one_clock(table)
    table = _without_copies(table)
    _refuse_two_senders(table)
    table = _merged(_without_late_rows(table))
    if 0.0 < (usual_s := usual_step_s(table.columns["time_s"])) < _SHORTEST_USUAL_STEP_S:
        raise _of_other_times(table, usual_s, "days")
    return table.from_zero()


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
            raise RouteError(
                f"{table.at(row)}: {kind} jumps by {aside[turns].mean():.3g} {unit} and back at "
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
