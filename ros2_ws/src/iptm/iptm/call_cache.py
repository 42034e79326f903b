"""Calls of a function in several processes or on a cluster; finished ones are kept and not computed again."""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, redirect_stderr
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iptm.fingerprint import call_key
from iptm_core.errors import IptmError, ParameterError

MAX_WORKERS = 1024
MOST_CRASHES = 3
"""Crashes of the process of a call after which it counts as failed."""
DIED = "its process died (out of memory, killed, or a crash in a library)"


@dataclass(frozen=True)
class Outcome:
    """What became of one of several calls.

    Attributes:
        index: place of the call in the sequence.
        value: what the function returned, None for a failure.
        failure: why a value is missing, in one line; empty otherwise.
        cached: the value was found, not computed.
    """

    index: int
    value: Any = None
    failure: str = ""
    cached: bool = False


def cached_calls(
    function: Callable[..., Any],
    calls: Sequence[Mapping[str, Any]],
    *,
    workers: int | None = 1,
    executor: Executor | None = None,
    cache: str | Path | None = None,
) -> Iterator[Outcome]:
    """Call a function with each of several sets of arguments and yield every outcome as soon as it is there.

    A value is kept as soon as it is there; who calls again after an interruption gets what was finished from
    the cache. The key of a value is made of function, arguments, content of files among them, and the
    code of the suite and of the function's package: with other code nothing is found.

    Args:
        function: of a module, so that other processes find it. Its error is the failure of that call.
        calls: keyword arguments of each call.
        workers: number of processes; 1 for this one, None for one per core that this process may use.
        executor: computes instead, such as an executor of a cluster; it is not shut down.
        cache: folder of finished values; None to keep none. Read only folders that you trust: values are
            pickled.

    Raises:
        ParameterError: ``workers`` is out of range, or an argument cannot be part of a key.
        OSError: the cache cannot be written.
    """
    count = worker_count(workers)
    folder = None if cache is None else Path(cache)
    files = [None if folder is None else folder / f"{call_key(function, c)}.pkl" for c in calls]
    waiting = []
    for index, file in enumerate(files):
        found = None if file is None else _read(file)
        if found is None:
            waiting.append(index)
        else:
            yield Outcome(index, found[0], cached=True)
    for outcome in _computed(function, calls, waiting, count, executor):
        file = files[outcome.index]
        if file is not None and not outcome.failure:
            _write(file, outcome.value)
        yield outcome


def worker_count(workers: int | None) -> int:
    """Return a number of processes, by default one per core that this process may use.

    Raises:
        ParameterError: out of range.
    """
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    if not 1 <= workers <= MAX_WORKERS:
        raise ParameterError(f"workers is {workers}; allowed: 1 to {MAX_WORKERS}")
    return workers


def _read(file: Path) -> tuple[Any] | None:
    """Return a kept value; None for none, or one that cannot be read: it is computed again."""
    try:
        with file.open("rb") as stream:
            return (pickle.load(stream),)  # noqa: S301 - own folder, see cached_calls
    except FileNotFoundError:
        return None
    except Exception:  # noqa: BLE001 - a damaged pickle raises anything
        return None


def _write(file: Path, value: Any) -> None:
    """Keep a value; who reads meanwhile finds all of it or nothing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(f".{os.getpid()}.part")
    part.write_bytes(pickle.dumps(value))
    part.replace(file)


def _call(function: Callable[..., Any], arguments: Mapping[str, Any]) -> tuple[Any, str]:
    """Return what a function returned, and why it did not."""
    try:
        return function(**arguments), ""
    except Exception as error:  # noqa: BLE001 - whatever it is, it is the outcome of this call
        return None, _cause(error)


def _quiet_call(function: Callable[..., Any], arguments: Mapping[str, Any]) -> tuple[Any, str]:
    # Libraries write warnings straight to the terminal, from every process; outcomes are data.
    with redirect_stderr(io.StringIO()):
        return _call(function, arguments)


def _cause(error: BaseException) -> str:
    text = " ".join(str(error).split())
    name = "" if isinstance(error, IptmError) and text else type(error).__name__
    return ": ".join(part for part in (name, text) if part)


def _computed(
    function: Callable[..., Any],
    calls: Sequence[Mapping[str, Any]],
    waiting: Sequence[int],
    workers: int,
    executor: Executor | None,
) -> Iterator[Outcome]:
    if executor is not None:
        yield from _submitted(executor, function, calls, waiting)
    elif workers == 1:
        for index in waiting:
            yield Outcome(index, *_call(function, calls[index]))
    else:
        yield from _in_processes(function, calls, waiting, workers)


def _submitted(
    executor: Executor,
    function: Callable[..., Any],
    calls: Sequence[Mapping[str, Any]],
    waiting: Sequence[int],
) -> Iterator[Outcome]:
    """Yield outcomes as they come; a pool that broke raises BrokenProcessPool."""
    futures: dict[Future[tuple[Any, str]], int] = {
        executor.submit(_quiet_call, function, calls[index]): index for index in waiting
    }
    broken: BrokenProcessPool | None = None
    try:
        for future in as_completed(futures):
            index, error = futures.pop(future), future.exception()
            if isinstance(error, BrokenProcessPool):
                broken = error
            elif error is not None:
                yield Outcome(index, failure=_cause(error))
            else:
                yield Outcome(index, *future.result())
        if broken is not None:
            raise broken
    finally:
        for future in futures:
            future.cancel()


def _in_processes(
    function: Callable[..., Any],
    calls: Sequence[Mapping[str, Any]],
    waiting: Sequence[int],
    workers: int,
) -> Iterator[Outcome]:
    """Yield outcomes from a pool of processes, made anew where one of them died.

    Which call it was is unknown: after a crash, the unfinished ones get pools of their own.
    """
    left = list(waiting)
    crashes = 0
    while left:
        # One call per pool once it is clear that some call crashes again and again.
        alone = crashes >= MOST_CRASHES
        batch = left[:1] if alone else list(left)
        with ExitStack() as stack:
            pool = ProcessPoolExecutor(min(workers, len(batch)), mp_context=_context())
            stack.callback(pool.shutdown, wait=True, cancel_futures=True)
            try:
                for outcome in _submitted(pool, function, calls, batch):
                    left.remove(outcome.index)
                    yield outcome
            except BrokenProcessPool:
                crashes += 1
                if alone:
                    left.remove(batch[0])
                    yield Outcome(batch[0], failure=DIED)


def _context() -> multiprocessing.context.BaseContext:
    """Return how processes are started: never by a copy of this one, which may have threads."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["iptm.driving"])  # once, for the workers of all calls
    return context
