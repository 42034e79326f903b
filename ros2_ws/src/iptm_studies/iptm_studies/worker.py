"""What a worker process does around a run: it keeps quiet, and ends itself when the run hangs.

A solver in native code cannot be interrupted. A run that shows no sign of life for too long therefore
takes its process with it; the cluster starts a new one, and the run counts as failed.
"""

from __future__ import annotations

import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, suppress

from distributed import get_worker

from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind
from iptm_studies.single_run import FinishedRun, perform_run

STALL_TOPIC = "iptm-stalled"
PATIENCE_S = {RunKind.CLOSED_LOOP: 300.0, RunKind.WHOLE_TRIP: 3600.0}
"""Time without a sign of life. In a closed loop the longest silence is that of the compiler."""
_CHECK_EVERY_S = 0.5
_FAREWELL_S = 2.0
_EXIT_CODE = 70


def work(inputs: RunInputs, key: str, patience_s: float | None = None) -> FinishedRun:
    """Perform a run in a worker process; see ``perform_run``.

    Args:
        inputs: the run.
        key: its key, for the farewell.
        patience_s: time without a sign of life, None for that of its kind.

    Raises:
        IptmError: as for ``perform_run``.
    """
    patience = PATIENCE_S[inputs.spec.kind] if patience_s is None else patience_s
    with _watched(key, patience) as alive, redirect_stderr(io.StringIO()):
        # Libraries write warnings straight to the terminal, from every worker; outcomes are data.
        return perform_run(inputs, alive)


@contextmanager
def _watched(key: str, patience_s: float) -> Iterator[Callable[[], None]]:
    """Give a function that shows life; end the process when it is not called for too long."""
    over = threading.Event()
    last_sign = [time.monotonic()]
    # Only inside a task does a worker know itself.
    try:
        worker = get_worker()
    except ValueError:
        worker = None

    def alive() -> None:
        last_sign[0] = time.monotonic()

    def watch() -> None:
        while not over.wait(_CHECK_EVERY_S):
            if time.monotonic() - last_sign[0] <= patience_s:
                continue
            if worker is not None:
                with suppress(RuntimeError, OSError):
                    worker.log_event(STALL_TOPIC, {"key": key, "patience_s": patience_s})
                over.wait(_FAREWELL_S)
            os._exit(_EXIT_CODE)

    thread = threading.Thread(target=watch, name="watchdog", daemon=True)
    thread.start()
    try:
        yield alive
    finally:
        over.set()
        thread.join()
