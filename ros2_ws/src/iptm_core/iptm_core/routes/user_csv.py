"""A user's own trip: a plain table of speed over time, optionally with slope or height and places, in a file.

Columns of a CSV file, in any order: ``time_s`` (any zero), exactly one of ``speed_m_s``, ``speed_kmh`` and
``speed_mph``, optionally one of ``slope_percent`` (rise over run), ``slope_rad`` and ``elevation_m``, and
``latitude_deg`` with ``longitude_deg``. Lines that start with ``#`` are comments. A table that is not whole
is refused with its row.

An extra (a module ``extra_drives``) reads all other files, and repairs them: `drive_in_file(path)` and
`drive_in_columns(columns, name)` return the cleaned drive, `read_road(path)` a road without times. Where one
is installed it reads plain tables, too, and leaves what needs no repair as it is, to the last bit.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.extras import offered
from iptm_core.routes.cycles import DrivingCycle, cumulative_integral, integral_at
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.road_line import MAX_LATITUDE_DEG, RoadLine
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.track import MAX_RECORDED_GRADE, by_position, read_out
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import FloatArray
from iptm_core.units import KM_H_PER_M_S, M_S_PER_MPH
from iptm_core.user_input import file_and_name, number, read_file, shown

COLUMNS: Mapping[str, tuple[str, float]] = {
    "time_s": ("time_s", 1.0),
    "speed_m_s": ("speed_m_s", 1.0),
    "speed_kmh": ("speed_m_s", 1.0 / KM_H_PER_M_S),
    "speed_mph": ("speed_m_s", M_S_PER_MPH),
    "slope_percent": ("slope_rad", 1.0e-2),
    "slope_rad": ("slope_rad", 1.0),
    "elevation_m": ("elevation_m", 1.0),
    "latitude_deg": ("latitude_deg", 1.0),
    "longitude_deg": ("longitude_deg", 1.0),
}
"""Quantity of a column of a plain table by its name, and SI units in one of its unit; a slope in percent is
rise over run."""
MAX_BYTES = 100_000_000
"""A day at 100 Hz, or a week at 10 Hz."""
MAX_STEP_S = 60.0
"""Longest time between two rows."""
MAX_SPEED_M_S = 70.0
"""252 km/h: no road car follows anything faster."""
NOTED_STEEP_M = 50.0
"""Length of a road that is steeper than roads are, above which it is noted."""
LAUNCH_ACCELERATION_M_S2 = 1.5
"""Acceleration of the ramp put in front of a trace that starts at speed."""

_MAX_DISTANCE_CORRECTION = 0.02
_WHOLE_SECOND_TOLERANCE_S = 1e-6


def read_user_trip(path: Path) -> UserTrip:
    """Read a trip from a file and resample it to 1 Hz.

    Speed is taken as linear between rows. Rows at whole seconds are kept exactly; otherwise the speed
    is read at whole seconds and scaled (by 2 % at most) so that the distance stays as in the file.
    A trip that starts at speed gets a launch ramp of 1.5 m/s^2 in front of it, because every run
    starts at standstill.

    Args:
        path: the file; with an extra also the folder of a bag, and behind a ``#`` the vehicle.
    """
    for extra in offered("drives"):
        return trip_of(path, extra.drive_in_file(path))
    return trip_of(path, plain_table(path))


def trip_from_columns(columns: Mapping[str, object], name: str = "own drive") -> UserTrip:
    """Return the trip of a table in memory: columns as in a CSV file, each of shape (n,)."""
    extras = offered("drives")
    drive = (extras[0].drive_in_columns if extras else _plain_columns)(columns, name)
    trip = trip_of(Path(name), drive)
    return replace(trip, cycle=replace(trip.cycle, source=trip.cycle.source.removeprefix("file ")))


def read_road(path: Path) -> tuple[RoadLine, SlopeProfile | None]:
    """Read the road of a recorded drive or a plan without times; no slope where no point has a height.

    Raises:
        RouteError: the file is not usable, or no extra that reads it is installed.
    """
    for extra in offered("drives"):
        road: tuple[RoadLine, SlopeProfile | None] = extra.read_road(path)
        return road
    raise RouteError(f"{path} is no plain table; allowed: with an extra that reads drives")


def plain_table(path: Path) -> DriveTable:
    """Read a plain table.

    Raises:
        RouteError: it is not whole, or no plain table.
    """
    file, name = file_and_name(path)
    if name or not file.name.lower().endswith(".csv"):
        raise RouteError(
            f"{path} is no plain table; allowed: a .csv file with {', '.join(COLUMNS)}, or others with an "
            "extra that reads drives"
        )
    lines = (
        read_file(file, MAX_BYTES, RouteError).decode("utf-8-sig", errors="replace").splitlines()
    )
    numbered = [(at, line) for at, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    if len(numbered) < 3:
        raise RouteError(f"{path}: {len(numbered)} lines; allowed: a header and 2 rows or more")
    header, *rows = (next(csv.reader([line])) for _, line in numbered)
    places = np.array([at for at, _ in numbered[1:]])
    values = [
        [_value(path, at, cell) for cell in row] for at, row in zip(places, rows, strict=True)
    ]
    for at, row in zip(places, values, strict=True):
        if len(row) != len(header):
            raise RouteError(f"{path}, line {at}: {len(row)} values; allowed: {len(header)}")
    names = [title.strip() for title in header]
    return _plain(str(path), names, list(np.array(values).T), places, "line")


def _value(path: Path, line: int, text: str) -> float:
    try:
        return number(text.strip())
    except ValueError:
        raise RouteError(f"{path}, line {line}: {shown(text)}; allowed: a finite number") from None


def _plain_columns(columns: Mapping[str, object], name: str) -> DriveTable:
    arrays = [np.asarray(values, dtype=np.float64) for values in columns.values()]
    sizes = {array.shape for array in arrays}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        raise RouteError(
            f"{name}: columns have shapes {sorted(sizes)}; allowed: (n,), one n for all"
        )
    return _plain(name, list(columns), arrays, np.arange(arrays[0].size), "row")


def _plain(
    source: str, names: Sequence[str], values: Sequence[FloatArray], rows: Any, counted: str
) -> DriveTable:
    """Return the checked table of columns in the units of their names, times from 0 on."""
    unknown = [title for title in names if title not in COLUMNS]
    if unknown:
        raise RouteError(
            f"{source}: unknown column {unknown[0]!r}; allowed: {', '.join(COLUMNS)}, or others with an "
            "extra that reads drives"
        )
    columns: dict[str, FloatArray] = {}
    for title, column in zip(names, values, strict=True):
        quantity, factor = COLUMNS[title]
        if quantity in columns:
            raise RouteError(f"{source}: columns have several of {quantity}; allowed: one")
        # As the extra computes it, to the last bit.
        columns[quantity] = (
            np.arctan(column / 100.0) if title == "slope_percent" else column * factor
        )
    lacking = {"time_s", "speed_m_s"} - columns.keys()
    if {"latitude_deg", "longitude_deg"} & columns.keys():
        lacking |= {"latitude_deg", "longitude_deg"} - columns.keys()
    if lacking:
        raise RouteError(
            f"{source}: columns {sorted(lacking)} are missing; allowed: {list(COLUMNS)}"
        )
    shown_as = {COLUMNS[title][0]: (title, COLUMNS[title][1]) for title in names}
    table = DriveTable(source, columns, rows, counted, shown_as)
    steps = np.diff(columns["time_s"], prepend=columns["time_s"][0] - 1.0)
    wrong = {
        "time_s": (
            ~((steps > 0.0) & (steps <= MAX_STEP_S)),
            f"0 to {MAX_STEP_S:g} s after the row before",
        ),
        "speed_m_s": (
            (columns["speed_m_s"] < 0.0) | (columns["speed_m_s"] > MAX_SPEED_M_S),
            f"0 to {MAX_SPEED_M_S / table.named('speed_m_s')[1]:.6g}",
        ),
        "latitude_deg": (
            np.abs(columns.get("latitude_deg", steps * 0.0)) > MAX_LATITUDE_DEG,
            f"up to {MAX_LATITUDE_DEG:g}",
        ),
    }
    for quantity, column in columns.items():
        bad, allowed = wrong.get(quantity, (np.zeros(column.size, dtype=np.bool_), ""))
        if (~np.isfinite(column)).any():
            bad, allowed = ~np.isfinite(column), "a finite number"
        if bad.any():
            raise table.refuse(int(np.argmax(bad)), quantity, allowed)
    return table.from_zero()


def trip_of(path: Path, drive: DriveTable) -> UserTrip:
    """Return the trip of a whole table, by the name of its file.

    Raises:
        RouteError: it is too short, or changes too fast for 1 Hz.
    """
    if "latitude_deg" in drive.columns:
        return _recorded_trip(path, drive)
    times, speeds = drive.columns["time_s"], drive.columns["speed_m_s"]
    if times[-1] < 2.0:
        raise RouteError(
            f"{drive.source}: the trip lasts {times[-1]:g} s in {times.size} rows; "
            "at least 2 s are needed"
        )
    cycle, launch_s = _launched(path, times, speeds)
    launch_m = 0.5 * launch_s * float(speeds[0])
    slope = _road(drive, launch_m + cumulative_integral(times, speeds))
    return UserTrip(cycle, slope, notes=drive.notes, launch_s=launch_s)


def _launched(path: Path, times: FloatArray, speeds: FloatArray) -> tuple[DrivingCycle, float]:
    """Return the cycle of a trace, and how long the launch ramp in front of it lasts."""
    launch_s = float(np.ceil(speeds[0] / LAUNCH_ACCELERATION_M_S2))
    if launch_s > 0.0:
        times = np.concatenate([[0.0], times + launch_s])
        speeds = np.concatenate([[0.0], speeds])
    file, vehicle = file_and_name(path)
    mark = "#" if vehicle else ""
    source = f"file {file.name}{mark}{vehicle}"
    if launch_s:
        source += f", after a launch of {launch_s:g} s"
    name = file.stem + mark + vehicle
    return DrivingCycle(name, *_resample(str(path), times, speeds), source), launch_s


def _recorded_trip(path: Path, cleaned: DriveTable) -> UserTrip:
    """Return the trip of a recorded drive; its road is extended backwards by the launch ramp."""
    drive = read_out(cleaned)
    cycle, launch_s = _launched(path, drive.times_s, drive.speeds_m_s)
    launch_m = 0.5 * launch_s * float(drive.speeds_m_s[0])
    slope = drive.slope
    if slope is not None:
        slope = SlopeProfile(slope.positions_m + launch_m, slope.slopes_rad)
    line = drive.line if launch_m == 0.0 else drive.line.extended_backwards(launch_m)
    notes = cleaned.notes
    if drive.bounded_m > NOTED_STEEP_M:
        grade = f"heights are steeper than {100.0 * MAX_RECORDED_GRADE:g} %"
        steep = f"{grade} on {drive.bounded_m:.0f} m of the road"
        notes = (
            *notes,
            f"{steep}, bounded there: a step of the receiver, if no such road is there",
        )
    return UserTrip(cycle, slope, line, drive, notes, launch_s)


def _resample(source: str, times: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn any trace that starts at 0 s into one at 1 Hz with the same distance."""
    # A trip that ends at standstill stands until the next whole second; one that ends at speed is
    # cut at the last whole second, where the leader starts to brake.
    end_s = np.ceil(times[-1]) if speeds[-1] == 0.0 else np.floor(times[-1])
    seconds = np.arange(int(end_s) + 1, dtype=np.float64)
    sampled = np.interp(seconds, times, speeds)
    if np.all(np.abs(times - np.round(times)) < _WHOLE_SECOND_TOLERANCE_S):
        return seconds, sampled
    distance = float(
        integral_at(
            np.asarray(min(end_s, times[-1])), times, speeds, cumulative_integral(times, speeds)
        )
    )
    sampled_distance = float(cumulative_integral(seconds, sampled)[-1])
    if abs(sampled_distance - distance) > _MAX_DISTANCE_CORRECTION * distance:
        raise RouteError(
            f"{source}: read at 1 Hz the trip covers {sampled_distance:.1f} m instead of "
            f"{distance:.1f} m; allowed: a difference of {100 * _MAX_DISTANCE_CORRECTION:g} %, "
            "speed must not change faster than from one second to the next"
        )
    return seconds, sampled * (distance / sampled_distance if distance > 0.0 else 1.0)


def _road(drive: DriveTable, distances: FloatArray) -> SlopeProfile | None:
    columns = drive.columns
    if "slope_rad" in columns:
        return SlopeProfile(*by_position(distances, columns["slope_rad"]))
    if "elevation_m" not in columns:
        return None
    try:
        return SlopeProfile.from_elevations(*by_position(distances, columns["elevation_m"]))
    except RouteError as reason:
        raise RouteError(f"{drive.source}, column elevation_m: {reason}") from reason
