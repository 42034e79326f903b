"""Tasks in processes, one for each: what dies or hangs in native code takes no other task with it."""

from __future__ import annotations

import io
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from iptm_core.errors import IptmError, ScenarioError

MAX_WORKERS = 1024
DIED = "its process died (out of memory, killed, or a crash in a library)"
_CHECK_EVERY_S = 0.5
_CONTEXT = multiprocessing.get_context("forkserver")

Item = TypeVar("Item")
Result = TypeVar("Result")
OnProgress = Callable[[], None]


@dataclass(frozen=True)
class Failed:
    """The outcome of a task without a result, with its cause in one line."""

    cause: str


def worker_count(workers: int | None) -> int:
    """Return a number of processes, by default one per core that this process may use.

    Raises:
        ScenarioError: out of range.
    """
    if workers is None:
        return len(os.sched_getaffinity(0))
    if not 1 <= workers <= MAX_WORKERS:
        raise ScenarioError(f"workers is {workers}; allowed: 1 to {MAX_WORKERS}")
    return workers


def perform_all(
    task: Callable[[Item, OnProgress], Result],
    waiting: list[Item],
    workers: int,
    limit_s: Callable[[Item], float] = lambda _: math.inf,
) -> Iterator[tuple[Item, Result | Failed]]:
    """Perform a task for every item and yield the outcomes in the order in which they come.

    Ctrl-C does not reach the processes; they are stopped when the iterator is closed.

    Args:
        task: function of a module, looked up by its name in the process; it calls its second argument on
            progress.
        waiting: the items, the next one first. They are taken out; more may be put in between outcomes.
        workers: number of processes at a time.
        limit_s: longest time without progress, after which an item counts as failed.
    """
    running: list[_Running[Item]] = []
    # Imported once, by the process from which those of the tasks are forked.
    _CONTEXT.set_forkserver_preload(["iptm.studies.execution", task.__module__])
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                item = waiting.pop(0)
                running.append(_Running(task, item, limit_s(item)))
            wait([one.receiver for one in running], timeout=_CHECK_EVERY_S)
            for one in list(running):
                if (outcome := one.outcome()) is not None:
                    running.remove(one)
                    one.stop()
                    yield one.item, outcome
    finally:
        for one in running:
            one.stop()


class _Running(Generic[Item]):
    """A task in progress."""

    def __init__(self, task: Callable[..., Any], item: Item, limit_s: float) -> None:
        self.item, self._limit_s = item, limit_s
        self.receiver, sender = _CONTEXT.Pipe(duplex=False)
        self._process = _CONTEXT.Process(target=_work, args=(task, item, sender), daemon=True)
        # The process from which others are forked hands on what it does with Ctrl-C.
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            self._process.start()
        finally:
            signal.signal(signal.SIGINT, handler)
        sender.close()
        self._progress_s = time.monotonic()

    def outcome(self) -> Any | Failed | None:
        """Return the result or the failure, None for neither yet."""
        while self.receiver.poll():
            try:
                outcome = self.receiver.recv()
            except EOFError:
                return Failed(DIED)
            if outcome is not None:
                return outcome
            self._progress_s = time.monotonic()
        if time.monotonic() - self._progress_s > self._limit_s:
            limit = f"no progress for {self._limit_s:g} s"
            return Failed(f"the run hung: {limit} (a solver that never returns)")
        return None

    def stop(self) -> None:
        """End the process, if it has not ended."""
        self._process.kill()
        self._process.join()
        self.receiver.close()


def _work(task: Callable[..., Any], item: Any, sender: Connection) -> None:
    """Perform a task and send None on progress, then the outcome."""
    reported_s = time.monotonic()

    def on_progress() -> None:
        nonlocal reported_s
        if time.monotonic() - reported_s > _CHECK_EVERY_S:
            sender.send(None)
            reported_s = time.monotonic()

    try:
        # Libraries write warnings straight to the terminal, from every process; outcomes are data.
        with redirect_stderr(io.StringIO()):
            outcome = task(item, on_progress)
    except Exception as error:  # noqa: BLE001  whatever it is, it is the outcome
        text = " ".join(str(error).split())
        name = "" if isinstance(error, IptmError) and text else type(error).__name__
        outcome = Failed(": ".join(part for part in (name, text) if part))
    sender.send(outcome)
