"""What the page shows of two runs at their end."""

from __future__ import annotations

import json
from dataclasses import asdict

from tests.extras.iptm_view.test_judged_feed import rows_of, savings

import iptm
from iptm_view.judged_feed import JudgedFeed
from iptm_view.page_feed import END, REFERENCE, ROWS
from iptm_view.page_row import PAGE_COLUMNS
from iptm_view.reference_car import STATE
from iptm_view.reference_drive import COLUMNS


def last_savings(own: iptm.Run, other: iptm.Run) -> str:
    """Return the savings of a run over another as JSON."""
    feed = JudgedFeed()
    feed.parameters = own.parameters
    feed.put(STATE, {"state": "known", "strategy": "reference", "columns": list(COLUMNS)})
    for stream, run, columns in ((REFERENCE, other, COLUMNS), (ROWS, own, tuple(PAGE_COLUMNS))):
        for row in rows_of(run.trajectory, columns):
            feed.append(stream, row)
    feed.put(END, {"ended": True})
    found = own.saving(other).repeated
    if found is not None:
        state = {"state": "done", "strategy": "reference", "columns": list(COLUMNS)}
        feed.put(STATE, {**state, "repeated": [asdict(each) for each in found]})
    return json.dumps(savings(feed)[-1])
