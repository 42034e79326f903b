"""A process beside a run, of lowest priority: drives the trip to compare with, then draws the picture.

Both need a second or more, which nobody waits for while the trip takes place. Requests, a function and its
arguments, and answers are pickles on its standard input and output.
"""

from __future__ import annotations

import os
import pickle
import sys
from contextlib import AbstractContextManager, redirect_stdout, suppress
from functools import cached_property
from pathlib import Path
from subprocess import Popen
from typing import TYPE_CHECKING, Any

from iptm.runner.supervisor import piped_process
from iptm.trip import Trip
from iptm_core.errors import DriveError, IptmError

if TYPE_CHECKING:
    from iptm.run import Run

_MODULE = "iptm.runner.companion"
_NICENESS = 19


class Companion(AbstractContextManager["Companion"]):
    """The process, which ends with the context.

    Args:
        log: file for what it prints.
    """

    def __init__(self, log: Path) -> None:
        self._log = log

    @cached_property
    def _process(self) -> Popen[bytes]:
        return piped_process([sys.executable, "-m", "iptm_core", _MODULE], self._log)

    def start(self) -> None:
        """Start ahead of the first request."""
        self._process.poll()

    def drive(self, trip: Trip, path: Path, heading: str) -> None:
        """Begin to drive a trip, and to write it to a file, compared with the run of a heading."""
        self._send(drive, trip, path, heading)

    def draw(self, path: Path, run: Run) -> None:
        """Begin to draw a run."""
        self._send(draw, path, run)

    def answer(self) -> Any:
        """Wait for the end of the oldest request: the run that was driven, or None for a picture.

        Raises:
            IptmError: the request, or the process, failed.
        """
        assert self._process.stdout is not None  # noqa: S101  it is a pipe
        try:
            answer = pickle.load(self._process.stdout)  # noqa: S301  of our own process
        except EOFError:
            raise DriveError(f"the process beside the run ended; see {self._log}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _send(self, *request: Any) -> None:
        assert self._process.stdin is not None  # noqa: S101  it is a pipe
        with suppress(BrokenPipeError):  # the answer is missing then
            pickle.dump(request, self._process.stdin)
            self._process.stdin.flush()

    def __exit__(self, *error: object) -> None:
        """End the process."""
        if "_process" in vars(self):
            self._process.kill()
            self._process.communicate()


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


def main() -> None:
    """Answer requests until their pipe is closed."""
    os.nice(_NICENESS)
    import iptm.picture  # noqa: F401, PLC0415  ahead of the request

    answers = sys.stdout.buffer
    with redirect_stdout(sys.stderr), suppress(EOFError):
        while True:
            function, *given = pickle.load(sys.stdin.buffer)  # noqa: S301  of the runner
            try:
                answer = function(*given)
            except (IptmError, OSError) as error:
                answer = error
            pickle.dump(answer, answers)
            answers.flush()
