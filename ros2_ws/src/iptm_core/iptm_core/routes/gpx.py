"""Tracks from GPX files, with nothing but the standard library."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.plain_xml import PlainXml, finite_number, read_xml
from iptm_core.routes.track import Track
from iptm_core.strict_mapping import shown

MAX_BYTES = 100_000_000
MAX_POINTS = 1_000_000


def read_gpx(path: Path) -> Track:
    """Read all points of all tracks of a file, in their order.

    Args:
        path: the file, GPX 1.0 or 1.1; names of elements count without their namespaces.

    Raises:
        RouteError: no such file, no XML, a document type, or a point that lacks place or time.
    """
    points = _Points()
    read_xml(path, MAX_BYTES, "GPX", points)
    if points.count < 2:
        raise RouteError(f"{path}: {points.count} track points; allowed: 2 to {MAX_POINTS}")
    rows = np.array(points.values).reshape(points.count, -1)
    heights, speeds = rows[:, 3], rows[:, 4]
    return Track(
        source=str(path),
        times_s=rows[:, 0] - rows[0, 0],
        latitudes_deg=rows[:, 1],
        longitudes_deg=rows[:, 2],
        heights_m=heights if np.isfinite(heights).all() else None,
        speeds_m_s=speeds if np.isfinite(speeds).all() else None,
    )


class _Points(PlainXml):
    """Reads points as they come, so that a large file takes little memory.

    Attributes:
        count: points so far.
        values: time, latitude, longitude, height and speed of each, one after the other.
    """

    def __init__(self) -> None:
        self.count = 0
        self.values = array("d")
        self._place: dict[str, str] | None = None
        self._texts: dict[str, list[str]] = {}
        self._text: list[str] | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take the start of an element; the parser calls this."""
        name = _name(tag)
        if name == "trkpt":
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
        if _name(tag) == "trkpt" and self._place is not None:
            texts = {name: "".join(parts) for name, parts in self._texts.items()}
            self.values.extend(_row(f"track point {self.count}", self._place, texts))
            self._place = None


def _name(tag: str) -> str:
    return tag.rpartition("}")[2]


def _row(where: str, place: Mapping[str, str], texts: Mapping[str, str]) -> tuple[float, ...]:
    """Return time, latitude, longitude, height and speed of a point; NaN for the last two if unknown."""
    if "time" not in texts:
        raise RouteError(
            f"{where}: time is missing; a track that was driven has one at every point"
        )
    try:
        moment = datetime.fromisoformat(texts["time"].strip().replace("Z", "+00:00"))
    except ValueError:
        raise RouteError(f"{where}: time is {shown(texts['time'])}; allowed: ISO 8601") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    return (
        moment.timestamp(),
        finite_number(where, "lat", place.get("lat")),
        finite_number(where, "lon", place.get("lon")),
        finite_number(where, "ele", texts["ele"]) if "ele" in texts else float("nan"),
        finite_number(where, "speed", texts["speed"]) if "speed" in texts else float("nan"),
    )
