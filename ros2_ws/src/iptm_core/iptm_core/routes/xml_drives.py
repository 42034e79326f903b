"""Drives in XML, read with the standard library only: GPX, and SUMO's floating car data (``--fcd-output``).

Where a vehicle of SUMO drives is known from a file written with ``--fcd-output.geo``, whose places are
degrees; else the slope of its road alone.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.csv_table import CsvTable, finite_number
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.track import Track, read_out, road_through
from iptm_core.state import FloatArray
from iptm_core.user_input import read_file, shown, suggestion


class PlainXml:
    """Base of what takes the elements of a file; see `xml.etree.ElementTree.XMLParser`.

    It refuses document types, and with them entities that blow up or read other files.
    """

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:  # noqa: ARG002
        """Refuse; the parser calls this before it reads any entity."""
        raise RouteError(f"document type {name!r}; allowed: none, no drive needs one")


def read_xml(path: Path, most_bytes: int, kind: str, target: PlainXml) -> None:
    """Give the elements of a file to a target; a file of another kind is refused."""
    content = read_file(path, most_bytes, RouteError)
    try:
        parser = ET.XMLParser(target=target)  # noqa: S314 - entities are refused
        ET.fromstring(content, parser)  # noqa: S314
    except RouteError as reason:
        raise RouteError(f"{path}: {reason}") from None
    except (ValueError, LookupError, ET.ParseError) as reason:
        raise RouteError(f"{path}: cannot be read ({reason}); a {kind} file is needed") from reason


MAX_GPX_BYTES = 100_000_000
MAX_POINTS = 1_000_000
_TRACK_POINT, _ROUTE_POINT = "trkpt", "rtept"


def read_gpx(path: Path) -> Track:
    """Read all points of all tracks of a file, in their order.

    Of points with one time, as where laps of a device meet, the first counts. Pauses are cut (see
    `Track.without_pauses`).

    Args:
        path: the file, GPX 1.0 or 1.1; names of elements count without their namespaces.
    """
    return _track(path, _rows(path))


def read_gpx_road(path: Path) -> tuple[RoadLine, SlopeProfile | None]:
    """Read the road of a recorded drive or a plan without times; no slope where a point has no height."""
    rows = _rows(path)
    if np.isfinite(rows[:, 0]).any():
        drive = read_out(_track(path, rows))
        return drive.line, drive.slope
    return road_through(str(path), rows[:, 1], rows[:, 2], _all_or_none(rows[:, 3]))


def _rows(path: Path) -> FloatArray:
    points = _Points()
    read_xml(path, MAX_GPX_BYTES, "GPX", points)
    if points.count < 2:
        raise RouteError(f"{path}: {points.count} track points; allowed: 2 to {MAX_POINTS}")
    return np.array(points.values).reshape(points.count, -1)


def _track(path: Path, rows: FloatArray) -> Track:
    timed = np.isfinite(rows[:, 0])
    if not timed.any():
        raise RouteError(
            f"{path}: time is missing at all points, so it is a road and no drive; allowed: as slope "
            "of another cycle"
        )
    if not timed.all():
        raise RouteError(
            f"{path}, track point {int(np.argmin(timed)) + 1}: time is missing; allowed: a time at every "
            "point, or at none"
        )
    rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) != 0.0])]
    return Track.without_pauses(
        str(path),
        rows[:, 0] - rows[0, 0],
        rows[:, 1],
        rows[:, 2],
        _all_or_none(rows[:, 3]),
        _all_or_none(rows[:, 4]),
    )


def _all_or_none(values: FloatArray) -> FloatArray | None:
    return values if np.isfinite(values).all() else None


class _Points(PlainXml):
    """Reads points as they come, so that a large file takes little memory.

    Attributes:
        count: points so far.
        values: time, latitude, longitude, height and speed of each, one after the other.
    """

    def __init__(self) -> None:
        self.count = 0
        self.values = array("d")
        self._kind = _ROUTE_POINT
        self._place: dict[str, str] | None = None
        self._texts: dict[str, list[str]] = {}
        self._text: list[str] | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take the start of an element; the parser calls this."""
        name = _name(tag)
        if name == _TRACK_POINT and self._kind == _ROUTE_POINT:
            # A device that was guided stores both; what was driven counts.
            self._kind, self.count, self.values = name, 0, array("d")
        if name == self._kind:
            self.count += 1
            if self.count > MAX_POINTS:
                raise RouteError(f"more than {MAX_POINTS} track points; allowed: 2 to {MAX_POINTS}")
            self._place = attributes
            self._texts = {}
        elif self._place is not None:
            self._text = self._texts[name] = []

    def data(self, text: str) -> None:
        """Take text; the parser calls this."""
        if self._text is not None:
            self._text.append(text)

    def end(self, tag: str) -> None:
        """Take the end of an element; the parser calls this."""
        self._text = None
        if _name(tag) == self._kind and self._place is not None:
            texts = {name: "".join(parts) for name, parts in self._texts.items()}
            self.values.extend(_row(f"track point {self.count}", self._place, texts))
            self._place = None


