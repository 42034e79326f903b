"""The reference car of the view: rows of another process as they come, and why there are none."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from iptm_view.page_feed import Cursor, PageFeed
from iptm_view.reference_car import STATE, ReferenceCar
from iptm_view.run_facts import RunFacts, facts_of_nodes

TRIP = {"plant": {"cycle": "nycc", "duration_s": 3.0}}
FACTS = RunFacts("test", nodes=TRIP, is_complete=True)
HEADER = {"strategy": "reference", "columns": ["time_s"], "duration_s": 3.0}


def command(program: str) -> list[str]:
    return [sys.executable, "-c", f"import json, sys\nheader = {HEADER!r}\n{program}"]


def followed(feed: PageFeed, until: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the documents and streams of a feed when a condition holds for them."""
    found: dict[str, Any] = {}
    cursor = Cursor()
    while not until(found):
        cursor, events = feed.changes(cursor, timeout_s=60.0)
        assert events, found
        for event in events:
            content = json.loads(event.text)
            known = found.get(event.kind, [])
            found[event.kind] = [*known, *content] if isinstance(content, list) else content
    return found


def test_rows_arrive_while_the_trip_is_still_driven() -> None:
    feed = PageFeed()
    program = """
assert "cycle: nycc" in sys.stdin.read()
for entry in (header, [0.0], [1.0]):
    print(json.dumps(entry), flush=True)
import time
time.sleep(3600)
"""
    car = ReferenceCar(feed, command(program), "reference")
    assert car.start(FACTS) is FACTS
    found = followed(feed, lambda seen: len(seen.get("reference", [])) == 2)
    assert found["reference"] == [[0.0], [1.0]]
    assert found[STATE] == {"state": "computing", **HEADER}
    car.close()


def test_the_options_of_the_process_and_its_end(tmp_path: Path) -> None:
    feed = PageFeed()
    program = """
header["strategy"] = " ".join(sys.argv[1:])
print(json.dumps(header))
"""
    car = ReferenceCar(feed, command(program), "aging")
    car.start(RunFacts("bag", nodes=TRIP, run=tmp_path, is_complete=True))
    found = followed(feed, lambda seen: seen.get(STATE, {}).get("state") == "done")
    assert found[STATE]["strategy"] == f"--strategy=aging --run={tmp_path}"
    car.close()


def test_a_failure_is_shown_with_its_reason() -> None:
    feed = PageFeed()
    car = ReferenceCar(feed, command("sys.exit('no such cycle')"), "reference")
    car.start(FACTS)
    found = followed(feed, lambda seen: seen.get(STATE, {}).get("state") == "failed")
    assert found[STATE]["reason"] == "no such cycle"
    car.close()


def test_without_a_trip_there_is_none_and_a_note() -> None:
    feed = PageFeed()
    car = ReferenceCar(feed, ["/nonexistent"], "reference")
    (*_, note) = car.start(facts_of_nodes("graph", {})).notes
    assert "no reference car" in note
    assert ReferenceCar(feed, ["/nonexistent"], "none").start(FACTS) is FACTS
    assert ReferenceCar(feed, [], "reference").start(FACTS) is FACTS
