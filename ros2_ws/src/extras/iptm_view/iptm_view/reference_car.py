"""The reference car on the same trip: computed by another process, shown as far as it has come."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from iptm_view.page_feed import REFERENCE, ROWS, Cursor, PageFeed
from iptm_view.page_row import PAGE_COLUMNS
from iptm_view.run_facts import RunFacts
from iptm_view.sources import BagSource

NO_REFERENCE = "none"
STATE = "reference_state"
"""Kind of the document with columns, strategy and state (computing, done, failed) of the reference car."""


class ReferenceCar:
    """Starts the process that drives the reference car, and passes its rows on to a feed.

    The process is given ``--strategy`` and, of a bag, ``--run``. It reads the settings of the trip as YAML
    from its standard input, and writes one JSON line with ``strategy``, ``columns`` and ``duration_s``, then
    one JSON array per row, and perhaps another object.
    """

    def __init__(self, feed: PageFeed, command: Sequence[str], strategy: str) -> None:
        self._feed = feed
        self._command = list(command) if strategy != NO_REFERENCE else []
        self._strategy = strategy
        self._settings = ""
        self._process: subprocess.Popen[str] | None = None
        self._follower: threading.Thread | None = None

    def start(self, facts: RunFacts) -> RunFacts:
        """Begin to drive the trip of a run, unless that has been started already."""
        if not self._command:
            return facts
        settings = facts.trip_settings()
        if settings is None:
            return facts.with_note(
                "no reference car: cycle and duration of the plant are not known, "
                "or the leader does not drive the cycle"
            )
        if settings == self._settings:
            return facts
        self.close()
        self._settings = settings
        self._feed.discard(REFERENCE)
        self._feed.put(STATE, {"state": "computing", "strategy": self._strategy, "columns": []})
        self._process = subprocess.Popen(  # noqa: S603 - the project's own module
            [
                *self._command,
                f"--strategy={self._strategy}",
                *([] if facts.run is None else [f"--run={facts.run}"]),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        of_process = (self._process, settings)
        self._follower = threading.Thread(target=self._follow, args=of_process, daemon=True)
        self._follower.start()
        return facts

    def _follow(self, process: subprocess.Popen[str], settings: str) -> None:
        if process.stdin is None or process.stdout is None or process.stderr is None:
            return
        with process.stdout, process.stderr:
            with suppress(BrokenPipeError), process.stdin:
                process.stdin.write(settings)
            header = process.stdout.readline()
            known = {"state": "computing", **json.loads(header)} if header else {"columns": []}
            self._put(process, known)
            for line in process.stdout:
                if line.startswith("{"):  # of the whole trip, after its rows
                    known |= json.loads(line)
                elif process is self._process:
                    self._feed.append_text(REFERENCE, line.strip())
            errors = process.stderr.read().strip().splitlines() or ["no reason given"]
        if process.wait() == 0:
            self._put(process, {**known, "state": "done"})
        else:
            self._put(process, {**known, "state": "failed", "reason": errors[-1]})

    @property
    def is_computing(self) -> bool:
        """Whether rows are still to come."""
        thread = self._follower
        return thread is not None and thread.is_alive()

    def _put(self, process: subprocess.Popen[str], state: dict[str, object]) -> None:
        if process is self._process:
            self._feed.put(STATE, state)

    def close(self) -> None:
        """End the process if it is still running."""
        process, self._process = self._process, None
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()


def put_stored_run(feed: PageFeed, bag: Path) -> None:
    """Put the run of a bag into a feed in the place of the reference car."""
    other = PageFeed()
    with BagSource(bag) as source:
        source.load(other, source.facts)
    state = {"state": "done", "run": bag.resolve().name, "columns": list(PAGE_COLUMNS)}
    feed.put(STATE, state)
    _, events = other.changes(Cursor(), timeout_s=0.0)
    for row in (row for event in events if event.kind == ROWS for row in json.loads(event.text)):
        feed.append(REFERENCE, row)
