"""Speeds and places of a drive: what is not plausible costs that value; each is compared with the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import cumulative_integral
from iptm_core.routes.drive_table import DriveTable, lengths
from iptm_core.routes.road_line import MAX_LATITUDE_DEG
from iptm_core.routes.user_csv import MAX_SPEED_M_S
from iptm_core.state import FloatArray
from iptm_drives.cells import MOST_INVALID
from iptm_drives.clean_places import (
    LONGEST_OUTLIER_S,
    PLACES,
    cleaned_places,
    consistent,
)
from iptm_drives.contradictions import distances, factors_near, windows

MAX_ACCELERATION_M_S2 = 12.0
_NOISE_M_S = 1.5
_MAX_REVERSING_M_S, _NOTED_REVERSING_M_S = 3.0, 0.3
_STILL_M = 10.0
_TOLD_RATIO = 0.05
_LONGEST_LAG_S = 6
_SAME_COURSE = 0.8
"""Cosine between two series, from which on they are of one quantity."""
_MOVES_M_S, _SLOWEST_CHANGE_M_S2 = 5.0, 0.006
"""No car that reaches the former changes its speed by less than the latter all the time."""


def cleaned_motion(table: DriveTable) -> DriveTable:
    """Return a table whose places are all known and whose speeds are plausible, NaN where they were not.

    Raises:
        RouteError: a jump that does not come back, a car that reverses, or two sources that contradict.
    """
    table = _speeds_against_places(cleaned_places(_scaled_places(_marked(table))))
    return _speeds_against_accelerations(_speeds(table))


def _marked(table: DriveTable) -> DriveTable:
    """Take values for missing that only mark a quantity as not measured."""
    columns = table.columns
    if "latitude_deg" in columns:
        places = np.column_stack([columns["latitude_deg"], columns["longitude_deg"]])
        no_fix = (np.abs(places) > (MAX_LATITUDE_DEG, 180.0)).any(axis=1)
        at_zero = (places == 0.0).all(axis=1)
        if at_zero.mean() < 0.5 and np.nanmax(np.abs(places[:, 0])) > 1.0:
            no_fix |= at_zero
        if no_fix.mean() > MOST_INVALID:
            raise table.refuse(int(np.argmax(no_fix)), "latitude_deg", "places of a drive on Earth")
        places[no_fix] = np.nan
        table = table.having(latitude_deg=places[:, 0], longitude_deg=places[:, 1])
    if "speed_m_s" not in columns:
        return table
    speeds = columns["speed_m_s"]
    name, unit = table.named("speed_m_s")
    below = np.unique(np.round(speeds[speeds < 0.0] / unit, 6))
    if below.size != 1 or -99.0 < below[0] != -1.0 or not (speeds > 0.0).any():
        return table
    note = f"{name} is {below[0]:g} at {table.count(np.count_nonzero(speeds < 0.0))}: not measured"
    return table.having(speed_m_s=np.where(speeds < 0.0, np.nan, speeds)).noted(note)


def _scaled_places(table: DriveTable) -> DriveTable:
    """Scale places in a plane of which only a thousandth, or a thousand, fits to speeds of a car."""
    plane, speeds, times = table.plane(), table.columns.get("speed_m_s"), table.columns["time_s"]
    if plane is None or speeds is None or "latitude_deg" in table.columns or times.size < 3:
        return table
    known = np.isfinite(speeds) & np.isfinite(plane).all(axis=1)
    if known.sum() < 3 or not _MOVES_M_S <= np.abs(speeds[known]).max() <= MAX_SPEED_M_S:
        return table
    named = distances(times[known], speeds[known], plane[known]).named_factor()
    if named is None or 0.01 < named[0] < 100.0:
        return table
    scaled = {name: table.columns[name] * named[0] for name in PLACES if name in table.columns}
    return table.having(**scaled).noted(f"places are multiplied by {named[0]:g}, by the speeds")


def _speeds_against_places(table: DriveTable) -> DriveTable:
    """Compare speeds with places over the trip, and let the one that was measured count."""
    plane, times = table.plane(), table.columns["time_s"]
    if (
        plane is None
        or "speed_m_s" not in table.columns
        or times.size < 3
        or not np.isfinite(plane).all()
    ):
        return table
    raw = table.columns["speed_m_s"]
    known = np.flatnonzero(np.isfinite(raw))
    speeds = np.interp(times, times[known], raw[known])
    found = distances(times, speeds, plane)
    if abs(found.ratio - 1.0) > _TOLD_RATIO and (turned := _turned(table, speeds)) is not None:
        return turned
    moved_m, driven_m = float(found.second.sum()), float(found.first.sum())
    both = f"{1e-3 * driven_m:.2f} km by its speeds, {1e-3 * moved_m:.2f} km by its places"
    if max(moved_m, driven_m) < _STILL_M:
        return table
    if found.agrees() or (0.8 < found.ratio < 1.25 and found.agrees(found.ratio)):
        if abs(found.ratio - 1.0) > _TOLD_RATIO:
            table = table.noted(f"{both}: the speeds count")
        return _windows_apart(table, plane, speeds)
    if abs(found.ratio - 1.0) < _TOLD_RATIO and (late_s := _lag_s(times, speeds, plane)):
        return table.noted(
            f"speeds are {abs(late_s)} s {'behind' if late_s > 0 else 'ahead of'} the places"
        )
    name, _ = table.named("speed_m_s")
    if np.ptp(speeds) < 1e-9:
        return table.having(speed_m_s=None).noted(
            f"{name} is {speeds[0]:g} throughout: speeds are those of the places"
        )
    if (named := found.named_factor()) is not None:
        factor, words = named
        note = f"{both}: {name} is divided by {factor:.4g} ({words})"
        return table.having(speed_m_s=raw / factor).noted(note)
    if moved_m < max(_STILL_M, 0.02 * driven_m):
        return table.having(**dict.fromkeys(PLACES)).noted(
            "its place never changes and is left out"
        )
    raise RouteError(
        f"{table.source}: speeds and places contradict: {both} ({found.in_words()}); "
        "allowed: the same within 20 %"
    )


def _speeds_against_accelerations(table: DriveTable) -> DriveTable:
    """Refuse speeds that change by a multiple of what the accelerations state."""
    accelerations, speeds = (table.columns.get(each) for each in ("acceleration_m_s2", "speed_m_s"))
    table = table.having(acceleration_m_s2=None)
    if accelerations is None or speeds is None:
        return table
    times, known = table.columns["time_s"], np.isfinite(speeds)
    rows = windows(times)
    changed = np.diff(np.interp(times, times[known], speeds[known])[rows])
    gained = np.diff(cumulative_integral(times, np.nan_to_num(accelerations))[rows])
    size = float(np.linalg.norm(changed) * np.linalg.norm(gained))
    if not size or changed @ gained < _SAME_COURSE * size:
        return table.noted("accelerations do not match the speeds: not read")
    ratio = float(changed @ gained / (gained @ gained))
    if 0.8 < ratio < 1.25:
        return table
    cause = "".join(f", as {units} do" for _, units in factors_near(ratio)[:1])
    raise RouteError(
        f"{table.source}: speeds and accelerations contradict (ratio {ratio:.3g}){cause}; allowed: the same "
        "within 20 %"
    )


def _lag_s(times: FloatArray, speeds: FloatArray, plane: FloatArray) -> int:
    """Return by how much the speeds have to be moved to fit to the places best, 0 if none fits."""
    apart_m = {0: np.inf}
    for lag_s in range(-_LONGEST_LAG_S, _LONGEST_LAG_S + 1):
        found = distances(times, np.interp(times + lag_s, times, speeds), plane)
        if found.agrees():
            apart_m[lag_s] = float(np.abs(found.first - found.second).sum())
    return min(apart_m, key=apart_m.__getitem__)


def _turned(table: DriveTable, speeds: FloatArray) -> DriveTable | None:
    """Return the table with latitudes and longitudes exchanged if its speeds fit to these only."""
    columns = table.columns
    if "latitude_deg" not in columns or np.abs(columns["longitude_deg"]).max() > MAX_LATITUDE_DEG:
        return None
    turned = table.having(
        latitude_deg=columns["longitude_deg"], longitude_deg=columns["latitude_deg"]
    )
    if (plane := turned.plane()) is None:
        return None
    found = distances(columns["time_s"], speeds, plane)
    if not found.agrees() or abs(found.ratio - 1.0) > 0.02:
        return None
    return turned.noted("latitudes and longitudes are exchanged, by the speeds")


def _windows_apart(table: DriveTable, plane: FloatArray, speeds: FloatArray) -> DriveTable:
    """Take speeds for missing where places move on without them; refuse a place that leaps."""
    times = table.columns["time_s"]
    moved = lengths(np.diff(plane, axis=0))
    driven = np.diff(cumulative_integral(times, np.abs(speeds)))
    braking = 2.0 * MAX_ACCELERATION_M_S2 * np.minimum(np.diff(times), 2.0)
    leaps = moved - driven > 50.0 + 0.5 * driven + braking
    if leaps.any():
        row = int(np.argmax(leaps)) + 1
        raise RouteError(
            f"{table.at(row)}: its place is {moved[row - 1]:.0f} m from that before, {driven[row - 1]:.0f} m "
            "by its speeds: it was moved, or the clock was set; allowed: the same way"
        )
    found, missing = distances(times, speeds, plane), np.zeros(times.size, np.bool_)
    slower = found.edges[found.second - found.first > 30.0 + 0.3 * found.second]
    if not slower.size:
        return table
    for first, last in slower:
        missing[first : last + 1] = True
    count = table.count(np.count_nonzero(missing))
    note = f"speeds of {count} contradict the places: those of the places are used"
    return table.having(speed_m_s=np.where(missing, np.nan, table.columns["speed_m_s"])).noted(note)


def _leaps(times: FloatArray, speeds: FloatArray) -> NDArray[np.bool_]:
    """Return which speeds change by more than a car's can; within a second, noise and whole km/h count."""
    steps = MAX_ACCELERATION_M_S2 * np.diff(times)
    limit = np.maximum(steps, np.minimum(steps + _NOISE_M_S, MAX_ACCELERATION_M_S2))
    result: NDArray[np.bool_] = np.abs(np.diff(speeds)) > limit
    return result


