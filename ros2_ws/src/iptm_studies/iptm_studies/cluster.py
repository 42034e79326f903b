"""Where runs are performed: a cluster of worker processes, and what these do around a run.

A worker keeps quiet, and ends itself when its run hangs: a solver in native code cannot be interrupted, so
that a run without progress for too long takes its process with it. The cluster starts a new one, and the run
is reported as failed.
"""

from __future__ import annotations

import io
import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, suppress
from dataclasses import dataclass

import dask
import distributed
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, Worker, WorkerPlugin, get_worker

from iptm_core.errors import ScenarioError
from iptm_studies.run import Run, perform_run
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind

CONNECT_TIMEOUT_S = 30.0
WAIT_FOR_WORKERS_S = 300.0
MAX_WORKERS = 1024
SETTINGS = {
    # A run that takes its worker down would do so again.
    "distributed.scheduler.allowed-failures": 0,
    # On a busy machine a worker that died takes its time to come back.
    "distributed.deploy.lost-worker-timeout": "10 minutes",
    # Suppress dask's event-loop warning: runs hold the interpreter for seconds.
    "distributed.admin.tick.limit": "1 hour",
    "distributed.comm.timeouts.connect": f"{CONNECT_TIMEOUT_S:g}s",
}


@dataclass(frozen=True)
class ClusterOptions:
    """Choice of the cluster.

    Attributes:
        scheduler: address of an existing scheduler; empty for an embedded cluster.
        workers: worker processes of the embedded cluster, None for one per core.
    """

    scheduler: str = ""
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and not 1 <= self.workers <= MAX_WORKERS:
            raise ScenarioError(f"workers is {self.workers}; allowed: 1 to {MAX_WORKERS}")
        if self.scheduler and self.workers is not None:
            raise ScenarioError("an existing cluster brings its own workers; leave --workers out")


@contextmanager
def connected(options: ClusterOptions) -> Iterator[Client]:
    """Give a client of the cluster; an embedded one ends with the block.

    Raises:
        ScenarioError: the scheduler does not answer at its address.
    """
    logging.getLogger("distributed").setLevel(logging.ERROR)
    with dask.config.set(SETTINGS):
        if options.scheduler:
            cluster = _existing(options.scheduler)
        else:
            cluster = _embedded(options.workers or CPU_COUNT)
        with cluster as client:
            yield client


def worker_threads(client: Client) -> int:
    """Return how many runs the cluster performs at the same time; waits until it has a worker.

    Raises:
        ScenarioError: it gets none in ``WAIT_FOR_WORKERS_S``.
    """
    try:
        client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS_S)
    except distributed.TimeoutError as error:
        raise ScenarioError(
            f"the cluster has had no worker for {WAIT_FOR_WORKERS_S:g} s; at least one is needed"
        ) from error
    threads: dict[str, int] = client.nthreads()
    return max(1, sum(threads.values()))


@contextmanager
def _embedded(workers: int) -> Iterator[Client]:
    with (
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        client.register_plugin(_LeaveStoppingToTheClient())
        yield client


class _LeaveStoppingToTheClient(WorkerPlugin):  # type: ignore[misc]  # Dask is typed in part
    """Ctrl-C reaches every process of the terminal; only the one with the store shall act on it."""

    name = "leave-stopping-to-the-client"

    def setup(self, worker: Worker) -> None:
        """Called in the main thread of a worker when it starts, and when it starts again."""
        del worker
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _existing(address: str) -> Iterator[Client]:
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ScenarioError(
            f"scheduler {address!r} does not answer ({error}); allowed: the address of a running "
            "Dask scheduler such as tcp://host:8786"
        ) from error
    with client:
        yield client


HANG_TOPIC = "iptm-hang"
LIMIT_S = {RunKind.CLOSED_LOOP: 300.0, RunKind.WHOLE_TRIP: 3600.0}
"""Longest time without progress. In a closed loop it is the compiler that takes longest."""
_CHECK_EVERY_S = 0.5
_REPORT_TIME_S = 2.0
_EXIT_CODE = 70


def work(inputs: RunInputs) -> Run:
    """Perform a run as a task of a worker process.

    Raises:
        IptmError: as for ``perform_run``.
    """
    # Libraries write warnings straight to the terminal, from every worker; outcomes are data.
    with (
        progress_watched(inputs.key, LIMIT_S[inputs.spec.kind]) as on_progress,
        redirect_stderr(io.StringIO()),
    ):
        return perform_run(inputs, on_progress)


@contextmanager
def progress_watched(key: str, limit_s: float) -> Iterator[Callable[[], None]]:
    """Give a function to call on progress; end the process when that does not happen for too long."""
    worker = get_worker()  # defined inside a task only
    over = threading.Event()
    last_s = time.monotonic()

    def on_progress() -> None:
        nonlocal last_s
        last_s = time.monotonic()

    def watch() -> None:
        while not over.wait(_CHECK_EVERY_S):
            if time.monotonic() - last_s > limit_s:
                with suppress(RuntimeError, OSError):
                    worker.log_event(HANG_TOPIC, {"key": key, "limit_s": limit_s})
                over.wait(_REPORT_TIME_S)
                os._exit(_EXIT_CODE)

    thread = threading.Thread(target=watch, name="watchdog", daemon=True)
    thread.start()
    try:
        yield on_progress
    finally:
        over.set()
        thread.join()
