"""A user's own trip: a table of speed over time, optionally with slope or height, in a file.

Columns of a CSV file, in any order: ``time_s`` (any zero), exactly one of ``speed_m_s``, ``speed_kmh`` and
``speed_mph``, and at most one of ``slope_percent`` (rise over run), ``slope_rad`` and
``elevation_m``. Lines that start with ``#`` are comments.

A file with ``latitude_deg`` and ``longitude_deg`` is a recorded drive (see `iptm_core.routes.track`): its
speed column may be missing, and its heights are smoothed along the road. So is a GPX file.

Other files hold the drives of several vehicles, one of which is named behind a ``#``: SUMO's floating car
data (see `iptm_core.routes.xml_drives`), and bags of ROS (see `iptm_core.routes.bag`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.routes.csv_table import CsvTable, read_csv_table
from iptm_core.routes.cycles import SPEED_COLUMNS_M_S, DrivingCycle
from iptm_core.routes.piecewise import cumulative_integral, integral_at
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.slope import MAX_GRADE, SlopeProfile
from iptm_core.routes.track import RecordedDrive, Track, read_out
from iptm_core.routes.xml_drives import FCD_SUFFIX, read_fcd, read_gpx
from iptm_core.state import FloatArray
from iptm_core.user_input import check_known, shown

ROAD_COLUMNS = ("slope_percent", "slope_rad", "elevation_m")
PLACE_COLUMNS = ("latitude_deg", "longitude_deg")
_COLUMNS = ("time_s", *SPEED_COLUMNS_M_S, *ROAD_COLUMNS, *PLACE_COLUMNS)
GPX_SUFFIX = ".gpx"
BAG_SUFFIXES = (".mcap", ".db3", ".bag")
"""Of single files; the bag of a run is a folder."""
USER_SUFFIXES = (".csv", GPX_SUFFIX, FCD_SUFFIX, *BAG_SUFFIXES)
USER_FILES = ".csv, .gpx, FILE.xml#VEHICLE of SUMO, FOLDER/BAG#VEHICLE"
"""Accepted files for a cycle, for messages to the user; `#VEHICLE` if there are several."""

MAX_SPEED_M_S = 70.0
"""252 km/h: no road car follows anything faster."""
MAX_ACCELERATION_M_S2 = 12.0
MAX_TIME_GAP_S = 60.0
LAUNCH_ACCELERATION_M_S2 = 1.5
"""Acceleration of the ramp put in front of a trace that starts at speed."""

_ROAD_SPACING_M = 5.0
_MAX_DISTANCE_CORRECTION = 0.02
_WHOLE_SECOND_TOLERANCE_S = 1e-6


@dataclass(frozen=True, eq=False)
class UserTrip:
    """A trip as a file holds it.

    Attributes:
        cycle: speed at 1 Hz.
        slope: slope of its road (position 0 is the start of the trip), None if not in the file.
        drive: what was read out of a recorded drive, None for a plain table.
    """

    cycle: DrivingCycle
    slope: SlopeProfile | None
    line: RoadLine | None = None
    drive: RecordedDrive | None = None


def read_user_trip(path: Path) -> UserTrip:
    """Read a trip from a file and resample it to 1 Hz.

    Speed is taken as linear between rows. Rows at whole seconds are kept exactly; otherwise the speed
    is read at whole seconds and scaled (by 2 % at most) so that the distance stays that of the file.
    A trip that starts at speed gets a launch ramp of 1.5 m/s^2 in front of it, because every run
    starts at standstill.

    Args:
        path: the file, or the folder of a bag, and behind a ``#`` the vehicle.
    """
    if path.suffix.lower() == GPX_SUFFIX:
        return _recorded_trip(path, read_gpx(path))
    return _trip(path, _read_table(path))


def trip_from_columns(columns: Mapping[str, ArrayLike], name: str = "own drive") -> UserTrip:
    """Return the trip of a table in memory: columns as in a CSV file, each of shape (n,)."""
    arrays: dict[str, FloatArray] = {}
    for column, values in columns.items():
        check_known(column, _COLUMNS, name, "column", RouteError)
        try:
            array = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            array = np.full(1, np.nan)
        if array.ndim != 1 or array.size == 0 or not np.all(np.isfinite(array)):
            raise RouteError(
                f"{name}: {column} is {shown(values)}; allowed: finite numbers, one per row"
            )
        arrays[column] = array
    lengths = {column: array.size for column, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        raise RouteError(f"{name}: columns have {lengths} rows; allowed: as many in each")
    rows = tuple(range(next(iter(lengths.values()), 0)))
    trip = _trip(Path(name), CsvTable(name, arrays, rows, "row"))
    return replace(trip, cycle=replace(trip.cycle, source=trip.cycle.source.removeprefix("file ")))


def _trip(path: Path, table: CsvTable) -> UserTrip:
    if any(column in table.columns for column in PLACE_COLUMNS):
        return _recorded_trip(path, _track(table))
    table.only(("time_s",), needed=True)
    table.only(ROAD_COLUMNS)
    speed_column = table.only(SPEED_COLUMNS_M_S, needed=True)
    speeds = table.columns[speed_column] * SPEED_COLUMNS_M_S[speed_column]
    times = table.columns["time_s"] - table.columns["time_s"][0]
    _check_motion(table, speed_column, times, speeds)
    cycle, launch_m = _launched(path, times, speeds)
    return UserTrip(cycle, _road(table, launch_m + cumulative_integral(times, speeds)))


def _read_table(path: Path) -> CsvTable:
    text, _, vehicle = str(path).partition("#")
    file = Path(text)
    if file.suffix.lower() == FCD_SUFFIX:
        return read_fcd(file, vehicle)
    if file.suffix.lower() in BAG_SUFFIXES or file.is_dir():
        # Loaded only now: no other cycle needs it, and every node would wait for it.
        from iptm_core.routes.bag import read_bag  # noqa: PLC0415

        return read_bag(file, vehicle)
    return read_csv_table(path, _COLUMNS)


def _launched(path: Path, times: FloatArray, speeds: FloatArray) -> tuple[DrivingCycle, float]:
    """Return the cycle of a trace, and the length of the launch ramp in front of it."""
    launch_s = float(np.ceil(speeds[0] / LAUNCH_ACCELERATION_M_S2))
    launch_m = 0.5 * launch_s * float(speeds[0])
    if launch_s > 0.0:
        times = np.concatenate([[0.0], times + launch_s])
        speeds = np.concatenate([[0.0], speeds])
    text, mark, vehicle = str(path).partition("#")
    file = Path(text)
    source = f"file {file.name}{mark}{vehicle}"
    if launch_s:
        source += f", after a launch of {launch_s:g} s"
    name = file.stem + mark + vehicle
    return DrivingCycle(name, *_resample(str(path), times, speeds), source), launch_m


def _recorded_trip(path: Path, track: Track) -> UserTrip:
    """Return the trip of a recorded drive; its road is extended backwards by the launch ramp."""
    drive = read_out(track)
    cycle, launch_m = _launched(path, drive.times_s, drive.speeds_m_s)
    slope = drive.slope
    if slope is not None:
        slope = SlopeProfile(slope.positions_m + launch_m, slope.slopes_rad)
    line = drive.line if launch_m == 0.0 else drive.line.extended_backwards(launch_m)
    return UserTrip(cycle, slope, line, drive)


def _track(table: CsvTable) -> Track:
    columns = table.columns
    missing = [name for name in ("time_s", *PLACE_COLUMNS) if name not in columns]
    others = [name for name in ROAD_COLUMNS if name in columns and name != "elevation_m"]
    if missing or others:
        raise RouteError(
            f"{table.source}: columns {missing} are missing, {others} in addition to places; allowed for a "
            f"recorded drive: time_s, {', '.join(PLACE_COLUMNS)}, one speed column and elevation_m"
        )
    speed = table.only(SPEED_COLUMNS_M_S)
    return Track(
        source=table.source,
        times_s=columns["time_s"] - columns["time_s"][0],
        latitudes_deg=columns["latitude_deg"],
        longitudes_deg=columns["longitude_deg"],
        heights_m=columns.get("elevation_m"),
        speeds_m_s=columns[speed] * SPEED_COLUMNS_M_S[speed] if speed else None,
    )


def _check_motion(table: CsvTable, column: str, times: FloatArray, speeds: FloatArray) -> None:
    fastest = MAX_SPEED_M_S / SPEED_COLUMNS_M_S[column]
    table.refuse_where((speeds < 0.0) | (speeds > MAX_SPEED_M_S), column, f"0 to {fastest:.6g}")
    steps = np.diff(times)
    table.refuse_where(steps <= 0.0, "time_s", "more than in the row before")
    longest = f"at most {MAX_TIME_GAP_S:g} s after the row before"
    table.refuse_where(steps > MAX_TIME_GAP_S, "time_s", longest)
    if times[-1] < 2.0:
        raise RouteError(
            f"{table.source}: the trip lasts {times[-1]:g} s in {times.size} rows; "
            "at least 2 s are needed"
        )
    accelerations = np.diff(speeds) / steps
    leaps = np.abs(accelerations) > MAX_ACCELERATION_M_S2
    table.refuse_where(
        leaps,
        column,
        f"a change of at most {MAX_ACCELERATION_M_S2:g} m/s^2 from the row before, "
        f"this is {accelerations[np.argmax(leaps)]:.3g} m/s^2",
    )


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


def _road(table: CsvTable, distances: FloatArray) -> SlopeProfile | None:
    column = table.only(ROAD_COLUMNS)
    if not column:
        return None
    values = table.columns[column]
    if column == "elevation_m":
        try:
            return SlopeProfile.from_elevations(*_by_position(distances, values))
        except RouteError as reason:
            raise RouteError(f"{table.source}, column elevation_m: {reason}") from reason
    percent = column == "slope_percent"
    limit = 100.0 * MAX_GRADE if percent else float(np.arctan(MAX_GRADE))
    table.refuse_where(np.abs(values) > limit, column, f"-{limit:.6g} to {limit:.6g}")
    slopes = np.arctan(values / 100.0) if percent else values
    return SlopeProfile(*_by_position(distances, slopes))


def _by_position(distances: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average rows that lie within the same few metres, as at a standstill or at walking pace."""
    bins = np.floor(distances / _ROAD_SPACING_M).astype(np.int64)
    _, index, counts = np.unique(bins, return_inverse=True, return_counts=True)
    return (
        np.bincount(index, weights=distances) / counts,
        np.bincount(index, weights=values) / counts,
    )
