"""How a program of the suite starts, runs and ends: exit codes, and a mistake of the user in one line.

Every program starts here: an installed executable with `main`, which looks it up by its name among the entry
points of the suite, and a command in `scripts/` with `python -m iptm_core MODULE [ARGUMENTS]`. A missing
library, and Ctrl-C while imports are loading, then end it without a traceback.

A full collection of garbage walks every object of the process: 20 to 80 ms with the libraries of a study
loaded, in one tick. Nearly all that a trip leaves behind is freed by counting references; the rest can wait
for its end.
"""

from __future__ import annotations

import errno
import gc
import io
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

PROGRAMS = "iptm.programs"
"""Group of entry points in each ``setup.py``: name of an executable and its function."""
EXIT_OK = 0
EXIT_REFUSED = 1
"""The request was valid, but was not carried out."""
EXIT_USER_ERROR = 2
EXIT_SIGNAL = 128
"""Added to the number of the signal that ended a program."""
EXIT_INTERRUPTED = EXIT_SIGNAL + signal.SIGINT
REAL_TIME_PRIORITY, _NICENESS = 10, -10
LOWEST_PRIORITY = 19
"""As niceness."""


class StopRequest:
    """Notes SIGINT and SIGTERM instead of raising an exception in the middle of a callback.

    Launchers and terminals often send the signal twice; the second one changes nothing, so the
    clean-up can never be interrupted by it.

    Attributes:
        number: the first signal, None while there was none.
    """

    def __init__(self) -> None:
        self.number: signal.Signals | None = None

    @property
    def is_set(self) -> bool:
        """Whether a signal has arrived."""
        return self.number is not None

    def install(self) -> None:
        """Take over both signals, for the rest of the life of the process."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def end(self) -> None:
        """Ignore both signals from now on: while Python ends, they would kill the process by default."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        if self.number is None:
            self.number = signal.Signals(number)


def go_first(thread: int = 0, priority: int = REAL_TIME_PRIORITY) -> None:
    """Run a thread, and those that it starts, before others, where the user may ask for that.

    With the scheduler for real time, else by a lower niceness.

    Args:
        thread: its identifier in the system; 0 for the calling one.
        priority: for real time, 1 to 99; the higher one runs.
    """
    try:
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, _NICENESS)


SECTION_END = "--"
"""Ends a list of ROS arguments as well."""


def sections(arguments: Iterable[str]) -> list[list[str]]:
    """Return the parts of a command line between `SECTION_END`: one for each of several nodes or vehicles."""
    parts: list[list[str]] = [[]]
    for argument in arguments:
        if argument == SECTION_END:
            parts.append([])
        else:
            parts[-1].append(argument)
    return parts


def print_error(program: str, what: object) -> None:
    """Print one line on stderr."""
    print(f"{program}: {' '.join(str(what).split())}", file=sys.stderr, flush=True)


def refused(program: str, reason: object) -> int:
    """Print a usage error in one line on stderr and return the exit code of the program."""
    print_error(program, reason)
    return EXIT_USER_ERROR


_YOUNG_OBJECTS = 10_000
"""New objects between collections while a program loads; at Python's own 700, an eighth is collecting."""


def run(name: str, load: Callable[[], Callable[[], Any]]) -> Any:
    """Load a program and run it.

    Returns:
        The exit code of the program, 2 if a library is not installed, 130 after Ctrl-C, 141 if the
            reader of its output is gone.
    """
    usual = gc.get_threshold()
    gc.set_threshold(_YOUNG_OBJECTS)
    is_interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_interruptible:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # The commands in scripts/ hold Ctrl-C back until here.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        function = load()
    except ModuleNotFoundError as error:
        install = "`python3 -m pip install -r requirements/run-no-ros.txt`"
        needed = f"ROS 2 and the workspace sourced, and {install}"
        return refused(name, f"{error} for {sys.executable}; needed: {needed}")
    gc.freeze()
    gc.set_threshold(*usual)  # rare collections are long ones: 40 ms in a tick
    if is_interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    _make_output_safe()
    try:
        code = function()
        sys.stdout.flush()
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of a pipe has closed it, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_SIGNAL + signal.SIGPIPE
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return refused(name, f"output cannot be written: {error}")
    finally:
        gc.freeze()  # else Python looks through all modules once more before it ends: 0.2 s
    return code


def _make_output_safe() -> None:
    """Let output go on where it is closed, or cannot hold a letter: the drive counts, not its report."""
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        try:
            os.fstat(descriptor)
        except (
            OSError
        ):  # closed by the shell (>&-): files opened from now on must not take its place
            os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
        stream = getattr(sys, name)
        if stream is None:
            stream = os.fdopen(descriptor, "w", encoding="utf-8", closefd=False)
            setattr(sys, name, stream)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def main() -> None:
    """Run the program that the installed executable is named after."""
    name = Path(sys.argv[0]).name

    def load() -> Callable[[], Any]:
        from importlib.metadata import entry_points  # noqa: PLC0415  slow, and for executables only

        (program,) = entry_points(group=PROGRAMS, name=name)
        function: Callable[[], Any] = program.load()
        return function

    sys.exit(run(name, load))


def main_of_module() -> None:
    """Run the `main` of the module that the first argument names, with the other arguments."""
    name = sys.argv[1]

    def load() -> Callable[[], Any]:
        module = import_module(name)
        sys.argv = [str(module.__file__), *sys.argv[2:]]
        function: Callable[[], Any] = module.main
        return function

    sys.exit(run(name.rpartition(".")[2], load))


_NEVER = 2**30
_YOUNG_IN_A_DRIVE, _YOUNG_COLLECTIONS = 3_000, 1
"""New objects between collections while a trip is driven, and collections of them before one of the middle
generation: the longest takes two milliseconds. With Python's own 10 collections, one takes 13 ms."""


@contextmanager
def no_full_collections() -> Iterator[None]:
    """Collect young objects only while the context is open, and rarely; full collections come after it."""
    young, middle, old = gc.get_threshold()
    gc.set_threshold(_YOUNG_IN_A_DRIVE, _YOUNG_COLLECTIONS, _NEVER)
    try:
        yield
    finally:
        gc.set_threshold(young, middle, old)
