"""Copies of a program that run other programs of the suite, without importing everything again.

Companions are copies beside a run: one of lowest priority drives the trip to compare with, which must not
delay the trip, another draws the picture. Their requests are a function and its arguments.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import ForkContext, SpawnContext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iptm.runner.composition import PYTHON
from iptm.trip import Trip
from iptm_core.errors import DriveError, IptmError
from iptm_core.program import StopRequest, main_of_module

if TYPE_CHECKING:
    from iptm.run import Run

_POLL_S = 0.1
_LOOK_AFTER_S, _LEAST_SHARE = 10.0, 0.1
"""A companion that is waited for and takes a smaller share of a processor in that time is replaced."""
_SET_PARENT_DEATH_SIGNAL, _SET_NAME = 1, 15  # PR_SET_PDEATHSIG and PR_SET_NAME of prctl(2)
# Looked up now: between fork and exec only the plainest things are safe.
_C_LIBRARY = ctypes.CDLL(None) if sys.platform == "linux" else None


def has_one_thread() -> bool:
    """Return whether this process has no other thread, whose locks would stay locked in a copy.

    Those of libraries count, such as the two that rclpy's tracing starts when it is imported.
    """
    tasks = Path("/proc/self/task")
    return tasks.is_dir() and len(list(tasks.iterdir())) == 1


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold signals that end a program back, until a copy made in the context can answer them itself."""
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def leave_parent(parent: int, name: str, log: Path, keep: int = -1) -> None:
    """Make a copy a process of its own, with a session, a name, an output and no open files of the parent.

    Args:
        parent: process id.
        name: which `ps -e` and `top` show.
        log: file for its output.
        keep: descriptor that stays open.
    """
    os.setsid()
    end_with_parent(parent)
    if _C_LIBRARY is not None:
        _C_LIBRARY.prctl(_SET_NAME, name.encode())
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    nothing, output = os.open(os.devnull, os.O_RDONLY), os.open(log, os.O_WRONLY | os.O_CREAT)
    for source, target in ((nothing, 0), (output, 1), (output, 2)):
        os.dup2(source, target)
    for descriptor in [int(each.name) for each in Path("/proc/self/fd").iterdir()]:
        if descriptor not in {
            0,
            1,
            2,
            keep,
        }:  # a socket that holds the parent's ROS domain, for example
            with suppress(OSError):
                os.close(descriptor)
    sys.stdout, sys.stderr = (
        open(each, "w", buffering=1, encoding="utf-8", closefd=False)  # noqa: SIM115  as long as it lives
        for each in (1, 2)
    )
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


class Fork:
    """A copy of this process that runs a program of the suite.

    Args:
        name: of the process.
        arguments: module and arguments of the program.
        log: file for its output.
        environment: of the program.
    """

    def __init__(
        self, name: str, arguments: Sequence[str], log: Path, environment: Mapping[str, str]
    ) -> None:
        given = (os.getpid(), name, arguments, log, environment)
        self._process = get_context("fork").Process(target=_run_program, args=given, daemon=True)
        gc.freeze()  # a collection in the copy would write to all pages that both share
        with signals_held():
            self._process.start()

    @property
    def pid(self) -> int:
        """Process id."""
        assert self._process.pid is not None  # noqa: S101  it was started
        return self._process.pid

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while it runs."""
        return self._process.exitcode

    def send_signal(self, number: int, /) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)


def _run_program(
    parent: int, name: str, arguments: Sequence[str], log: Path, environment: Mapping[str, str]
) -> None:
    leave_parent(parent, name, log)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [*PYTHON[2:], *arguments]
    main_of_module()  # which lets SIGINT through


def end_with_parent(parent: int) -> None:
    """Run in the child before the program: have Linux interrupt it when the runner dies."""
    # Programs started in the background of a shell ignore SIGINT, and so would their children.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if _C_LIBRARY is None:
        return
    _C_LIBRARY.prctl(_SET_PARENT_DEATH_SIGNAL, int(signal.SIGINT))
    if os.getppid() != parent:  # the runner died in between
        os._exit(1)


class Companion(AbstractContextManager["Companion"]):
    """The process, which ends with the context and is idle until the first request.

    Args:
        log: file for what it prints, with the name of the process.
        niceness: lowers its priority.
    """

    def __init__(self, log: Path, niceness: int = 0) -> None:
        self._log = log
        self._waiting: deque[tuple[Callable[..., Any], tuple[Any, ...]]] = deque()
        context: ForkContext | SpawnContext = (
            get_context("fork") if has_one_thread() else get_context("spawn")
        )
        self._requests, end = context.Pipe()
        given = (os.getpid(), log, niceness, end)
        self._process = context.Process(target=_serve, args=given, daemon=True)
        with signals_held():
            self._process.start()
        end.close()

    def request(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin to call a function of this module."""
        if function is not prepare:
            self._waiting.append((function, arguments))
        with suppress(BrokenPipeError):  # the answer is missing then
            self._requests.send((function, arguments))

    def answer(self, stop: StopRequest) -> Any:
        """Wait for the end of the oldest request: the run that was driven, or None for a picture.

        On a busy machine a process of low priority may hardly run, and one that hangs does not run at all:
        such a process is ended, and its request answered here.

        Args:
            stop: ends the wait, with None.

        Raises:
            IptmError: the request, or the process, failed.
        """
        function, arguments = self._waiting.popleft()
        looked_s, before_s = time.monotonic(), self._processor_time_s()
        try:
            while not self._requests.poll(_POLL_S):
                if stop.is_set:
                    return None
                if time.monotonic() - looked_s < _LOOK_AFTER_S:
                    continue
                share = (self._processor_time_s() - before_s) / _LOOK_AFTER_S
                if share < _LEAST_SHARE:
                    self._process.kill()
                    return function(*arguments)
                looked_s, before_s = time.monotonic(), self._processor_time_s()
            answer = self._requests.recv()
        except (EOFError, ConnectionResetError):
            raise DriveError(f"the process beside the run ended; see {self._log}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _processor_time_s(self) -> float:
        """Return the processor time that the process has taken, 0 where the system does not state it."""
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")

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
    from iptm.runner.summary import save_picture  # noqa: PLC0415

    save_picture(path, run)


def _serve(parent: int, log: Path, niceness: int, requests: Connection) -> None:
    """Answer requests until their pipe is closed."""
    leave_parent(parent, log.stem, log, requests.fileno())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.nice(niceness)
    with suppress(EOFError):
        while True:
            function, given = requests.recv()
            try:
                answer = function(*given)
            except (IptmError, OSError) as error:
                answer = error
            if function is not prepare:
                requests.send(answer)
