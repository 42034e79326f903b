"""Drives in XML, read with the standard library only: GPX, and SUMO's floating car data (``--fcd-output``).

SUMO writes the same data as CSV and Parquet, too, and all of them compressed. Where a vehicle of SUMO drives
is known from a file written with ``--fcd-output.geo``, whose places are degrees; else the slope of its road
alone.
"""

from __future__ import annotations

import io
import math
import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.road_line import MAX_LATITUDE_DEG
from iptm_core.state import FloatArray
from iptm_core.user_input import suggestion
from iptm_drives.cells import Cells, cell_value, seconds_of
from iptm_drives.packed import read_content

_DOCUMENT_TYPE = re.compile(rb"<!DOCTYPE\s+([^\s>\[]*)")


def _elements(path: Path, most_bytes: int, kind: str) -> Iterator[tuple[str, ET.Element]]:
    """Yield ``start`` and ``end`` of the elements of a file; one of another kind is refused."""
    content = read_content(path, most_bytes)
    # With document types come entities that blow up or read other files; UTF-16 has zeros between letters.
    plain = content.replace(b"\0", b"") if b"\0" in content[:8] else content
    if (found := _DOCUMENT_TYPE.search(plain)) is not None:
        name = found[1].decode("utf-8", errors="replace")
        raise RouteError(f"{path}: document type {name!r}; allowed: none, no drive needs one")
    try:
        yield from ET.iterparse(io.BytesIO(content), ("start", "end"))  # noqa: S314 - see above
    except (ValueError, LookupError, ET.ParseError) as reason:
        cut = "" if content.rstrip(b"\0 \r\n\t").endswith(b">") else ", cut short?"
        raise RouteError(
            f"{path}: cannot be read ({reason}{cut}); a {kind} file is needed"
        ) from reason


MAX_GPX_BYTES = 100_000_000
MAX_POINTS = 1_000_000
_COLUMNS = ("time_s", "latitude_deg", "longitude_deg", "elevation_m", "speed_m_s")


def read_gpx(path: Path) -> DriveTable:
    """Read all points of all tracks of a file, in their order; without any, of its routes.

    Speeds are in m/s where they stand in the point, in its extensions or in Garmin's extension of it.

    Args:
        path: the file, GPX 1.0 or 1.1; names of elements count without their namespaces.
    """
    texts = Cells(str(path))
    points: dict[str, array[float]] = {"trkpt": array("d"), "rtept": array("d")}
    for event, element in _elements(path, MAX_GPX_BYTES, "GPX"):
        values = points.get(_name(element))
        if event == "start" or values is None:
            continue
        number = len(values) // len(_COLUMNS) + 1
        if number > MAX_POINTS:
            raise RouteError(
                f"{path}: more than {MAX_POINTS} track points; allowed: 2 to {MAX_POINTS}"
            )
        stated = _stated(element)
        for name in ("time", "lat", "lon", "ele", "speed"):
            by = seconds_of if name == "time" else cell_value
            text = stated.get(name)
            values.append(texts.read(f"track point {number}", name, text, by))
        element.clear()
    # A device that was guided stores both; the driven one counts.
    rows: FloatArray = np.reshape(points["trkpt"] or points["rtept"], (-1, len(_COLUMNS)))
    if len(rows) < 2:
        raise RouteError(f"{path}: {len(rows)} track points; allowed: 2 to {MAX_POINTS}")
    columns = {name: rows[:, index] for index, name in enumerate(_COLUMNS)}
    known = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    return DriveTable(
        str(path),
        {"time_s": columns["time_s"], **known},
        np.arange(1, len(rows) + 1),
        "track point",
        {"speed_m_s": ("speed", 1.0), "elevation_m": ("ele", 1.0)},
        notes=tuple(texts.notes(len(rows), "track point")),
    )


