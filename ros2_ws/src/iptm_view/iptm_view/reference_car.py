"""The reference car on the same trip: computed by another process, shown as far as it has come."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress

from iptm_view.page_feed import REFERENCE, PageFeed
from iptm_view.run_facts import RunFacts

NO_REFERENCE = "none"
STATE = "reference_state"
"""Kind of the document with columns, strategy and state (computing, done, failed) of the reference car."""


class ReferenceCar:
    """Starts the process that drives the reference car, and passes its rows on to a feed.

    The process is given ``--strategy`` and, of a bag, ``--run``. It reads the settings of the trip as YAML
    from its standard input, and writes one JSON line with ``strategy``, ``columns`` and ``duration_s``, then
    one JSON array per row.
    """

    def __init__(self, feed: PageFeed, command: Sequence[str], strategy: str) -> None:
        self._feed = feed
        self._command = list(command) if strategy != NO_REFERENCE else []
        self._strategy = strategy
        self._settings = ""
        self._process: subprocess.Popen[str] | None = None

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
        threading.Thread(target=self._follow, args=(self._process, settings), daemon=True).start()
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
                if process is self._process:
                    self._feed.append_text(REFERENCE, line.strip())
            errors = process.stderr.read().strip().splitlines() or ["no reason given"]
        if process.wait() == 0:
            self._put(process, {**known, "state": "done"})
        else:
            self._put(process, {**known, "state": "failed", "reason": errors[-1]})

    def _put(self, process: subprocess.Popen[str], state: dict[str, object]) -> None:
        if process is self._process:
            self._feed.put(STATE, state)

    def close(self) -> None:
        """End the process if it is still running."""
        process, self._process = self._process, None
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()
