"""A process beside a run, of lowest priority: drives the trip to compare with, then draws the picture.

Both need a second or more, which nobody waits for while the trip takes place. Requests are a function and its
arguments.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import ForkContext, SpawnContext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iptm.runner.fork import has_one_thread, leave_parent, signals_held
from iptm.trip import Trip
from iptm_core.errors import DriveError, IptmError

if TYPE_CHECKING:
    from iptm.run import Run

_NAME = "companion"
_NICENESS = 19


class Companion(AbstractContextManager["Companion"]):
    """The process, which ends with the context and is idle until the first request.

    Args:
        log: file for what it prints.
    """

    def __init__(self, log: Path) -> None:
        self._log = log
        context: ForkContext | SpawnContext = (
            get_context("fork") if has_one_thread() else get_context("spawn")
        )
        self._requests, end = context.Pipe()
        given = (os.getpid(), log, end)
        self._process = context.Process(target=_serve, args=given, daemon=True)
        with signals_held():
            self._process.start()
        end.close()

    def request(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin to call a function of this module."""
        with suppress(BrokenPipeError):  # the answer is missing then
            self._requests.send((function, arguments))

    def answer(self) -> Any:
        """Wait for the end of the oldest request: the run that was driven, or None for a picture.

        Raises:
            IptmError: the request, or the process, failed.
        """
        try:
            answer = self._requests.recv()
        except (EOFError, ConnectionResetError):
            raise DriveError(f"the process beside the run ended; see {self._log}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def __exit__(self, *error: object) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()


def prepare() -> None:
    """Import what a picture needs; without an answer."""
    import iptm.picture  # noqa: F401, PLC0415


def drive(trip: Trip, path: Path, heading: str) -> Run:
    """Drive a trip and write it to a file."""
    from iptm.driving import drive_in_memory  # noqa: PLC0415  only here, not in the runner
    from iptm.runner.evaluation import save_comparison  # noqa: PLC0415

    run = drive_in_memory(trip)
    save_comparison(path, run, heading)
    return run


def draw(path: Path, run: Run) -> None:
    """Draw a run."""
    from iptm.runner.tables import save_picture  # noqa: PLC0415

    save_picture(path, run)


def _serve(parent: int, log: Path, requests: Connection) -> None:
    """Answer requests until their pipe is closed."""
    leave_parent(parent, _NAME, log, requests.fileno())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.nice(_NICENESS)
    with suppress(EOFError):
        while True:
            function, given = requests.recv()
            try:
                answer = function(*given)
            except (IptmError, OSError) as error:
                answer = error
            if function is not prepare:
                requests.send(answer)