def _name(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _stated(point: ET.Element) -> dict[str, str | None]:
    """Return what a point states; of what else its extensions hold (sensors, wind, a photo), the speed."""
    extensions = [each for each in point if _name(each) == "extensions"]
    devices = [
        each for holder in extensions for each in holder if _name(each).startswith("TrackPoint")
    ]
    speeds = [each for holder in extensions + devices for each in holder if _name(each) == "speed"]
    stated: dict[str, str | None] = {}
    for element in (*point, *speeds):
        stated.setdefault(_name(element), element.text)
    return {**stated, "lat": point.get("lat"), "lon": point.get("lon")}


MAX_FCD_BYTES = 1_000_000_000
"""Of one vehicle only its own rows are kept."""
FCD_TIME, FCD_NAME = "timestep_time", "vehicle_id"
_LONGEST_ID = 200
_INVALID = -1e9
"""SUMO writes -1073741824 for what is not known."""
_Row = Mapping[str, Any]


def read_fcd(path: Path, name: str) -> DriveTable:
    """Return the drive of a vehicle ("" for the only one) in SUMO's XML."""

    def rows() -> Iterator[_Row]:
        time, inside = "", False
        for event, element in _elements(path, MAX_FCD_BYTES, "SUMO FCD"):
            if element.tag == "timestep":
                time, inside = element.get("time", ""), event == "start"
            elif element.tag == "vehicle" and inside and event == "start":
                yield {**element.attrib, "time": time}
            if event == "end":
                element.clear()

    return _drive(path, name, rows())


def read_fcd_rows(path: Path, name: str, rows: Iterable[_Row]) -> DriveTable:
    """Return the drive of a vehicle in rows of SUMO's CSV or Parquet: ``vehicle_x`` is x in its XML."""
    # Steps without a vehicle have an empty name.
    stated = (
        {key.partition("_")[2]: value for key, value in row.items() if value is not None}
        for row in rows
        if row[FCD_NAME]
    )
    return _drive(path, name, stated)


def _drive(path: Path, name: str, of_all: Iterable[_Row]) -> DriveTable:
    rows: list[_Row] = []
    vehicles: dict[str, None] = {}
    for row in of_all:
        vehicle = str(row.get("id", ""))
        if len(vehicle) > _LONGEST_ID:
            raise RouteError(
                f"{path}: a vehicle's id has {len(vehicle)} characters; allowed: up to {_LONGEST_ID}"
            )
        vehicles.setdefault(vehicle)
        if vehicle == (name or next(iter(vehicles))):
            rows.append(row)
    if not rows:
        none = "it holds none; allowed: the output of --fcd-output"
        raise RouteError(
            f"{path}: no vehicle {name!r}; {suggestion(name, vehicles) if vehicles else none}"
        )
    first = name or next(iter(vehicles))
    source = f"{path}#{first}"
    if not name and len(vehicles) > 1:
        raise RouteError(f"{path} holds {len(vehicles)} vehicles; name one: {source}")
    texts = Cells(source)

    def column(key: str, by: Callable[..., float] = cell_value) -> FloatArray:
        cells = enumerate((str(row.get(key, "")) for row in rows), start=1)
        values = np.array([texts.read(f"row {at}", key, cell, by) for at, cell in cells])
        return np.where(values < _INVALID, math.nan, values)

    columns = {"time_s": column("time", seconds_of), "speed_m_s": column("speed")}
    stated: set[str] = set().union(*rows)
    if "slope" in stated:
        columns["slope_rad"] = np.radians(column("slope"))
    if {"x", "y"} <= stated:
        places = column("x"), column("y")
        is_geo = _in_degrees(columns["time_s"], columns["speed_m_s"], *places)
        names = ("longitude_deg", "latitude_deg") if is_geo else ("east_m", "north_m")
        columns |= dict(zip(names, places, strict=True))
    if "z" in stated:
        columns["elevation_m"] = column("z")
    return DriveTable(
        source,
        columns,
        np.arange(1, len(rows) + 1),
        "row",
        {"elevation_m": ("z", 1.0)},
        notes=tuple(texts.notes(len(rows), "row")),
    )


_DEGREES_PER_M = 1e-3
"""Places that move by less for each metre driven are degrees; by metres of a plane they move by 1."""


def _in_degrees(times: FloatArray, speeds: FloatArray, east: FloatArray, north: FloatArray) -> bool:
    driven_m = float(np.nansum(np.abs(np.diff(times) * speeds[1:])))
    moved = float(np.nansum(np.hypot(np.diff(east), np.diff(north))))
    on_earth = (
        np.nanmax(np.abs(east), initial=0.0) <= 180.0
        and np.nanmax(np.abs(north), initial=0.0) <= MAX_LATITUDE_DEG
    )
    # Without speeds, a vehicle of SUMO that stands does not move at all.
    most_m = driven_m or 70.0 * float(np.ptp(times)) * bool(moved)
    return bool(on_earth and moved < _DEGREES_PER_M * most_m)
