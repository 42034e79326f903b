"""A run as one file, and another run in the place of the reference car."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import pytest
from tests.extras.iptm_view.screenshot import Picture
from tests.extras.iptm_view.test_page_in_browser import assert_shows

from iptm_core.errors import ViewError
from iptm_core.trajectory import Trajectory
from iptm_view.judged_feed import JudgedFeed
from iptm_view.page_feed import Cursor
from iptm_view.page_server import PAGE, save_page, stored_page
from iptm_view.reference_car import put_stored_run
from iptm_view.sources import BagSource


@pytest.fixture(scope="module")
def feed(bag: Path) -> JudgedFeed:
    """A run beside itself."""
    found = JudgedFeed()
    put_stored_run(found, bag)
    with BagSource(bag) as source:
        found.parameters = source.facts.parameters
        source.load(found, source.facts)
    return found


def test_a_run_against_itself_saves_nothing(feed: JudgedFeed, bag: Path) -> None:
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    held = {event.kind: json.loads(event.text) for event in events}
    assert held["reference"] == held["rows"]
    assert held["reference_state"]["run"] == bag.name
    assert held["savings"][-1]["energy"]["as_driven"].endswith("as driven 0.0 % saved")


def test_a_stored_page_holds_everything(feed: JudgedFeed) -> None:
    text = stored_page(feed)
    (held,) = re.findall(r'id="stored">(.*?)</script>', text, re.DOTALL)
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    assert json.loads(held) == [[event.kind, json.loads(event.text)] for event in events]
    (imports,) = re.findall(r'type="importmap">(.*?)</script>', text)
    modules = json.loads(imports)["imports"]
    codes = [b64decode(data.partition(",")[2]).decode() for data in modules.values()]
    needed = re.findall(r'^import .* from "(.*)";$', "\n".join([*codes, text]), re.MULTILINE)
    assert set(needed) == set(modules) == {file.stem for file in PAGE.glob("*.js")} - {"view"}
    links = re.findall(r'\b(?:src|href)="([^"]+)"', text)
    assert [link.partition(",")[0] for link in links] == ["data:image/svg+xml;base64"]


def test_a_file_that_exists_is_kept(feed: JudgedFeed, tmp_path: Path) -> None:
    (tmp_path / "run.html").write_text("mine")
    with pytest.raises(ViewError, match=r"run\.html exists already; allowed: a new file"):
        save_page(feed, tmp_path / "run.html")


@pytest.mark.integration
def test_a_stored_page_plays_without_a_server(
    feed: JudgedFeed, driven: Trajectory, visitor: Any, tmp_path: Path
) -> None:
    file = tmp_path / "run.html"
    save_page(feed, file)
    with visitor(file.as_uri(), Picture()) as visit:
        visit.page.wait_for_selector("body[data-ended='true']")
        visit.page.evaluate("window.iptmPlayer.follow()")
        visit.wait_for_clock("120.0 / 120 s")
        assert_shows(visit, driven, -1)
        assert visit.page.inner_text("#value-speed-other-car").endswith("(this car +0.0)")
        assert visit.page.inner_text("#connection") == "stored run"
        assert visit.complaints == []
        assert {asked.partition(":")[0] for asked in visit.requests} <= {"file", "data"}
