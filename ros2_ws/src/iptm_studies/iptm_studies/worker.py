"""What a worker process does around a run: it keeps quiet, and ends itself when the run hangs.

A solver in native code cannot be interrupted. A run that makes no progress for too long therefore takes
its process with it; the cluster starts a new one, and the run counts as failed.
"""

from __future__ import annotations

import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, suppress

from distributed import get_worker

from iptm_studies.run import Run, perform_run
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind

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
    worker = get_worker()  # only inside a task does a worker know itself
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
