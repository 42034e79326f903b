"""Performs what a campaign needs and the store does not have."""

from __future__ import annotations

import heapq
import itertools
import queue
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Protocol

from distributed import Client, Future, KilledWorker

from iptm_core.errors import IptmError, ScenarioError
from iptm_studies.campaign import Campaign, PlannedRun
from iptm_studies.cluster import ClusterOptions, connected, worker_threads
from iptm_studies.expected_time import ExpectedTimes
from iptm_studies.single_run import FinishedRun
from iptm_studies.store import ResultStore
from iptm_studies.stored_run import StoredRun, stored_run
from iptm_studies.worker import STALL_TOPIC, work

REFRESH_S = 5.0
WAIT_FOR_WORKERS_S = 300.0

Perform = Callable[..., FinishedRun]


class Observer(Protocol):
    """Is told how the work goes on."""

    def planned(self, run: PlannedRun, expected_s: float) -> None:
        """A run has to be performed."""

    def finished(self, run: PlannedRun, expected_s: float, stored: StoredRun) -> None:
        """A run was performed and stored."""

    def failed(self, run: PlannedRun, expected_s: float, cause: str) -> None:
        """A run failed."""

    def remaining(self, seconds: float) -> None:
        """Expected wall time until the end."""


@dataclass(frozen=True)
class Outcome:
    """How a campaign ended.

    Attributes:
        computed: runs performed now.
        found: runs that the store had.
        failed: runs that failed.
        wall_s: wall time.
    """

    computed: int
    found: int
    failed: int
    wall_s: float


def admit(
    campaign: Campaign, store: ResultStore, times: ExpectedTimes
) -> tuple[list[PlannedRun], int]:
    """Sort the runs that have become known into those to perform and those that the store has.

    Returns:
        Runs to perform, and the number of runs found.
    """
    missing: list[PlannedRun] = []
    found = 0
    while new := campaign.take():
        for run in new:
            stored = store.find(run.key)
            if stored is None:
                missing.append(run)
                continue
            found += 1
            times.learn(stored.spec, len(stored.trajectory) - 1, stored.record.wall.total_s)
            campaign.finish(run.key, stored.metrics)
    return missing, found


def survey(campaign: Campaign, store: ResultStore, times: ExpectedTimes) -> list[PlannedRun]:
    """Compare a campaign with the store, without computing anything.

    A run that failed the last time counts as failed, with its cause.

    Returns:
        The runs that the store lacks, failed ones included, the longest first.
    """
    lacking: list[PlannedRun] = []
    while new := admit(campaign, store, times)[0]:
        lacking += new
        for run in new:
            if cause := store.failure(run.key):
                campaign.fail(run.key, cause)
    return sorted(lacking, key=lambda run: -times.of(run.inputs))


def execute(
    campaign: Campaign,
    store: ResultStore,
    options: ClusterOptions,
    observer: Observer,
    perform: Perform = work,
) -> Outcome:
    """Perform all missing runs of a campaign, the longest first.

    A run that fails is noted with its cause and leaves the others alone. Results travel back to this
    process, which stores each as soon as it is there: whatever ends this early, the store stays sound and
    the next call goes on from there.

    Args:
        campaign: what is needed.
        store: what is there.
        options: where to perform it.
        observer: is told how it goes on.
        perform: what a worker does with a run.

    Raises:
        ScenarioError: the cluster cannot be reached.
        StoreError: the store cannot be written.
    """
    began = time.perf_counter()
    work = _Work(campaign, store, observer, perform)
    work.admit()
    if work.pending:
        with connected(options) as client:
            work.run(client)
    return Outcome(work.computed, work.found, work.failed, time.perf_counter() - began)


