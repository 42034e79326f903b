"""Measured motions as driving cycles: files of speed over time, with the elevation where it was measured."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from studies.validation import excerpts
from studies.validation.excerpts import Drive, Driver, Trip
from studies.validation.i3_vehicle import road_slope_rad

from iptm_core.errors import IptmError, MeasurementError
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.state import FloatArray

T = TypeVar("T")
FASTEST_M_S = 36.0
"""Largest speed of a lead vehicle: the slowest car does 40 m/s and has to follow."""
LANDING_M_S2 = 1.0
"""Deceleration at the end of a part of a drive."""
STANDING_S = 5.0
LEADS = 40
LONGEST_LEAD_S, SHORTEST_LEAD_S = 600.0, 60.0
TRIPS = 10
LONGEST_TRIP_S = 300.0
MOVING_M_S = 0.5
STANDING_BEFORE_S = 2.0


def lead_cycles(folder: Path, count: int = LEADS) -> list[str]:
    """Write measured lead vehicles as drive files, half of them from roads where there are enough.

    Args:
        folder: for the drive files; made if need be.
        count: number of lead vehicles.

    Returns:
        Paths of the drive files, as cycles of a run.
    """
    drives = excerpts.drives()
    road = [drive for drive in drives if drive.driver is Driver.ROAD]
    others = [drive for drive in drives if drive.driver is not Driver.ROAD]
    cycles: list[str] = []
    for group, share in ((road, count // 2), (others, count)):
        written = (_write_lead(folder, drive) for drive in evenly(group, 4 * share))
        cycles += evenly([path for path in written if path], share - len(cycles))
    return cycles


def _write_lead(folder: Path, drive: Drive) -> str:
    """Write the longest part of a drive without gaps; returns its path, empty for no usable one."""
    known = longest_known(drive.speed_m_s)[: round(LONGEST_LEAD_S / drive.step_s)]
    speeds_m_s = np.maximum(known, 0.0)
    if speeds_m_s.size < SHORTEST_LEAD_S / drive.step_s or speeds_m_s.max() > FASTEST_M_S:
        return ""
    path = write_drive(folder / f"{drive.name.replace('/', '_')}.csv", drive.step_s, speeds_m_s)
    try:
        read_user_trip(path)
    except IptmError:
        return ""
    return str(path)


def trip_cycles(folder: Path, count: int = TRIPS) -> list[str]:
    """Write the first five minutes of measured trips of the BMW i3 as drive files, evenly spread over all.

    The slope follows the recorded elevation, smoothed over 400 m to either side.

    Args:
        folder: for the drive files; made if need be.
        count: number of trips.

    Returns:
        Paths of the drive files, as cycles of a run.

    Raises:
        MeasurementError: there are fewer trips.
    """
    parts = {trip.name: _beginning(trip) for trip in excerpts.trips()}
    slow = [name for name, (speeds, _) in parts.items() if speeds.max() <= FASTEST_M_S]
    if len(slow) < count:
        raise MeasurementError(
            f"the excerpts have {len(slow)} trips of the i3 below {FASTEST_M_S:g} m/s;"
            f" allowed: at least {count}"
        )
    return [
        str(write_drive(folder / f"i3_{name}.csv", 1.0, *parts[name]))
        for name in evenly(slow, count)
    ]


def _beginning(trip: Trip) -> tuple[FloatArray, FloatArray]:
    """Return speeds and slopes at steps of a second from shortly before the departure on."""
    departure_s = float(trip.time_s[int(np.argmax(trip.speed_m_s > MOVING_M_S))])
    begin_s = max(departure_s - STANDING_BEFORE_S, 0.0)
    grid = np.arange(begin_s, min(begin_s + LONGEST_TRIP_S, float(trip.time_s[-1])) + 0.5)
    speeds = np.interp(grid, trip.time_s, trip.speed_m_s)
    return speeds, np.interp(grid, trip.time_s, road_slope_rad(trip))


def evenly(items: Sequence[T], count: int) -> list[T]:
    """Return some items, evenly spread over all."""
    places = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[place] for place in dict.fromkeys(places.tolist())]


def longest_known(series: FloatArray) -> FloatArray:
    """Return the longest part in which everything is finite; shapes (..., n) to (..., m)."""
    known = np.isfinite(np.atleast_2d(series)).all(axis=0)
    edges = np.concatenate(([-1], np.flatnonzero(~known), [known.size]))
    longest = int(np.argmax(np.diff(edges)))
    return series[..., edges[longest] + 1 : edges[longest + 1]]


def write_drive(
    path: Path, step_s: float, speeds_m_s: FloatArray, slopes_rad: FloatArray | None = None
) -> Path:
    """Write speeds at equal steps, and a halt at the end: a route has its lead vehicle stand there.

    A file that has this content already is left alone.

    Args:
        path: of the CSV file.
        step_s: sampling interval.
        speeds_m_s: speeds, shape (n,), not negative.
        slopes_rad: slopes of the road where the vehicle was, shape (n,); None for a level road.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
    """
    columns = {"time_s": step_s * np.arange(speeds_m_s.size), "speed_m_s": speeds_m_s}
    if slopes_rad is not None:
        columns["slope_rad"] = slopes_rad
    if speeds_m_s[-1] > 0.0:
        halt_s = float(columns["time_s"][-1] + np.ceil(speeds_m_s[-1] / LANDING_M_S2))
        end = {"time_s": [halt_s, halt_s + STANDING_S], "speed_m_s": [0.0, 0.0]}
        columns = {
            name: np.append(values, end.get(name, [values[-1]] * 2))
            for name, values in columns.items()
        }
    formats = {"time_s": "%.3f", "speed_m_s": "%.4f", "slope_rad": "%.6f"}
    text = io.StringIO()
    np.savetxt(
        text,
        np.column_stack(list(columns.values())),
        [formats[name] for name in columns],
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    if not path.is_file() or path.read_text(encoding="utf-8") != text.getvalue():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.getvalue(), encoding="utf-8")
    return path