def _speeds(table: DriveTable) -> DriveTable:
    """Take speeds for missing that no car has or changes to; the rows of one that reverses stand."""
    if "speed_m_s" not in table.columns:
        return table
    times, given = table.columns["time_s"], table.columns["speed_m_s"]
    table = _forwards(table)
    speeds = table.columns["speed_m_s"].copy()
    name, unit = table.named("speed_m_s")
    known = np.flatnonzero(np.isfinite(speeds))
    beyond = known[(speeds[known] < 0.0) | (speeds[known] > MAX_SPEED_M_S)]
    if beyond.size > MOST_INVALID * known.size:
        raise table.refuse(int(beyond[0]), "speed_m_s", f"0 to {MAX_SPEED_M_S / unit:.6g}")
    near = ~_leaps(times[known], speeds[known])
    fast = speeds[known] > MAX_SPEED_M_S
    if (near & (fast[1:] != fast[:-1])).any():
        # It is driven up to: no odd value, but another unit.
        row = int(known[int(np.argmax(fast))])
        raise table.refuse(row, "speed_m_s", f"0 to {MAX_SPEED_M_S / unit:.6g}")
    speeds[beyond] = np.nan
    speeds[_dropouts(times, speeds)] = np.nan
    plausible = np.flatnonzero(np.isfinite(speeds))

    def breaks(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        return _leaps(times[rows], speeds[rows])

    whole = consistent(plausible, times, breaks, LONGEST_OUTLIER_S)
    leaps = breaks(whole)
    if not leaps.any():
        # Also over a second, whatever the rate: many small steps make a large one.
        at, driven = times[whole], speeds[whole]
        later = np.minimum(np.searchsorted(at, at + 1.0), whole.size - 1)
        most = MAX_ACCELERATION_M_S2 * np.maximum(at[later] - at, 1.0) + 1e-9
        leaps = np.abs(driven[later] - driven) > most
    if leaps.any() or whole.size < (1.0 - MOST_INVALID) * known.size:
        step = int(np.argmax(leaps))
        row, before = int(whole[min(step + 1, whole.size - 1)]), int(whole[step])
        change = (speeds[row] - speeds[before]) / max(times[row] - times[before], 1e-9)
        raise table.refuse(
            row,
            "speed_m_s",
            f"a change of at most {MAX_ACCELERATION_M_S2:g} m/s^2, this is {change:.3g} m/s^2",
        )
    _refuse_times_in_ms(table, times[whole], speeds[whole])
    odd = np.ones(times.size, dtype=np.bool_)
    odd[whole] = False
    speeds[odd] = np.nan
    lost, missing = known.size - whole.size, int(np.count_nonzero(~np.isfinite(given)))
    notes = [f"{name} not plausible at {table.count(lost)}"] if lost else []
    notes += [f"{name} missing at {table.count(missing)}"] if missing else []
    return table.having(speed_m_s=speeds).noted(*notes)


def _dropouts(times: FloatArray, speeds: FloatArray) -> NDArray[np.int64]:
    """Return the rows that are 0 for seconds at most, between speeds from which one leaps."""
    rows = np.flatnonzero(np.isfinite(speeds))
    leaps = _leaps(times[rows], speeds[rows])
    is_zero = np.concatenate([[False], speeds[rows] == 0.0, [False]])
    edges = np.flatnonzero(np.diff(is_zero)).reshape(-1, 2)
    found = []
    for first, end in edges.tolist():
        if not 0 < first < end < rows.size:
            continue
        beside = speeds[rows[[first - 1, end]]]
        is_leap = (leaps[first - 1] or leaps[end - 1]) and beside.min() > _MOVES_M_S
        if is_leap and times[rows[end - 1]] - times[rows[first]] <= LONGEST_OUTLIER_S:
            found.append(rows[first:end])
    return np.concatenate([np.zeros(0, np.int64), *found])


def _refuse_times_in_ms(table: DriveTable, times: FloatArray, speeds: FloatArray) -> None:
    if speeds.size < 2 or np.ptp(speeds) < _MOVES_M_S:
        return
    most = float(np.abs(np.diff(speeds) / np.diff(times)).max())
    if most < _SLOWEST_CHANGE_M_S2:
        raise RouteError(
            f"{table.source}: speeds change by at most {most:.2g} m/s^2: are the times in ms? "
            "allowed: times in s"
        )


def _forwards(table: DriveTable) -> DriveTable:
    """Make speeds of one sign: small negative ones are noise, slow reversing is standing."""
    times, speeds = table.columns["time_s"], table.columns["speed_m_s"]
    negative = speeds < 0.0
    if not negative.any():
        return table
    name, _ = table.named("speed_m_s")
    if not (speeds > 0.05 * np.nanmax(np.abs(speeds))).any():
        note = f"{name} is negative throughout: its sign is turned"
        return table.having(speed_m_s=np.abs(speeds)).noted(note)
    known = np.flatnonzero(np.abs(speeds) <= MAX_SPEED_M_S)
    at = times[known]
    driven = cumulative_integral(at, speeds[known])
    begin, end = (np.clip(at + half, at[0], at[-1]) for half in (-0.5, 0.5))
    ways = np.interp(end, at, driven) - np.interp(begin, at, driven)
    means = ways / np.maximum(end - begin, 1e-9)
    slowest = float(means.min()) if at.size > 1 else 0.0
    if slowest < -_MAX_REVERSING_M_S:
        row = int(known[int(np.argmin(means))])
        raise RouteError(
            f"{table.at(row)}, column {name}: the car reverses at up to {-slowest:.3g} m/s; allowed: "
            f"forwards, up to {_MAX_REVERSING_M_S:g} m/s backwards count as standing"
        )
    count = table.count(np.count_nonzero(negative))
    note = f"{name} slightly negative at {count}: read as 0"
    if slowest < -_NOTED_REVERSING_M_S:
        back_m = -cumulative_integral(at, np.minimum(speeds[known], 0.0))[-1]
        note = f"the car reverses by {back_m:.3g} m at {count}: taken as standing"
    implausible = speeds < -MAX_SPEED_M_S
    return table.having(speed_m_s=np.where(negative & ~implausible, 0.0, speeds)).noted(note)
