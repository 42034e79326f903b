"""Where runs are performed: a cluster of worker processes, embedded or existing."""

from __future__ import annotations

import logging
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import dask
import distributed
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, Worker, WorkerPlugin

from iptm_core.errors import ScenarioError

CONNECT_TIMEOUT_S = 30.0
WAIT_FOR_WORKERS_S = 300.0
MAX_WORKERS = 1024
SETTINGS = {
    # A run that takes its worker down would do so again.
    "distributed.scheduler.allowed-failures": 0,
    # On a busy machine a worker that died takes its time to come back.
    "distributed.deploy.lost-worker-timeout": "10 minutes",
    # Runs hold the interpreter for seconds; that is no news.
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
        ScenarioError: nobody answers at the address of the scheduler.
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
            f"scheduler {address!r} does not answer ({error}); allowed is the address of a running "
            "Dask scheduler such as tcp://host:8786"
        ) from error
    with client:
        yield client
