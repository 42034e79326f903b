"""Files of other programs that are no tables: what they are, and the drives in those that can be read.

A file is named by how it begins, not by its suffix. Most are read with the standard library, workbooks and
Arrow files by pandas where its readers are installed.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_drives.column_names import columns_table

Columns = Mapping[str, list[str]]
_TRACK = ("time", "latitude", "longitude", "altitude [m]")
_KNOT = "speed [kn]"


def read_foreign(path: Path, content: bytes) -> DriveTable | None:
    """Return the drive in the content of a file of another program; None for one of text.

    Raises:
        RouteError: the file is of a kind that is not read, or has no drive; the message names the kind.
    """
    head = content[:4096].lstrip(b"\xef\xbb\xbf \r\n\t")
    for kind, begins, read in _KINDS:
        if not re.match(begins, head, re.DOTALL):
            continue
        if read is None:
            raise RouteError(f"{path} is {kind}, which is not read; allowed: {_INSTEAD}")
        try:
            found = read(content)
        except RouteError:
            raise
        except ImportError as reason:
            raise RouteError(
                f"{path} is {kind}, which is not read without {reason.name}; allowed: {_INSTEAD}"
            ) from None
        except Exception as reason:  # the readers have error types of their own
            raise RouteError(f"{path} is {kind}, and cannot be read ({reason})") from reason
        rows = max(map(len, found.values()), default=0)
        if not rows:
            raise RouteError(f"{path} is {kind} without a point that has a time; allowed: a drive")
        return columns_table(found, str(path))
    return None


_INSTEAD = "a table saved as CSV, or a GPX track"


def _local(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _parsed(content: bytes) -> ET.Element:
    if b"<!DOCTYPE" in content[:4096]:
        raise RouteError("document type in XML; allowed: none, no drive needs one")
    return ET.fromstring(content)  # noqa: S314  without document types there are no entities


def _tcx(content: bytes) -> Columns:
    names = ("Time", "LatitudeDegrees", "LongitudeDegrees", "AltitudeMeters", "Speed")
    points = [each for each in _parsed(content).iter() if _local(each) == "Trackpoint"]
    rows = []
    for point in points:
        texts = {_local(each): (each.text or "").strip() for each in point.iter()}
        rows.append([texts.get(name, "") for name in names])
    return _columns((*_TRACK, "speed [m/s]"), rows)


def _kml(content: bytes) -> Columns:
    rows: list[list[str]] = []
    for track in (each for each in _parsed(content).iter() if _local(each) == "Track"):
        whens = [each.text or "" for each in track if _local(each) == "when"]
        places = [(each.text or "").split() for each in track if _local(each) == "coord"]
        rows += [
            [when, *(place[1], place[0], place[2] if len(place) > 2 else "")]
            for when, place in zip(whens, places, strict=False)
            if len(place) > 1
        ]
    return _columns(_TRACK, rows)


def _nmea(content: bytes) -> Columns:
    heights: dict[str, str] = {}
    rows = []
    for line in content.decode("ascii", errors="replace").splitlines():
        cells = line.partition("*")[0].split(",")
        if cells[0][3:] == "GGA" and len(cells) > 9:
            heights[cells[1]] = cells[9]
        elif cells[0][3:] == "RMC" and len(cells) > 9 and cells[2] == "A" and len(cells[9]) == 6:
            clock, date = cells[1], cells[9]
            when = f"20{date[4:]}-{date[2:4]}-{date[:2]}T{clock[:2]}:{clock[2:4]}:{clock[4:]}Z"
            rows.append([clock, when, _degrees(*cells[3:5]), _degrees(*cells[5:7]), cells[7]])
    return _columns(
        (*_TRACK, _KNOT),
        [[when, lat, lon, heights.get(clock, ""), knots] for clock, when, lat, lon, knots in rows],
    )


def _degrees(text: str, side: str) -> str:
    """Return ``ddmm.mmmm`` and a side as degrees."""
    whole, _, _ = text.partition(".")
    degrees = float(whole[:-2] or 0) + float(text[len(whole) - 2 :]) / 60.0
    return f"{-degrees if side in {'S', 'W'} else degrees:.8f}"


def _geojson(content: bytes) -> Columns:
    """Read points with times, as trackers add them to the coordinates or to the properties of a line."""
    document = json.loads(content)
    rows: list[list[str]] = []
    for feature in document.get("features", [document]):
        named = feature.get("properties") or {}
        stated = named.get("coordTimes") or (named.get("coordinateProperties") or {}).get("times")
        places = (feature.get("geometry") or {}).get("coordinates") or []
        rows += [
            [str(when), str(place[1]), str(place[0]), str(place[2]) if len(place) > 2 else ""]
            for when, place in zip(stated or [], places, strict=False)
        ]
    return _columns(_TRACK, rows)


_RACECHRONO = ("timestamp", "latitude", "longitude", "altitude", "speed")


def _racechrono(content: bytes) -> Columns:
    """Read a table whose header has three rows: names, units, and where each is from."""
    rows = list(csv.reader(io.StringIO(content.decode("utf-8-sig", errors="replace"))))
    start = next(place for place, row in enumerate(rows) if row[:1] == ["timestamp"])
    names, units = rows[start], rows[start + 1]
    chosen = {name: names.index(name) for name in _RACECHRONO if name in names}
    heads = [
        "time" if name == "timestamp" else f"{name} [{units[place]}]"
        for name, place in chosen.items()
    ]
    body = [row for row in rows[start + 3 :] if len(row) == len(names)]
    return _columns(heads, [[row[place] for place in chosen.values()] for row in body])


_VBOX = {
    "time": "time",
    "lat": "latitude",
    "long": "longitude",
    "velocity": "speed [km/h]",
    "height": "altitude [m]",
}


def _vbox(content: bytes) -> Columns:
    """Read a file of VBOX: times as hhmmss, places in minutes, west positive."""
    sections = re.split(r"(?m)^\[(.+?)\]\s*$", content.decode("latin-1"))
    found = dict(zip(sections[1::2], sections[2::2], strict=True))
    names = found["column names"].split()
    chosen = {_VBOX[name]: names.index(name) for name in names if name in _VBOX}
    rows = [row for line in found["data"].splitlines() if len(row := line.split()) == len(names)]
    columns = {name: [row[place] for row in rows] for name, place in chosen.items()}
    columns["time"] = [f"{text[:2]}:{text[2:4]}:{text[4:]}" for text in columns["time"]]
    for name, sign in (("latitude", 1.0), ("longitude", -1.0)):
        columns[name] = [f"{sign * float(text) / 60.0:.8f}" for text in columns[name]]
    return columns


def _columns(names: Iterable[str], rows: list[list[str]]) -> Columns:
    """Return columns by name, without those that have no value."""
    columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=False)) if rows else {}
    return {name: values for name, values in columns.items() if any(values)}


def _by_pandas(reader: str, module: str) -> Callable[[bytes], Mapping[str, Any]]:
    def read(content: bytes) -> Mapping[str, Any]:
        import importlib  # noqa: PLC0415  few files need it

        import pandas as pd  # noqa: PLC0415  a second of its own

        importlib.import_module(module)
        frame = getattr(pd, reader)(io.BytesIO(content))
        return {str(name): frame[name].to_numpy() for name in frame}

    return read


_KINDS: tuple[tuple[str, bytes, Callable[[bytes], Mapping[str, Any]] | None], ...] = (
    ("a TCX file of a sports watch", rb".{0,200}<TrainingCenterDatabase", _tcx),
    ("a KML file", rb".{0,200}<kml", _kml),
    ("a log of NMEA sentences", rb"[$!][A-Z]{2}[A-Z]{3},", _nmea),
    ("a GeoJSON file", rb"\{.{0,200}\"(Feature|FeatureCollection|LineString)\"", _geojson),
    ("a JSON file", rb"[\[{]\s*[\"{\[]", None),
    ("a FIT file of a sports computer", rb"[\x0c\x0e].{7}\.FIT", None),
    ("a pointer of Git LFS in the place of the file", rb"version https://git-lfs", None),
    ("an Excel workbook (xlsx)", rb"PK\x03\x04.{0,4000}(xl/|\[Content_Types\]|docProps)",
     _by_pandas("read_excel", "openpyxl")),
    ("a zip archive", rb"PK\x03\x04", None),
    ("an Excel workbook (xls)", rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", None),
    ("an Arrow file (Feather)", rb"ARROW1", _by_pandas("read_feather", "pyarrow")),
    ("an HDF5 file", rb"\x89HDF", None),
    ("a MATLAB file", rb"MATLAB 5\.0", None),
    ("a VBOX file (.vbo)", rb"File created on .{0,80}\[header\]", _vbox),
    ("a file of RaceChrono", rb"This file is created using RaceChrono", _racechrono),
    ("an XML file of another kind than GPX, TCX and KML", rb"<\?xml|<!DOCTYPE|<html", None),
)  # fmt: skip
"""Name of a kind, how its files begin, and what reads their columns; None where nothing does."""
