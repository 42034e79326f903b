"""Performs what a campaign needs and the store does not have."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

import distributed
from distributed import Client, Future, KilledWorker

from iptm_core.errors import IptmError
from iptm_studies.campaign import Campaign
from iptm_studies.cluster import HANG_TOPIC, ClusterOptions, connected, work, worker_threads
from iptm_studies.run import Run
from iptm_studies.run_inputs import RunInputs
from iptm_studies.store import ResultStore

REFRESH_S = 5.0


class Observer(Protocol):
    """Receives the progress of the work."""

    def planned(self, inputs: RunInputs, expected_s: float) -> None:
        """A run has to be performed."""

    def finished(self, inputs: RunInputs, run: Run) -> None:
        """A run was performed and stored."""

    def failed(self, inputs: RunInputs, cause: str) -> None:
        """A run failed."""

    def remaining(self, seconds: float) -> None:
        """Expected wall time until the end."""


def admit(campaign: Campaign, store: ResultStore) -> list[RunInputs]:
    """Note which of the runs that have become known the store has; return the others."""
    missing: list[RunInputs] = []
    while new := campaign.take():
        for inputs in new:
            run = store.find(inputs.key)
            if run is None:
                missing.append(inputs)
            else:
                campaign.finish(run)
    return missing


def survey(campaign: Campaign, store: ResultStore) -> list[RunInputs]:
    """Compare a campaign with the store, without computing anything.

    A run that failed the last time is reported as failed, with its cause.

    Returns:
        The runs that the store lacks, failed ones included, the longest first.
    """
    lacking: list[RunInputs] = []
    while new := admit(campaign, store):
        lacking += new
        for inputs in new:
            if cause := store.failure(inputs.key):
                campaign.fail(inputs.key, cause)
    return sorted(lacking, key=campaign.expected.of, reverse=True)


def execute(
    campaign: Campaign,
    store: ResultStore,
    options: ClusterOptions,
    observer: Observer,
    perform: Callable[[RunInputs], Run] = work,
) -> int:
    """Perform all missing runs of a campaign, the longest first.

    Each run is stored as soon as it is done, so that an interrupted campaign goes on where it stopped. A
    run that fails is noted and does not stop the others. No cluster is needed if nothing is missing.

    Args:
        campaign: the runs.
        store: where results are found and put.
        options: where to perform them.
        observer: notified of every run.
        perform: performs a run on a worker.

    Returns:
        The number of runs performed; the other runs of the campaign were found in the store.

    Raises:
        ScenarioError: the scheduler does not answer, or the cluster has no workers.
        StoreError: the store cannot be written.
    """
    execution = _Execution(campaign, store, observer, perform)
    if execution.waiting:
        with connected(options) as client:
            execution.run(client)
    return execution.computed


class _Execution:
    """The runs that wait, and those that a worker has."""

    def __init__(
        self,
        campaign: Campaign,
        store: ResultStore,
        observer: Observer,
        perform: Callable[[RunInputs], Run],
    ) -> None:
        self._campaign = campaign
        self._store = store
        self._observer = observer
        self._perform = perform
        self._running: dict[Future, RunInputs] = {}
        self.waiting: list[RunInputs] = []
        self.computed = 0
        self._admit()

    def run(self, client: Client) -> None:
        """Keep the workers busy until nothing is left."""
        while self.waiting or self._running:
            places = worker_threads(client)
            self._fill(client, places)
            self._observer.remaining(self._remaining_s(places))
            with suppress(distributed.TimeoutError, distributed.CancelledError):
                distributed.wait(
                    list(self._running), timeout=REFRESH_S, return_when="FIRST_COMPLETED"
                )
            for future in [future for future in self._running if future.done()]:
                self._settle(client, future, self._running.pop(future))
            self._admit()
        self._observer.remaining(0.0)

    def _admit(self) -> None:
        """Queue the runs that have become known, the longest first."""
        expected = self._campaign.expected
        for inputs in admit(self._campaign, self._store):
            self.waiting.append(inputs)
            self._observer.planned(inputs, expected.of(inputs))
        self.waiting.sort(key=expected.of, reverse=True)

    def _fill(self, client: Client, places: int) -> None:
        # No more than can be performed at once: a run that waits on a worker would die with it, and it
        # would not be the longest one left when its turn comes.
        while self.waiting and len(self._running) < places:
            inputs = self.waiting.pop(0)
            name = f"{inputs.address}-{inputs.key}"
            future = client.submit(self._perform, inputs, key=name, pure=False)
            self._running[future] = inputs

    def _settle(self, client: Client, future: Future, inputs: RunInputs) -> None:
        if cause := _cause(client, future, inputs.key):
            self._campaign.fail(inputs.key, cause)
            self._store.note_failure(inputs.key, cause)
            self._observer.failed(inputs, cause)
        else:
            run: Run = future.result()
            self._store.save(run)
            self._campaign.finish(run)
            self.computed += 1
            self._observer.finished(inputs, run)
        future.release()

    def _remaining_s(self, places: int) -> float:
        expected = self._campaign.expected
        waiting_s = sum(expected.of(inputs) for inputs in self.waiting)
        # Of those in progress, half of the work is done on average.
        running_s = sum(0.5 * expected.of(inputs) for inputs in self._running.values())
        return (waiting_s + running_s) / places


def _cause(client: Client, future: Future, key: str) -> str:
    """Return why a run failed, in one line; empty if it did not."""
    if future.status == "finished":
        return ""
    if future.cancelled():
        return "the run was cancelled by the cluster"
    error = future.exception()
    text = " ".join(str(error).split())
    if isinstance(error, IptmError):
        return text
    if isinstance(error, KilledWorker):
        hangs = {event["key"]: event["limit_s"] for _, event in client.get_events(HANG_TOPIC)}
        if key in hangs:
            return f"the run hung: no progress for {hangs[key]:g} s (a solver that never returns)"
        return "its worker process died (out of memory, killed, or a crash in a library)"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
