"""The feed behind the page: complete for who listens, bounded for who does not."""

from __future__ import annotations

import json
import math
import threading
from typing import Any

from iptm_view.page_feed import Cursor, PageFeed


def received(feed: PageFeed, cursor: Cursor = Cursor()) -> tuple[Cursor, dict[str, Any]]:  # noqa: B008
    """Return what a browser receives after a cursor, by kind."""
    cursor, events = feed.changes(cursor, timeout_s=0.0)
    return cursor, {event.kind: json.loads(event.text) for event in events}


def test_a_browser_is_told_everything_once() -> None:
    feed = PageFeed()
    feed.put("road", {"height_m": [1.0]})
    feed.append("rows", [0.0, math.nan])
    cursor, first = received(feed)
    assert first["rows"] == [[0.0, None]]
    assert first["road"] == {"height_m": [1.0]}
    feed.append("rows", [1.0, 2.0])
    feed.put("road", {"height_m": [1.0]})
    cursor, second = received(feed, cursor)
    assert second == {"rows": [[1.0, 2.0]]}
    assert received(feed, cursor)[1] == {}
    assert received(feed)[1]["rows"] == [[0.0, None], [1.0, 2.0]]


def test_rows_that_nobody_reads_are_dropped_oldest_first() -> None:
    feed = PageFeed(capacity=10)
    stalled, _ = received(feed)
    for k in range(1000):
        feed.append("rows", [float(k)])
        feed.put("plan", {"k": k})
    _, late = received(feed, stalled)
    rows = [row[0] for row in late["rows"]]
    assert 10 <= len(rows) <= 20
    assert rows == [float(k) for k in range(1000 - len(rows), 1000)]
    assert late["plan"] == {"k": 999}
    assert feed.row_count == 1000


def test_a_new_trip_begins_with_an_empty_page_but_road_and_reference_stay() -> None:
    feed = PageFeed()
    feed.put("road", {"height_m": [1.0]})
    feed.append("plans", {"time_s": [5.0]})
    feed.append("reference", [7.0])
    feed.append("rows", [9.0])
    feed.put("end", {"ended": True})
    cursor, _ = received(feed)
    feed.begin_trip()
    feed.append("rows", [0.0])
    _, again = received(feed, cursor)
    assert again["rows"] == [[0.0]]
    assert again.keys() == {"trip", "road", "reference", "rows"}
    assert again["road"] == {"height_m": [1.0]}


def test_the_end_is_told_last() -> None:
    feed = PageFeed()
    feed.put("end", {"ended": True})
    feed.append("rows", [1.0])
    feed.put("road", {})
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    assert [event.kind for event in events] == ["trip", "road", "rows", "end"]


def test_a_waiting_browser_is_woken() -> None:
    feed = PageFeed()
    cursor, _ = received(feed)
    heard: list[str] = []

    def listen() -> None:
        _, events = feed.changes(cursor, timeout_s=60.0)
        heard.extend(event.kind for event in events)

    thread = threading.Thread(target=listen)
    thread.start()
    feed.append("rows", [1.0])
    thread.join(timeout=120.0)
    assert heard == ["rows"]
