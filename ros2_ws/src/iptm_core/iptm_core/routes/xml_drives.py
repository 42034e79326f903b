"""Drives in XML, read with the standard library only: GPX, and SUMO's floating car data (``--fcd-output``).

SUMO writes the same data as CSV and Parquet, too, and all of them compressed. Where a vehicle of SUMO drives
is known from a file written with ``--fcd-output.geo``, whose places are degrees; else the slope of its road
alone.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import Cells, DriveTable, cell_value, seconds_of
from iptm_core.routes.road_line import MAX_LATITUDE_DEG
from iptm_core.routes.text_table import read_content
from iptm_core.state import FloatArray
from iptm_core.user_input import suggestion


class PlainXml:
    """Base of what takes the elements of a file; see `xml.etree.ElementTree.XMLParser`.

    It refuses document types, and with them entities that blow up or read other files.
    """

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:  # noqa: ARG002
        """Refuse; the parser calls this before it reads any entity."""
        raise RouteError(f"document type {name!r}; allowed: none, no drive needs one")


def read_xml(path: Path, most_bytes: int, kind: str, target: PlainXml) -> None:
    """Give the elements of a file to a target; a file of another kind is refused."""
    content = read_content(path, most_bytes)
    try:
        parser = ET.XMLParser(target=target)  # noqa: S314 - entities are refused
        ET.fromstring(content, parser)  # noqa: S314
    except RouteError as reason:
        raise RouteError(f"{path}: {reason}") from None
    except (ValueError, LookupError, ET.ParseError) as reason:
        cut = "" if content.rstrip(b"\0 \r\n\t").endswith(b">") else ", cut short?"
        raise RouteError(
            f"{path}: cannot be read ({reason}{cut}); a {kind} file is needed"
        ) from reason


MAX_GPX_BYTES = 100_000_000
MAX_POINTS = 1_000_000
_TRACK_POINT, _ROUTE_POINT = "trkpt", "rtept"
_COLUMNS = ("time_s", "latitude_deg", "longitude_deg", "elevation_m", "speed_m_s")


def read_gpx(path: Path) -> DriveTable:
    """Read all points of all tracks of a file, in their order.

    Speeds are in m/s where they stand in the point, in its extensions or in Garmin's extension of it.

    Args:
        path: the file, GPX 1.0 or 1.1; names of elements count without their namespaces.
    """
    points = _Points(str(path))
    read_xml(path, MAX_GPX_BYTES, "GPX", points)
    if points.count < 2:
        raise RouteError(f"{path}: {points.count} track points; allowed: 2 to {MAX_POINTS}")
    rows: FloatArray = np.array(points.values).reshape(points.count, -1)
    columns = {name: rows[:, index] for index, name in enumerate(_COLUMNS)}
    known = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    return DriveTable(
        str(path),
        {"time_s": columns["time_s"], **known},
        np.arange(1, points.count + 1),
        "track point",
        {"speed_m_s": ("speed", 1.0), "elevation_m": ("ele", 1.0)},
        notes=tuple(points.texts.notes(points.count, "track point")),
    )


class _Points(PlainXml):
    """Reads points as they come, so that a large file takes little memory.

    Attributes:
        count: points so far.
        values: time, latitude, longitude, height and speed of each, one after the other.
        texts: reads them.
    """

    def __init__(self, source: str) -> None:
        self.count = 0
        self.values = array("d")
        self.texts = Cells(source)
        self._kind = _ROUTE_POINT
        self._place: dict[str, str] = {}
        self._inside: list[str] = []
        self._stated: dict[str, str] = {}
        self._text: list[str] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take the start of an element; the parser calls this."""
        name = tag.rpartition("}")[2]
        self._text = []
        if self._inside:
            self._inside.append(name)
            return
        if name == _TRACK_POINT and self._kind == _ROUTE_POINT:
            # A device that was guided stores both; what was driven counts.
            self._kind, self.count, self.values = name, 0, array("d")
        if name == self._kind:
            self.count += 1
            if self.count > MAX_POINTS:
                raise RouteError(f"more than {MAX_POINTS} track points; allowed: 2 to {MAX_POINTS}")
            self._inside, self._place, self._stated = [name], attributes, {}

    def data(self, text: str) -> None:
        """Take text; the parser calls this."""
        self._text.append(text)

    def end(self, tag: str) -> None:  # noqa: ARG002
        """Take the end of an element; the parser calls this."""
        if not self._inside:
            return
        name = self._inside.pop()
        if not self._inside:
            self._take(f"track point {self.count}")
        elif len(self._inside) == 1 or (name == "speed" and _is_of_point(self._inside[-1])):
            # What else extensions hold is of sensors, the wind, a photo.
            self._stated.setdefault(name, "".join(self._text))
        self._text = []

    def _take(self, where: str) -> None:
        for name in ("time", "lat", "lon", "ele", "speed"):
            text = (self._place if name in {"lat", "lon"} else self._stated).get(name)
            by = seconds_of if name == "time" else cell_value
            self.values.append(self.texts.read(where, name, text, by))


