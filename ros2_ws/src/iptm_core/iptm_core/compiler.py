"""The C compiler: which one, its flags and processes."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Any

from iptm_core.errors import SolverSetupError

COMPILER_FLAGS = (
    # What straight lines and short loops gain from -O3, in half of its time; clang ignores what it lacks.
    "-O1",
    "-ftree-vectorize",
    "-finline-functions",
    "-finline-small-functions",
    "-fpeel-loops",
    # Operations are done as they are written, on every machine.
    "-ffp-contract=off",
    "-fno-math-errno",
    # Comparisons may become selections: no operation stops the program, and results stay.
    "-fno-trapping-math",
    "-fno-semantic-interposition",
    "-fPIC",
    "-shared",
)
COMPILE_TIMEOUT_S = 300.0
WHEEL_COMPILER = "ziglang"
OLDEST_GLIBC = "2.28"
"""What the wheels of ROS need, see scripts/setup."""
_CPU_INFO = Path("/proc/cpuinfo")


def find_compiler() -> tuple[str, ...]:
    """Return the command of a C compiler, see `installed_compiler`.

    Raises:
        SolverSetupError: there is none.
    """
    found = installed_compiler()
    if found is None:
        raise SolverSetupError(
            "C compiler is not found; allowed: one of the system (cc, gcc, clang or $CC), or the package "
            f"{WHEEL_COMPILER} (python3 -m pip install {WHEEL_COMPILER})"
        )
    return found


def installed_compiler() -> tuple[str, ...] | None:
    """Return the command of a C compiler, None if there is none.

    That is ``$CC``, ``cc``, ``gcc`` or ``clang``, else the one that the set-up installs as a wheel
    on machines without.
    """
    for candidate in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        program, *arguments = candidate.split() or [""]
        path = shutil.which(program)
        if path is not None:
            return (path, *arguments)
    wheel = importlib.util.find_spec(WHEEL_COMPILER)
    for folder in () if wheel is None else wheel.submodule_search_locations or ():
        path = shutil.which("zig", path=folder)
        if path is not None:
            # Named, the target is any processor and every supported C library, as with a system's
            # compiler; left alone, it would be this very machine, and the cache may be shared.
            return (path, "cc", "-target", f"{platform.machine()}-linux-gnu.{OLDEST_GLIBC}")
    return None


def compiler_flags() -> tuple[str, ...]:
    """Return the flags for this machine: with AVX2 where the processor has it."""
    with suppress(OSError), _CPU_INFO.open(encoding="ascii", errors="replace") as lines:
        features = next((line for line in lines if line.startswith("flags")), "")
        if "avx2" in features.split():
            return (*COMPILER_FLAGS, "-mavx2")
    return COMPILER_FLAGS


@cache
def compiler_version(compiler: tuple[str, ...]) -> str:
    """Return the first line of what a compiler answers about its version."""
    answer = subprocess.run(  # noqa: S603 - the compiler is found on the user's own path
        [*compiler, "--version"], capture_output=True, text=True, timeout=30, check=False
    ).stdout
    # The further lines may name folders and the kernel, which change nothing.
    return answer.partition("\n")[0]


def run_compilers(commands: Iterable[Sequence[str]]) -> None:
    """Run compilers at the same time.

    Raises:
        SolverSetupError: one of them fails, or takes too long.
    """
    until_s = time.monotonic() + COMPILE_TIMEOUT_S
    # Linux may give every session the same share of the processor, whatever its niceness.
    gives_way = os.nice(0) > 0 and sys.version_info >= (3, 11)
    apart: dict[str, Any] = {"process_group": 0} if gives_way else {"start_new_session": True}
    with ExitStack() as ending:
        jobs = []
        for command in commands:
            job = subprocess.Popen(  # noqa: S603 - the compiler is found on the user's own path
                command,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                **apart,
            )
            ending.enter_context(job)
            ending.callback(_kill, job)
            jobs.append((command[0], job))
        for compiler, job in jobs:
            try:
                _, complaints = job.communicate(timeout=max(until_s - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                raise SolverSetupError(
                    f"compiler {compiler} did not finish within {COMPILE_TIMEOUT_S:g} s"
                ) from None
            if job.returncode != 0:
                lines = complaints.strip().splitlines()
                errors = [line for line in lines if "error" in line] or lines[-1:] or ["no message"]
                raise SolverSetupError(
                    f"compiler {compiler} failed with exit code {job.returncode}: {errors[0]}"
                )


def _kill(job: subprocess.Popen[str]) -> None:
    """Kill a compiler with the processes that it has started, unless it has ended."""
    if job.poll() is None:
        with suppress(OSError):
            os.killpg(job.pid, signal.SIGKILL)
