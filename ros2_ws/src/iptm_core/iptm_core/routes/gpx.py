"""Tracks from GPX files, with nothing but the standard library."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.plain_xml import PlainXml, finite_number, read_xml
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.track import Track, read_out, road_through
from iptm_core.state import FloatArray
from iptm_core.strict_mapping import shown

MAX_BYTES = 100_000_000
MAX_POINTS = 1_000_000
_TRACK_POINT, _ROUTE_POINT = "trkpt", "rtept"


def read_gpx(path: Path) -> Track:
    """Read all points of all tracks of a file, in their order.

    Of points with one time, as where laps of a device meet, the first counts. Pauses are cut (see
    `Track.without_pauses`).

    Args:
        path: the file, GPX 1.0 or 1.1; names of elements count without their namespaces.

    Raises:
        RouteError: no such file, no XML, a document type, or a point that lacks place or time.
    """
    return _track(path, _rows(path))


def read_gpx_road(path: Path) -> tuple[RoadLine, SlopeProfile | None]:
    """Read the road of a recorded drive, or of a plan without times: its tracks, or its routes.

    Returns:
        Course and slope; None for the latter where a point has no height.

    Raises:
        RouteError: as for `read_gpx`, but for times that are missing at all points.
    """
    rows = _rows(path)
    if np.isfinite(rows[:, 0]).any():
        drive = read_out(_track(path, rows))
        return drive.line, drive.slope
    return road_through(str(path), rows[:, 1], rows[:, 2], _all_or_none(rows[:, 3]))


def _rows(path: Path) -> FloatArray:
    points = _Points()
    read_xml(path, MAX_BYTES, "GPX", points)
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
