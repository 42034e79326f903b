"""Tracks of receivers, watches and loggers: TCX, KML, NMEA, GeoJSON, RaceChrono, VBOX, OziExplorer."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as ET

from iptm_core.errors import RouteError

Columns = Mapping[str, list[str]]
TRACK = ("time", "latitude", "longitude", "altitude [m]")
_KNOT = "speed [kn]"


def _local(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _parsed(content: bytes) -> ET.Element:
    if b"<!DOCTYPE" in content[:4096]:
        raise RouteError("document type in XML; allowed: none, no drive needs one")
    return ET.fromstring(content)  # noqa: S314  without document types there are no entities


def tcx(content: bytes) -> Columns:
    """Read the points of a sports watch (TCX)."""
    names = ("Time", "LatitudeDegrees", "LongitudeDegrees", "AltitudeMeters", "Speed")
    points = [each for each in _parsed(content).iter() if _local(each) == "Trackpoint"]
    rows = []
    for point in points:
        texts = {_local(each): (each.text or "").strip() for each in point.iter()}
        rows.append([texts.get(name, "") for name in names])
    return columns_of_rows((*TRACK, "speed [m/s]"), rows)


def kml(content: bytes) -> Columns:
    """Read the tracks of a KML file."""
    rows: list[list[str]] = []
    for track in (each for each in _parsed(content).iter() if _local(each) == "Track"):
        whens = [each.text or "" for each in track if _local(each) == "when"]
        places = [(each.text or "").split() for each in track if _local(each) == "coord"]
        rows += [
            [when, *(place[1], place[0], place[2] if len(place) > 2 else "")]
            for when, place in zip(whens, places, strict=False)
            if len(place) > 1
        ]
    return columns_of_rows(TRACK, rows)


def nmea(content: bytes) -> Columns:
    """Read the sentences RMC and GGA of a receiver."""
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
    return columns_of_rows(
        (*TRACK, _KNOT),
        [[when, lat, lon, heights.get(clock, ""), knots] for clock, when, lat, lon, knots in rows],
    )


def _degrees(text: str, side: str) -> str:
    """Return ``ddmm.mmmm`` and a side as degrees."""
    whole, _, _ = text.partition(".")
    degrees = float(whole[:-2] or 0) + float(text[len(whole) - 2 :]) / 60.0
    return f"{-degrees if side in {'S', 'W'} else degrees:.8f}"


def geojson(content: bytes) -> Columns:
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
    return columns_of_rows(TRACK, rows)


_RACECHRONO = ("timestamp", "latitude", "longitude", "altitude", "speed")


def racechrono(content: bytes) -> Columns:
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
    return columns_of_rows(heads, [[row[place] for place in chosen.values()] for row in body])


_VBOX = {
    "time": "time",
    "lat": "latitude",
    "long": "longitude",
    "velocity": "speed [km/h]",
    "height": "altitude [m]",
}


def vbox(content: bytes) -> Columns:
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


def columns_of_rows(names: Iterable[str], rows: list[list[str]]) -> Columns:
    """Return columns by name, without those that have no value."""
    columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=False)) if rows else {}
    return {name: values for name, values in columns.items() if any(values)}


_OZI_HEAD = 6


def ozi(content: bytes) -> Columns:
    """Read a track of OziExplorer: six lines of head, then place, flag, height in feet and days."""
    lines = content.decode("latin-1").splitlines()[_OZI_HEAD:]
    rows = [row for line in lines if len(row := [cell.strip() for cell in line.split(",")]) > 4]
    names = ("latitude", "longitude", "altitude [ft]", "time [days]")
    return columns_of_rows(names, [[*row[:2], *row[3:5]] for row in rows])
