"""The data of the page: bounded, shared by all browsers, and never waiting for one of them.

The feed keeps streams, to which entries are appended (such as the rows of a trip), and the newest document of
each kind. A browser is a cursor into it and receives what has changed since its last read. So one that stops
reading costs neither memory nor time; when it reads again it continues with the entries still kept and the
newest documents.
"""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

CAPACITY = 20_000
"""Entries kept of each stream; at one a second of trip time longer than the longest cycle."""

ROWS, PLANS, EVENTS, REFERENCE, SAVINGS = STREAMS = (
    "rows",
    "plans",
    "events",
    "reference",
    "savings",
)
"""Rows of the trip, plans, changes of the diagnostics, rows of the reference car, and savings."""
END = "end"


@dataclass(frozen=True)
class Cursor:
    """What a browser has received.

    Attributes:
        generation: changes whenever entries are discarded, -1 for nothing received yet.
        version: version of the newest document.
        read: number of the next entry of each stream.
    """

    generation: int = -1
    version: int = 0
    read: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class PageEvent:
    """One event for a browser: its kind, and its content as JSON text."""

    kind: str
    text: str


@dataclass
class _Stream:
    """Entries as JSON texts; `first` is the number of the oldest one that is kept."""

    first: int = 0
    entries: list[str] = field(default_factory=list)

    @property
    def next(self) -> int:
        return self.first + len(self.entries)


class PageFeed:
    """Streams and documents of one vehicle; every method may be called from any thread."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._generation = 0
        self._version = 0
        self._streams = {name: _Stream() for name in STREAMS}
        self._documents: dict[str, tuple[int, str]] = {}
        self._changed = threading.Condition()

    @property
    def row_count(self) -> int:
        """Rows of this trip, dropped ones included."""
        with self._changed:
            return self._streams[ROWS].next

    def begin_trip(self) -> None:
        """Discard what belongs to one trip only."""
        self.discard(ROWS, PLANS, EVENTS, END)

    def discard(self, *kinds: str) -> None:
        """Discard streams and documents; every browser receives all the others again."""
        with self._changed:
            for kind in kinds:
                self._documents.pop(kind, None)
                if kind in self._streams:
                    self._streams[kind] = _Stream()
            self._generation += 1
            self._changed.notify_all()

    def append(self, stream: str, content: Sequence[float] | Mapping[str, Any]) -> None:
        """Append an entry; numbers that are not finite become null."""
        self.append_text(stream, json_text(content))

    def append_text(self, stream: str, text: str) -> None:
        """Append an entry that is JSON text already."""
        with self._changed:
            kept = self._streams[stream]
            kept.entries.append(text)
            # In blocks, so that dropping does not cost each entry a shift of all others.
            if len(kept.entries) >= 2 * self._capacity:
                kept.first += len(kept.entries) - self._capacity
                del kept.entries[: -self._capacity]
            self._changed.notify_all()

    def put(self, kind: str, document: Mapping[str, Any]) -> None:
        """Replace the document of a kind; an unchanged one is not sent again."""
        text = json_text(document)
        with self._changed:
            known = self._documents.get(kind)
            if known is not None and known[1] == text:
                return
            self._version += 1
            self._documents[kind] = (self._version, text)
            self._changed.notify_all()

    def changes(self, cursor: Cursor, timeout_s: float) -> tuple[Cursor, list[PageEvent]]:
        """Return what has changed since a cursor, and the new cursor."""
        with self._changed:
            self._changed.wait_for(lambda: self._has_changed(cursor), timeout_s)
            return self._changes(cursor)

    def _has_changed(self, cursor: Cursor) -> bool:
        return (
            self._generation != cursor.generation
            or self._version > cursor.version
            or any(kept.next > cursor.read.get(name, 0) for name, kept in self._streams.items())
        )

    def _changes(self, cursor: Cursor) -> tuple[Cursor, list[PageEvent]]:
        events: list[PageEvent] = []
        if self._generation != cursor.generation:
            cursor = Cursor(self._generation)
            events.append(PageEvent("trip", json_text({"trip": self._generation})))
        changed = [
            (version, kind)
            for kind, (version, _) in self._documents.items()
            if version > cursor.version
        ]
        events += [PageEvent(kind, self._documents[kind][1]) for _, kind in sorted(changed)]
        for name, kept in self._streams.items():
            new = kept.entries[max(0, cursor.read.get(name, 0) - kept.first) :]
            if new:
                events.append(PageEvent(name, f"[{','.join(new)}]"))
        # The end comes after all that happened before it.
        events.sort(key=lambda event: event.kind == END)
        read = {name: kept.next for name, kept in self._streams.items()}
        return Cursor(self._generation, self._version, read), events


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
