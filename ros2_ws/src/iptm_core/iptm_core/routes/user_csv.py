"""A user's own trip: a table of speed over time, optionally with slope or height, in a file.

Columns of a CSV file, in any order: ``time_s`` (any zero), exactly one of ``speed_m_s``, ``speed_kmh`` and
``speed_mph``, and ``slope_percent`` (rise over run), ``slope_rad`` or ``elevation_m``; other names with a
unit (see `iptm_core.routes.column_names`), or ``FILE.csv#speed=NAME[UNIT]``. Lines that start with ``#``
are comments.

A file with ``latitude_deg`` and ``longitude_deg`` is a recorded drive (see `iptm_core.routes.track`): its
speed column may be missing, and its heights are smoothed along the road. So is a GPX file.

Other files hold the drives of several vehicles, one of which is named behind a ``#``: SUMO's floating car
data (see `iptm_core.routes.xml_drives`), and bags of ROS (see `iptm_core.routes.bag`). Whatever the file,
what it states is cleaned in one way (see `iptm_core.routes.cleaning`).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.cleaning import clean
from iptm_core.routes.column_names import columns_table
from iptm_core.routes.cycles import DrivingCycle, cumulative_integral, integral_at
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.route import BAG_SUFFIXES, GPX_SUFFIX, UserTrip
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.text_table import MAX_BYTES as MAX_TEXT_BYTES
from iptm_core.routes.text_table import parse_text_table, read_content, text_of
from iptm_core.routes.track import by_position, read_out, road_through
from iptm_core.routes.xml_drives import (
    FCD_NAME,
    FCD_TIME,
    MAX_FCD_BYTES,
    read_fcd,
    read_fcd_rows,
    read_gpx,
)
from iptm_core.state import FloatArray
from iptm_core.user_input import file_and_name

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
        path: the file, or the folder of a bag, and behind a ``#`` the vehicle.
    """
    return trip_of_table(path, read_drive_table(path))


def trip_from_columns(columns: Mapping[str, object], name: str = "own drive") -> UserTrip:
    """Return the trip of a table in memory: columns as in a CSV file, each of shape (n,)."""
    trip = trip_of_table(Path(name), columns_table(columns, name))
    return replace(trip, cycle=replace(trip.cycle, source=trip.cycle.source.removeprefix("file ")))


def trip_of_table(path: Path, table: DriveTable) -> UserTrip:
    """Return the trip in a table that was read from a file."""
    drive = clean(table)
    if "latitude_deg" in drive.columns:
        return _recorded_trip(path, drive)
    times, speeds = drive.columns["time_s"], drive.columns["speed_m_s"]
    if times[-1] < 2.0:
        raise RouteError(
            f"{table.source}: the trip lasts {times[-1]:g} s in {times.size} rows; "
            "at least 2 s are needed"
        )
    cycle, launch_s = _launched(path, times, speeds)
    launch_m = 0.5 * launch_s * float(speeds[0])
    slope = _road(drive, launch_m + cumulative_integral(times, speeds))
    return UserTrip(cycle, slope, notes=drive.notes, launch_s=launch_s)


def read_gpx_road(path: Path) -> tuple[RoadLine, SlopeProfile | None]:
    """Read the road of a recorded drive or a plan without times; no slope where no point has a height."""
    table = read_gpx(path)
    if np.isfinite(table.columns["time_s"]).any():
        drive = read_out(clean(table))
        return drive.line, drive.slope
    known = np.isfinite(table.columns["latitude_deg"]) & np.isfinite(table.columns["longitude_deg"])
    places = {name: values[known] for name, values in table.columns.items()}
    heights = places.get("elevation_m")
    if heights is not None:
        stated, points = np.isfinite(heights), np.arange(heights.size)
        heights = np.interp(points, points[stated], heights[stated])
    return road_through(str(path), places["latitude_deg"], places["longitude_deg"], heights)


def read_drive_table(path: Path) -> DriveTable:
    """Read what a file states, whatever its kind; behind a ``#`` stands the vehicle, or the columns."""
    file, name = file_and_name(path)
    kind = file.name.lower().removesuffix(".gz")
    if kind.endswith(GPX_SUFFIX):
        table = read_gpx(file)
        if not np.isfinite(table.columns["time_s"]).any():
            raise RouteError(
                f"{path}: time is missing at all points, so it is a road and no drive; allowed: as slope "
                "of another cycle"
            )
        return table
    if kind.endswith(".xml"):
        return read_fcd(file, name)
    if kind.endswith(".parquet"):
        return _of_parquet(file, name)
    if kind.endswith(BAG_SUFFIXES) or file.is_dir():
        # Loaded only now: no other cycle needs it, and every node would wait for it.
        from iptm_core.routes.bag import read_bag  # noqa: PLC0415

        return read_bag(file, name)
    raw = read_content(file, MAX_FCD_BYTES)
    head = raw.partition(b"\n")[0]
    if FCD_TIME.encode() in head and FCD_NAME.encode() in head:
        separator = ";" if b";" in head else ","
        return read_fcd_rows(
            file, name, csv.DictReader(io.StringIO(text_of(raw)), delimiter=separator)
        )
    if len(raw) > MAX_TEXT_BYTES:
        raise RouteError(f"{file}: {len(raw)} bytes; at most {MAX_TEXT_BYTES} are read")
    return parse_text_table(text_of(raw), str(file), name)


def _of_parquet(path: Path, name: str) -> DriveTable:
    import pandas as pd  # noqa: PLC0415 - and pyarrow, which no other cycle needs

    if not path.is_file():
        raise RouteError(f"{path}: no such file; allowed: the path of an existing one")
    try:
        frame = pd.read_parquet(path)
        frame = frame if frame.index.name is None else frame.reset_index()
    except Exception as reason:  # pyarrow has error types of its own
        raise RouteError(f"{path}: cannot be read as Parquet ({reason})") from reason
    if FCD_NAME in frame and FCD_TIME in frame:
        return read_fcd_rows(path, name, frame.to_dict("records"))
    return columns_table({str(key): frame[key].to_numpy() for key in frame}, str(path))


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
    return UserTrip(cycle, slope, line, drive, cleaned.notes, launch_s)


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
