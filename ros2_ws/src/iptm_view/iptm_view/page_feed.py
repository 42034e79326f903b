"""What the page is told: bounded, shared by all browsers, and never waiting for one of them.

The feed keeps the rows of one trip and the newest document of each kind. A browser is a cursor into it and is
told what has changed since it last listened. So one that stops reading costs neither memory nor time. When it
reads again it goes on with what is left: of the rows those still kept, of each document the newest.
"""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

ROW_CAPACITY = 20_000
"""Rows kept; at one a second of trip time longer than the longest cycle."""
_OF_ONE_TRIP = ("plan", "end")
ROWS_AT_ONCE = 5_000
"""Rows told in one event at most; a browser that joins late is told a long trip in several."""


@dataclass(frozen=True)
class Cursor:
    """What a browser has been told.

    Attributes:
        trip: number of the trip, -1 for nothing yet.
        row: number of the next row of that trip.
        version: version of the newest document.
    """

    trip: int = -1
    row: int = 0
    version: int = 0


@dataclass(frozen=True)
class PageEvent:
    """One thing to tell: its kind, and its content as JSON text."""

    kind: str
    text: str


@dataclass
class _Trip:
    number: int = 0
    first_row: int = 0
    rows: list[str] = field(default_factory=list)
    documents: dict[str, tuple[int, str]] = field(default_factory=dict)


class PageFeed:
    """Rows and documents of the trip under way; every method may be called from any thread."""

    def __init__(self, capacity: int = ROW_CAPACITY) -> None:
        """Begin with an empty trip.

        Args:
            capacity: rows kept; older ones are dropped.
        """
        self._capacity = capacity
        self._trip = _Trip()
        self._version = 0
        self._changed = threading.Condition()

    @property
    def row_count(self) -> int:
        """Rows of this trip so far, dropped ones included."""
        with self._changed:
            return self._trip.first_row + len(self._trip.rows)

    def begin_trip(self) -> None:
        """Forget the rows and what belongs to one trip only, as a new one begins."""
        with self._changed:
            kept = {
                kind: known
                for kind, known in self._trip.documents.items()
                if kind not in _OF_ONE_TRIP
            }
            self._trip = _Trip(self._trip.number + 1, documents=kept)
            self._changed.notify_all()

    def add_row(self, values: Sequence[float]) -> None:
        """Append a row; a value that is not finite becomes null."""
        text = json_text(values)
        with self._changed:
            rows = self._trip.rows
            rows.append(text)
            # In blocks, so that dropping does not cost each row a shift of all others.
            if len(rows) >= 2 * self._capacity:
                self._trip.first_row += len(rows) - self._capacity
                del rows[: -self._capacity]
            self._changed.notify_all()

    def put(self, kind: str, document: Mapping[str, Any]) -> None:
        """Replace the document of a kind; one that did not change is not told again."""
        text = json_text(document)
        with self._changed:
            known = self._trip.documents.get(kind)
            if known is not None and known[1] == text:
                return
            self._version += 1
            self._trip.documents[kind] = (self._version, text)
            self._changed.notify_all()

    def changes(self, cursor: Cursor, timeout_s: float) -> tuple[Cursor, list[PageEvent]]:
        """Return what has happened since a cursor, and where that leaves it.

        Args:
            cursor: what was told already.
            timeout_s: wait for a change at most so long.

        Returns:
            The new cursor, and the events in the order to tell them, none after the timeout.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._is_news(cursor), timeout_s)
            return self._news(cursor)

    def _is_news(self, cursor: Cursor) -> bool:
        trip = self._trip
        return (
            trip.number != cursor.trip
            or trip.first_row + len(trip.rows) > cursor.row
            or self._version > cursor.version
        )

    def _news(self, cursor: Cursor) -> tuple[Cursor, list[PageEvent]]:
        trip, events = self._trip, []
        if trip.number != cursor.trip:
            cursor = Cursor(trip.number)
            events.append(PageEvent("trip", json_text({"trip": trip.number})))
        changed = [
            (version, kind)
            for kind, (version, _) in trip.documents.items()
            if version > cursor.version
        ]
        events += [PageEvent(kind, trip.documents[kind][1]) for _, kind in sorted(changed)]
        begin = max(cursor.row, trip.first_row)
        rows = trip.rows[begin - trip.first_row :][:ROWS_AT_ONCE]
        if rows:
            events.append(PageEvent("rows", f"[{','.join(rows)}]"))
        # Whoever hears of the end has heard all before it.
        events.sort(key=lambda event: event.kind == "end")
        return Cursor(trip.number, begin + len(rows), self._version), events


def json_text(content: Any) -> str:
    """Return JSON in one line, with null for numbers that are not finite."""
    return json.dumps(_finite(content), allow_nan=False, separators=(",", ":"), ensure_ascii=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return value
