"""FIT files of sports computers, read with fitdecode."""

from __future__ import annotations

import io
from importlib import import_module
from typing import Any

from iptm_drives.receivers import TRACK, Columns, columns_of_rows

_DEGREES = 180.0 / 2**31
_HEIGHTS, _SPEEDS = ("enhanced_altitude", "altitude"), ("enhanced_speed", "speed")


def fit(content: bytes) -> tuple[Columns, list[str]]:
    """Return time, place, height and speed of the records, up to where the file is damaged, and notes."""
    fitdecode = import_module("fitdecode")
    rows: list[list[str]] = []
    notes: list[str] = []
    try:
        with fitdecode.FitReader(io.BytesIO(content)) as frames:
            messages = (each for each in frames if isinstance(each, fitdecode.FitDataMessage))
            rows.extend(_row(each) for each in messages if each.name == "record")
    except fitdecode.FitError as reason:
        if not rows:
            raise
        notes = [f"damaged behind record {len(rows)} ({reason})"]
    return columns_of_rows((*TRACK, "speed [m/s]"), rows), notes


def _row(frame: Any) -> list[str]:
    def first(*names: str) -> Any:
        found = (frame.get_value(name, fallback=None) for name in names)
        return next((value for value in found if value is not None), None)

    when, *place = (first(name) for name in ("timestamp", "position_lat", "position_long"))
    degrees = ["" if each is None else f"{float(each) * _DEGREES:.8f}" for each in place]
    numbers = ["" if each is None else str(each) for each in (first(*_HEIGHTS), first(*_SPEEDS))]
    return [when.isoformat() if hasattr(when, "isoformat") else "", *degrees, *numbers]
