"""Tracks from GPX files, with nothing but the standard library."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.plain_xml import finite_number, read_xml
from iptm_core.routes.track import Track

MAX_BYTES = 100_000_000
MAX_POINTS = 1_000_000


def read_gpx(path: Path) -> Track:
    """Read all points of all tracks of a file, in their order.

    Args:
        path: the file, GPX 1.0 or 1.1; names of elements count without their namespaces.

    Raises:
        RouteError: no such file, no XML, a document type, or a point that lacks place or time.
    """
    root = read_xml(path, MAX_BYTES, "GPX")
    points = [element for element in root.iter() if _name(element) == "trkpt"]
    if not 2 <= len(points) <= MAX_POINTS:
        raise RouteError(f"{path}: {len(points)} track points; allowed: 2 to {MAX_POINTS}")
    rows = np.array([_row(path, number, point) for number, point in enumerate(points, start=1)])
    heights, speeds = rows[:, 3], rows[:, 4]
    return Track(
        source=str(path),
        times_s=rows[:, 0] - rows[0, 0],
        latitudes_deg=rows[:, 1],
        longitudes_deg=rows[:, 2],
        heights_m=heights if np.isfinite(heights).all() else None,
        speeds_m_s=speeds if np.isfinite(speeds).all() else None,
    )


def _name(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _row(path: Path, number: int, point: ET.Element) -> tuple[float, ...]:
    """Return time, latitude, longitude, height and speed of a point; NaN for the last two if unknown."""
    texts = {_name(element): element.text or "" for element in point.iter() if element is not point}
    where = f"{path}, track point {number}"
    if "time" not in texts:
        raise RouteError(
            f"{where}: time is missing; a track that was driven has one at every point"
        )
    try:
        moment = datetime.fromisoformat(texts["time"].strip().replace("Z", "+00:00"))
    except ValueError:
        raise RouteError(f"{where}: time is {texts['time']!r}; allowed: ISO 8601") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    return (
        moment.timestamp(),
        finite_number(where, "lat", point.get("lat")),
        finite_number(where, "lon", point.get("lon")),
        finite_number(where, "ele", texts["ele"]) if "ele" in texts else float("nan"),
        finite_number(where, "speed", texts["speed"]) if "speed" in texts else float("nan"),
    )
