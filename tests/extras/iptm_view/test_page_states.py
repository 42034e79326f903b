"""The page of a run with a silent controller or bridge, opened late, or beside another run.

In a window of a desktop, one of 900 pixels, and a phone in dark colours. With IPTM_PAGE_PICTURES=FOLDER
pictures of all are kept there.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.extras.iptm_view.screenshot import Picture

from iptm_view.judged_feed import JudgedFeed
from iptm_view.page_feed import END, ROWS, STREAMS, Cursor, PageEvent, PageFeed
from iptm_view.page_row import PAGE_COLUMNS
from iptm_view.page_server import PageServer
from iptm_view.reference_car import put_stored_run
from iptm_view.sources import BagSource

pytestmark = pytest.mark.integration
LOOKS = {
    "desktop": Picture(),
    "900": Picture(900, 900),
    "phone": Picture(390, 844, is_dark=True),
}
LAST_S = 61.0
"""Time of the last decision, or of the last word of the bridge."""
OPENED_S = 40.0
_OF_DECISION = ("status_code", "fallback_rung", "solve_time_s", "iterations", "preview_age_s")

Row = dict[str, float]


@pytest.fixture(scope="module")
def recorded(bag: Path) -> list[PageEvent]:
    """What a page of the example bag is sent."""
    feed = PageFeed()
    with BagSource(bag) as source:
        source.load(feed, source.facts)
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    return events


def changed(recorded: list[PageEvent], change: Callable[[Row], Row | None]) -> PageFeed:
    """Return the feed of a run that goes on, with other rows."""
    feed = PageFeed()
    for event in recorded:
        content = json.loads(event.text)
        if event.kind == ROWS:
            for values in content:
                row = change(dict(zip(PAGE_COLUMNS, values, strict=True)))
                if row is not None:
                    feed.append(ROWS, [math.nan if each is None else each for each in row.values()])
        elif event.kind in STREAMS:
            for entry in content:
                feed.append(event.kind, entry)
        elif event.kind not in {END, "trip"}:
            feed.put(event.kind, content)
    return feed


def undecided(row: Row) -> Row:
    silent = row["time_s"] > LAST_S
    return {**row, **dict.fromkeys(_OF_DECISION, math.nan)} if silent else row


@pytest.fixture(params=LOOKS)
def look(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def opened(visitor: Any, look: str) -> Iterator[Callable[[PageFeed, str], Any]]:
    """What shows a feed, checks that nothing lies outside of the window, and keeps a picture."""
    shown: list[Any] = []

    def show(feed: PageFeed, name: str, wait_for: str) -> Any:
        server = closing(PageServer({"": feed}, 0))
        visit = visitor(server.thing.url, LOOKS[look])
        shown.extend((visit, server))
        page = visit.__enter__().page
        page.wait_for_selector(wait_for)
        assert page.evaluate("document.documentElement.scrollWidth") <= LOOKS[look].width
        if folder := os.environ.get("IPTM_PAGE_PICTURES"):
            page.screenshot(path=str(Path(folder) / f"{name}_{look}.png"), full_page=True)
        return page

    yield show
    for each in shown:
        each.__exit__(None, None, None)


def test_a_dead_controller_is_named_in_the_headline(recorded: Any, opened: Any) -> None:
    feed = changed(recorded, undecided)
    page = opened(feed, "dead_controller", "#connection:text-is('live; no decision since 61 s')")
    assert page.get_attribute("#connection", "data-level") == "warn"
    page.wait_for_selector("#decision:text-is('no decision since 61 s')")
    assert page.get_attribute("#decision", "data-level") == "silent"


def test_a_silent_bridge_turns_grey_with_its_age(recorded: Any, opened: Any) -> None:
    feed = changed(recorded, lambda row: row)
    status = {"level": "OK", "reason": "previews are published", "values": {}}
    heard = {"/bridge": LAST_S, "/controller": 120.0}
    statuses = [
        {"name": name, **status, "heard_s": at_s, "every_s": 1.0} for name, at_s in heard.items()
    ]
    feed.put("statuses", {"statuses": statuses})
    page = opened(feed, "silent_bridge", "#statuses .level:text-is('silent for 59 s')")
    (silent,) = page.query_selector_all("#statuses .level[data-level='silent']")
    assert silent.inner_text() == "silent for 59 s"
    assert page.inner_text("#connection") == "live"


def test_a_page_that_is_opened_late_states_since_when_it_counts(recorded: Any, opened: Any) -> None:
    feed = changed(recorded, lambda row: row if row["time_s"] >= OPENED_S else None)
    page = opened(feed, "late_page", "body[data-rows='81']")
    assert f"since {OPENED_S:.0f} s" in page.inner_text("#figures")


def test_two_bags_are_both_named(bag: Path, opened: Any) -> None:
    feed = JudgedFeed()
    put_stored_run(feed, bag)
    with BagSource(bag) as source:
        feed.parameters = source.facts.parameters
        source.load(feed, source.facts)
    page = opened(feed, "two_bags", "body[data-ended='true']")
    page.wait_for_selector(f"#saved-note:has-text('{bag.name}')")
    assert "reference" not in page.inner_text("main")
    # It went by faster than its nodes report.
    assert "silent" not in page.inner_text("#statuses")