def _is_of_point(element: str) -> bool:
    return element == "extensions" or element.startswith("TrackPointExtension")


FCD_SUFFIXES = (".xml", ".xml.gz", ".csv", ".csv.gz", ".parquet")
MAX_FCD_BYTES = 1_000_000_000
"""Of one vehicle only its own rows are kept."""
FCD_TIME, FCD_NAME = "timestep_time", "vehicle_id"
_LONGEST_ID = 200
_INVALID = -1e9
"""SUMO writes -1073741824 for what is not known."""


class _Vehicle(PlainXml):
    """Keeps the rows of one vehicle (the first one where none was named), and the names of all."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.names: dict[str, None] = {}
        self.rows: list[Mapping[str, Any]] = []
        self._time: str | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take an element; the parser calls this."""
        if tag == "timestep":
            self._time = attributes.get("time", "")
        elif tag == "vehicle" and self._time is not None:
            self.take(attributes.get("id", ""), lambda: {**attributes, "time": self._time})

    def take(self, name: str, row: Callable[[], Mapping[str, Any]]) -> None:
        """Take a row of a vehicle."""
        if len(name) > _LONGEST_ID:
            raise RouteError(
                f"a vehicle's id has {len(name)} characters; allowed: up to {_LONGEST_ID}"
            )
        self.names.setdefault(name)
        self.name = self.name or name
        if name == self.name:
            self.rows.append(row())


def read_fcd(path: Path, name: str) -> DriveTable:
    """Return the drive of a vehicle ("" for the only one) in SUMO's XML."""
    vehicle = _Vehicle(name)
    read_xml(path, MAX_FCD_BYTES, "SUMO FCD", vehicle)
    return _drive(path, vehicle, name)


def read_fcd_rows(path: Path, name: str, rows: Iterable[Mapping[str, Any]]) -> DriveTable:
    """Return the drive of a vehicle in rows of SUMO's CSV or Parquet: ``vehicle_x`` is x in its XML."""
    vehicle = _Vehicle(name)
    for row in rows:
        vehicle.take(
            str(row[FCD_NAME] or ""),
            lambda row=row: {
                key.partition("_")[2]: value for key, value in row.items() if value is not None
            },  # type: ignore[misc]
        )
    # Steps without a vehicle have an empty name.
    vehicle.names.pop("", None)
    return _drive(path, vehicle, name)


def _drive(path: Path, vehicle: _Vehicle, name: str) -> DriveTable:
    if not vehicle.rows:
        none = "it holds none; allowed: the output of --fcd-output"
        known = suggestion(name, vehicle.names) if vehicle.names else none
        raise RouteError(f"{path}: no vehicle {name!r}; {known}")
    if not name and len(vehicle.names) > 1:
        raise RouteError(
            f"{path} holds {len(vehicle.names)} vehicles; name one: {path}#{vehicle.name}"
        )
    source = f"{path}#{vehicle.name}"

    texts = Cells(source)

    def column(key: str, by: Callable[..., float] = cell_value) -> FloatArray:
        rows = enumerate(vehicle.rows, start=1)
        return np.array(
            [texts.read(f"row {at}", key, str(row.get(key, "")), by) for at, row in rows]
        )

    def number(key: str) -> FloatArray:
        values = column(key)
        return np.where(values < _INVALID, math.nan, values)

    columns = {"time_s": column("time", seconds_of), "speed_m_s": number("speed")}
    stated: set[str] = set().union(*vehicle.rows)
    if "slope" in stated:
        columns["slope_rad"] = np.radians(number("slope"))
    if {"x", "y"} <= stated:
        places = {"east_m": number("x"), "north_m": number("y")}
        is_geo = _in_degrees(columns["time_s"], columns["speed_m_s"], *places.values())
        names = ("longitude_deg", "latitude_deg") if is_geo else places
        columns |= dict(zip(names, places.values(), strict=True))
    if "z" in stated:
        columns["elevation_m"] = number("z")
    return DriveTable(
        source,
        columns,
        np.arange(1, len(vehicle.rows) + 1),
        "row",
        {name: (key, 1.0) for name, key in (("speed_m_s", "speed_m_s"), ("elevation_m", "z"))},
        notes=tuple(texts.notes(len(vehicle.rows), "row")),
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