class _Work:
    """The runs that wait, and those that a worker has."""

    def __init__(
        self, campaign: Campaign, store: ResultStore, observer: Observer, perform: Perform
    ) -> None:
        self._campaign = campaign
        self._store = store
        self._observer = observer
        self._perform = perform
        self._times = ExpectedTimes()
        self._order = itertools.count()
        self._completed: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._flying: dict[Future, tuple[PlannedRun, float]] = {}
        self.pending: list[tuple[float, int, PlannedRun]] = []
        self.computed = self.found = self.failed = 0

    def admit(self) -> None:
        """Queue the runs that have become known."""
        missing, found = admit(self._campaign, self._store, self._times)
        self.found += found
        for run in missing:
            expected_s = self._times.of(run.inputs)
            heapq.heappush(self.pending, (-expected_s, next(self._order), run))
            self._observer.planned(run, expected_s)

    def run(self, client: Client) -> None:
        """Keep the workers busy until nothing is left."""
        seen = time.monotonic()
        while self.pending or self._flying:
            workers = worker_threads(client)
            if workers:
                seen = time.monotonic()
                self._fill(client, workers)
                self._observer.remaining(self._remaining_s(workers))
            elif time.monotonic() - seen > WAIT_FOR_WORKERS_S:
                raise ScenarioError(
                    f"the cluster has had no worker for {WAIT_FOR_WORKERS_S:g} s; at least one is needed"
                )
            try:
                future = self._completed.get(timeout=REFRESH_S)
            except queue.Empty:
                continue
            run, expected_s = self._flying.pop(future)
            self._settle(client, future, run, expected_s)
            future.release()
            self.admit()
        self._observer.remaining(0.0)

    def _fill(self, client: Client, places: int) -> None:
        # No more than can be performed at once: a run that waits on a worker would die with it, and it
        # would not be the longest one left when its turn comes.
        while self.pending and len(self._flying) < places:
            minus_expected_s, order, run = heapq.heappop(self.pending)
            future = client.submit(
                self._perform,
                run.inputs,
                run.key,
                key=f"{run.address}-{run.key}",
                pure=False,
                priority=-order,
            )
            self._flying[future] = (run, -minus_expected_s)
            future.add_done_callback(self._completed.put)

    def _settle(self, client: Client, future: Future, run: PlannedRun, expected_s: float) -> None:
        cause = _cause(client, future, run.key)
        if cause:
            self.failed += 1
            self._campaign.fail(run.key, cause)
            self._store.note_failure(run.key, run.inputs.spec, cause)
            self._observer.failed(run, expected_s, cause)
            return
        finished: FinishedRun = future.result()
        now = datetime.now(timezone.utc).isoformat(timespec="seconds")
        stored = stored_run(run.key, run.inputs, finished, now)
        self._store.save(stored)
        self._times.learn(run.inputs.spec, run.inputs.ticks, stored.record.wall.total_s)
        self._campaign.finish(run.key, stored.metrics)
        self.computed += 1
        self._observer.finished(run, expected_s, stored)

    def _remaining_s(self, workers: int) -> float:
        waiting = sum(self._times.of(run.inputs) for _, _, run in self.pending)
        # Of those in flight, half of the work is done on average.
        flying = sum(0.5 * self._times.of(run.inputs) for run, _ in self._flying.values())
        return (waiting + flying) / workers


def _cause(client: Client, future: Future, key: str) -> str:
    """Why a run failed, in one line; empty if it did not."""
    if future.status == "finished":
        return ""
    if future.cancelled():
        return "the run was cancelled by the cluster"
    error = future.exception()
    text = " ".join(str(error).split())
    if isinstance(error, IptmError):
        return text
    if isinstance(error, KilledWorker):
        return _why_killed(client, key)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _why_killed(client: Client, key: str) -> str:
    for _, event in client.get_events(STALL_TOPIC):
        if event.get("key") == key:
            patience_s = event["patience_s"]
            return (
                f"the run hung: no sign of life for {patience_s:g} s (a solver that never returns)"
            )
    return "its worker process died (out of memory, killed, or a crash in a library)"