def _name(tag: str) -> str:
    return tag.rpartition("}")[2]


def _row(where: str, place: Mapping[str, str], texts: Mapping[str, str]) -> tuple[float, ...]:
    """Return time, latitude, longitude, height and speed of a point; NaN for what is missing."""
    return (
        _timestamp_s(where, texts["time"]) if "time" in texts else float("nan"),
        finite_number(where, "lat", place.get("lat")),
        finite_number(where, "lon", place.get("lon")),
        finite_number(where, "ele", texts["ele"]) if "ele" in texts else float("nan"),
        finite_number(where, "speed", texts["speed"]) if "speed" in texts else float("nan"),
    )


def _timestamp_s(where: str, text: str) -> float:
    try:
        moment = datetime.fromisoformat(text.strip().replace("Z", "+00:00"))
    except ValueError:
        raise RouteError(f"{where}: time is {shown(text)}; allowed: ISO 8601") from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()


FCD_SUFFIX = ".xml"
MAX_FCD_BYTES = 1_000_000_000
"""Of one vehicle only its own rows are kept."""
_LONGEST_ID = 200
_DEGREES_PER_M = 1e-3
"""Places that move by less for each metre driven are degrees; by metres of a plane they move by 1."""


class _Vehicle(PlainXml):
    """Keeps the rows of one vehicle (the first one where none was named), and the names of all."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.names: dict[str, None] = {}
        self.rows: list[dict[str, str]] = []
        self._time = ""

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take an element; the parser calls this."""
        if tag == "timestep":
            self._time = attributes.get("time", "")
        elif tag == "vehicle":
            name = attributes.get("id", "")
            if len(name) > _LONGEST_ID:
                raise RouteError(
                    f"a vehicle's id has {len(name)} characters; allowed: up to {_LONGEST_ID}"
                )
            self.names.setdefault(name)
            self.name = self.name or name
            if name == self.name:
                self.rows.append({**attributes, "time": self._time})


def read_fcd(path: Path, name: str) -> CsvTable:
    """Return the drive of a vehicle ("" for the only one).

    Columns are ``time_s`` and ``speed_m_s``, and as far as available ``latitude_deg``, ``longitude_deg`` and
    ``elevation_m``, or ``slope_rad``.
    """
    vehicle = _Vehicle(name)
    read_xml(path, MAX_FCD_BYTES, "SUMO FCD", vehicle)
    if not vehicle.rows:
        known = suggestion(name, vehicle.names) if vehicle.names else "it holds none"
        raise RouteError(f"{path}: no vehicle {name!r}; {known}")
    if not name and len(vehicle.names) > 1:
        raise RouteError(
            f"{path} holds {len(vehicle.names)} vehicles; name one: {path}#{vehicle.name}"
        )
    source = f"{path}#{vehicle.name}"

    def column(key: str) -> FloatArray:
        return np.array(
            [
                finite_number(f"{source}, row {index}", key, row.get(key))
                for index, row in enumerate(vehicle.rows, start=1)
            ]
        )

    columns = {"time_s": column("time"), "speed_m_s": column("speed")}
    first = vehicle.rows[0]
    if {"x", "y"} <= first.keys():
        longitudes, latitudes = column("x"), column("y")
        distance_m = float(np.diff(columns["time_s"]) @ columns["speed_m_s"][1:])
        if np.hypot(np.diff(longitudes), np.diff(latitudes)).sum() < _DEGREES_PER_M * distance_m:
            columns |= {"latitude_deg": latitudes, "longitude_deg": longitudes}
    if "latitude_deg" in columns:
        columns |= {"elevation_m": column("z")} if "z" in first else {}
    elif "slope" in first:
        columns["slope_rad"] = np.radians(column("slope"))
    return CsvTable(source, columns, tuple(range(1, len(vehicle.rows) + 1)), "row")
