"""The reference car on the same trip, driven without ROS by a process of its own."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from contextlib import suppress

from iptm_view.page_feed import PageFeed
from iptm_view.run_facts import RunFacts

MODULE = "iptm_bringup.reference_drive"
"""Known by name only, as the nodes are: it drives a scenario and writes the curve as JSON."""
NO_REFERENCE = "none"


class ReferenceCurve:
    """Has the reference driven and gives it to a feed when it is there."""

    def __init__(self, strategy: str) -> None:
        """Set up; nothing is driven yet.

        Args:
            strategy: of the reference car, "none" for no such car.
        """
        self._strategy = strategy
        self._scenario = ""
        self._process: subprocess.Popen[str] | None = None

    def start(self, facts: RunFacts) -> RunFacts:
        """Begin to drive the trip of a run, unless it has been begun already.

        Args:
            facts: what is known of the run.

        Returns:
            The facts, with a note where there will be no curve.
        """
        if self._strategy == NO_REFERENCE:
            return facts
        scenario = facts.trip_scenario()
        if scenario is None:
            return facts.with_note(
                "no reference car: cycle and duration of the plant are not known, "
                "or the leader does not drive the cycle"
            )
        if scenario == self._scenario:
            return facts
        self.close()
        self._scenario = scenario
        command = [sys.executable, "-m", MODULE, "--strategy", self._strategy]
        self._process = subprocess.Popen(  # noqa: S603 - the project's own module
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        if self._process.stdin is not None:
            with suppress(BrokenPipeError):
                self._process.stdin.write(scenario)
                self._process.stdin.close()
        return facts

    def deliver(self, feed: PageFeed) -> str | None:
        """Put the curve into a feed if it is there.

        Returns:
            Why there will be none; "" when it was delivered, None while it is not there.
        """
        process = self._process
        if process is None or process.stdout is None or process.stderr is None:
            return None
        if process.poll() is None and not _has_output(process.stdout.fileno()):
            return None
        text, said = process.stdout.read(), process.stderr.read()
        process.wait()
        self.close()
        if process.returncode != 0:
            lines = said.strip().splitlines() or ["no reason given"]
            return f"no reference car: {lines[-1]}"
        feed.put("reference", json.loads(text))
        return ""

    def wait(self, feed: PageFeed, timeout_s: float) -> str | None:
        """Deliver the curve when it is there; see `deliver`."""
        if self._process is not None and self._process.stdout is not None:
            select.select([self._process.stdout], [], [], timeout_s)
        return self.deliver(feed)

    def close(self) -> None:
        """End the drive if it still goes on."""
        process, self._process = self._process, None
        if process is None:
            return
        if process.poll() is None:
            process.kill()
        process.wait()
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def _has_output(descriptor: int) -> bool:
    """Return whether the process has begun to write its answer (or closed its end)."""
    return bool(select.select([descriptor], [], [], 0.0)[0])
