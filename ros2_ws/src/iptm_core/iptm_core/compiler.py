"""The C compiler: its flags and processes, and numbers that need none.

Generated C holds the numbers of a model as hundreds of literals, and to compile it takes seconds. Read from
a table instead, they are data at one place of the library, behind a mark that occurs nowhere else; for
another model the library is copied with other numbers there. The table is constant, but its content is
unknown while the code is compiled: the same operations are done on the same numbers as with literals, bit by
bit.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import re
import shutil
import signal
import struct
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
QUICK_FLAGS = (
    "-O0",
    "-fno-sanitize=undefined",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fPIC",
    "-shared",
)
"""Nothing is optimised, or checked, as some compilers do then: a third of the time to compile."""
COMPILE_TIMEOUT_S = 300.0
WHEEL_COMPILER = "ziglang"
OLDEST_GLIBC = "2.28"
"""What the wheels of ROS need, see scripts/setup."""
_CPU_INFO = Path("/proc/cpuinfo")


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


def compiler_flags(flags: tuple[str, ...] = COMPILER_FLAGS) -> tuple[str, ...]:
    """Return flags for this machine: with AVX2 where the processor has it."""
    with suppress(OSError), _CPU_INFO.open(encoding="ascii", errors="replace") as lines:
        features = next((line for line in lines if line.startswith("flags")), "")
        if "avx2" in features.split():
            return (*flags, "-mavx2")
    return flags


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


_NAME = "iptm_numbers"
_TOKEN = re.compile(
    # The set in front lets the search leap to what may be a token.
    r"[s\d](?:"
    # Arrays of constants need literals; they stay what they are.
    r"(?<=s)tatic const casadi_\w+ [^;]*;"
    r"|(?<=[^\w.]\d)(?:\d*\.\d*(?:[eE][-+]?\d+)?|\d*[eE][-+]?\d+)(?![\w.]))"
)
_LITERAL = frozenset({0.0, 0.5, 1.0, 2.0})
"""Numbers for which compilers simplify operations."""
_MARK_NUMBERS = (3.1662e-287, -7.29318e193, 4.4251e118, -9.87203e-61)
_MARK = struct.pack("<4d", *_MARK_NUMBERS)
"""Begins the table."""
_ELF = b"\x7fELF"
_HIDDEN = '__attribute__((visibility("hidden")))'


def split_numbers(
    source: str, name: str = _NAME, first: int = len(_MARK_NUMBERS)
) -> tuple[str, tuple[float, ...]]:
    """Return generated C that reads its numbers from a table, and the table by first appearance.

    Args:
        name: of the table in the code.
        first: place of the first number in it.
    """
    places: dict[float, int] = {}

    def entry(found: re.Match[str]) -> str:
        if found[0].startswith("s"):
            return found[0]
        number = float(found[0])
        if number in _LITERAL:
            return found[0]
        return f"{name}[{places.setdefault(number, len(places)) + first}]"

    text = _TOKEN.sub(entry, source)
    return text, tuple(places)


def table_declaration() -> str:
    """Return the C declaration of the table, for files that read from it."""
    return f"extern const double {_NAME}[] {_HIDDEN};\n"


def table_source(numbers: Sequence[float]) -> str:
    """Return the C source of the table; compiled separately, as the only place of the numbers."""
    values = ", ".join(number.hex() for number in (*_MARK_NUMBERS, *numbers))
    return f"const double {_NAME}[] {_HIDDEN} = {{{values}}};\n"


def with_numbers(library: bytes, numbers: Sequence[float]) -> bytes | None:
    """Return a library with other numbers in its table; None where the table is not found."""
    start = library.find(_MARK) + len(_MARK)
    # Elsewhere a file that was changed may not be loaded (code signatures).
    if (
        not library.startswith(_ELF)
        or library.count(_MARK) != 1
        or start + 8 * len(numbers) > len(library)
    ):
        return None
    table = struct.pack(f"<{len(numbers)}d", *numbers)
    return library[:start] + table + library[start + len(table) :]


def numbers_key(numbers: Sequence[float]) -> str:
    """Return what stands behind the key of the code; nothing where the code has no numbers."""
    if not numbers:
        return ""
    digest = hashlib.sha256(struct.pack(f"<{len(numbers)}d", *numbers)).hexdigest()
    return f"_{digest[:24]}"
