"""Code that is used before it is optimised, and the process that optimises it.

The first trip with a problem begins with code that is not optimised. Optimised code does the same operations,
takes several times as long to compile, and is compiled by a process of its own while the trip goes on. That
process outlives the program, so that a short trip ends at once and the next one finds optimised code. At most
`WAITING` of them wait for their turn: of a sweep over many models the others are optimised by later trips.
"""

from __future__ import annotations

import _ctypes
import ctypes
import fcntl
import logging
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from iptm_core.compilation import Compilation, locked
from iptm_core.compiler import COMPILER_FLAGS, QUICK_FLAGS, compiler_flags
from iptm_core.errors import SolverSetupError

LOGGER = logging.getLogger(__name__)
TURN = "optimising.lock"
"""File in the cache that is locked by the process whose turn it is: one at a time."""
WAITING = 3
"""Processes per cache, the one whose turn it is included; each needs 10 MB."""
_NICENESS = 10
"""It gives way to programs, but ends while others compute, too."""
_PROGRAM = "import sys; sys.path[:] = {}; from {} import compile_given; compile_given()"


class NewestLibrary:
    """A library, replaced by the optimised one as soon as that is compiled.

    Both are closed with this object: of many models, those in use stay in memory.

    Args:
        optimised: its compilation; None where the library is it.
        load: returns the library of a file, ready for calls.

    Attributes:
        newest: the library for the next call.
    """

    def __init__(
        self,
        path: Path,
        optimised: Compilation | None,
        load: Callable[[Path], ctypes.PyDLL],
    ) -> None:
        self.newest, self._optimised, self._load = load(path), optimised, load
        self._opened = [self.newest]
        weakref.finalize(self, _close, self._opened).atexit = False

    def improve(self) -> None:
        """Begin to optimise, unless that was done: at the first call, when the set-up needs no compiler.

        Where enough others wait for their turn, the code stays as it is.
        """
        if self._optimised is None:
            return
        optimised, self._optimised = self._optimised, None
        try:
            process = _start(optimised)
        except OSError as error:
            _warn(str(error))
        else:
            if process is not None:
                given = optimised, process
                threading.Thread(target=self._replace, args=given, daemon=True).start()

    def _replace(self, optimised: Compilation, process: subprocess.Popen[bytes]) -> None:
        code = process.wait()
        try:
            if (path := optimised.find()) is not None:
                self.newest = self._load(path)
                self._opened.append(self.newest)
            elif not _warn_of_failure(optimised):
                _warn(f"the process that compiles ended with exit code {code}")
        except SolverSetupError as error:
            _warn(str(error))


def _close(libraries: Sequence[ctypes.PyDLL]) -> None:
    for library in libraries:
        _ctypes.dlclose(library._handle)  # noqa: SLF001  ctypes never does


def compile_in_steps(
    generated: Sequence[str],
    numbers: tuple[float, ...],
    fixed: Mapping[str, str],
    compiler: Sequence[str],
    load: Callable[[Path], ctypes.PyDLL],
) -> NewestLibrary:
    """Compile C code without optimisation, and optimised beside what calls it; see `Compilation`.

    Args:
        load: returns the library of a file, ready for calls.
    """
    given = generated, numbers, fixed, compiler
    optimised = Compilation.of(*given, compiler_flags(COMPILER_FLAGS))
    if found := optimised.find():
        return NewestLibrary(found, None, load)
    _warn_of_failure(optimised)  # of a program before
    quick = Compilation.of(*given, compiler_flags(QUICK_FLAGS))
    return NewestLibrary(quick.find() or quick.make(), optimised, load)


def _start(compilation: Compilation) -> subprocess.Popen[bytes] | None:
    """Start the process, None where `WAITING` are there; it ends neither with this one nor its session."""
    place = _free_place(compilation.code.parent)
    if place is None:
        return None
    program = _PROGRAM.format(sys.path, __name__)
    with os.fdopen(place), tempfile.TemporaryFile() as order:
        pickle.dump(compilation, order)
        order.seek(0)
        return subprocess.Popen(  # noqa: S603  this module
            [sys.executable, "-I", "-S", "-c", program],
            stdin=order,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            pass_fds=(place,),
        )


def _free_place(folder: Path) -> int | None:
    """Return the locked file of a free place, which stays locked while a process has it open."""
    for number in range(WAITING):
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        place = os.open(folder / f"optimising_{number}.lock", flags, 0o600)
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(place)
        except OSError:  # a file system without locks
            return place
        else:
            return place
    return None


def compile_given() -> None:
    """Do the compilation on the standard input: all that the process does."""
    compilation: Compilation = pickle.load(sys.stdin.buffer)  # noqa: S301  of the program that started it
    # A node that drives a car runs before all others, and so would what it starts.
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(_NICENESS)
    with suppress(OSError):  # Linux may schedule sessions as groups, within which niceness counts
        Path("/proc/self/autogroup").write_text(str(_NICENESS), encoding="ascii")
    try:
        with locked(compilation.code.with_name(TURN)):
            compilation.make()
    except SolverSetupError as error:
        compilation.note_failure(str(error))


def _warn_of_failure(compilation: Compilation) -> bool:
    """Report why a compilation failed, once; return whether it did."""
    if reason := compilation.take_failure():
        _warn(reason)
    return bool(reason)


def _warn(reason: str) -> None:
    LOGGER.warning("unoptimised code is used, twice as slow: %s", reason)
