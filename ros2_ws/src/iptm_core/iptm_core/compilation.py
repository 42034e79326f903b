"""Generated C for the functions of a nonlinear program, compiled once and cached.

The cache key is a hash of everything the machine code depends on: the generated source, the compiler with its
version and flags, and the machine architecture. A hash of the numbers follows (model parameters, smoothing
widths, step lengths). A second start with the same problem compiles nothing, and neither does a problem that
differs in numbers alone: a library of the same code is copied with its numbers (see `number_table`). Each
library ends with the digest of what is before it, which the loader ignores: a damaged one is compiled again,
not loaded.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import importlib.util
import logging
import os
import platform
import shutil
import stat
import struct
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import casadi as ca

from iptm_core.errors import SolverSetupError
from iptm_core.number_table import split_numbers, table_declaration, table_source, with_numbers

LOGGER = logging.getLogger(__name__)
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
    "-fno-semantic-interposition",
    "-fPIC",
    "-shared",
)
COMPILE_TIMEOUT_S = 300.0
CACHE_VARIABLE = "IPTM_CACHE_DIR"
WHEEL_COMPILER = "ziglang"
LIBRARIES_KEPT = 200
"""Libraries of up to half a megabyte; the ones unused for longest are removed."""
OLDEST_GLIBC = "2.28"
"""What the wheels of ROS need, see scripts/setup."""
_CPU_INFO = Path("/proc/cpuinfo")
_OF_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_SCRATCH_PREFIX = "build_"
_BETWEEN_FILES = "\n/* next file */\n"
DIGEST_SIZE = hashlib.sha256().digest_size


def cache_directory() -> Path:
    """Return the folder of this user's compiled problems.

    It lies in ``$IPTM_CACHE_DIR``, else in ``iptm`` in the user's cache; where that cannot be written, or
    code in it cannot be run, in the folder of temporary files. Code in it is loaded into the process, so
    users who share a cache have folders of their own in it.
    """
    explicit, root = os.environ.get(CACHE_VARIABLE), os.environ.get("XDG_CACHE_HOME")
    shared = (
        Path(explicit) if explicit else (Path(root) if root else Path.home() / ".cache") / "iptm"
    )
    usual = shared / f"user_{os.getuid()}"
    spare = Path(tempfile.gettempdir()) / f"iptm_user_{os.getuid()}"
    if _can_run_code(usual) or not _can_run_code(spare):
        return usual
    _warn(f"compiler cache '{usual}' cannot be written, or code in it run: '{spare}' is used")
    return spare


@cache
def _warn(text: str) -> None:
    """Say something once."""
    LOGGER.warning(text)


@cache
def _can_run_code(folder: Path) -> bool:
    """Return whether code can be written into a folder, which need not be there yet, and be run from it."""
    there = next(place for place in (folder, *folder.parents) if place.exists())
    try:  # permissions alone do not state it: /proc is one of those that refuse root
        Path(tempfile.mkdtemp(prefix=_SCRATCH_PREFIX, dir=there)).rmdir()
    except OSError:
        return False
    return not os.statvfs(there).f_flag & os.ST_NOEXEC


def find_compiler() -> tuple[str, ...] | None:
    """Return the command of a C compiler; None with a warning if there is none, or no folder for its code.

    That is ``$CC``, ``cc``, ``gcc`` or ``clang``, else the one that the set-up installs as a wheel
    on machines without.
    """
    if not _can_run_code(place := cache_directory()):
        _warn(
            f"no code can be run in '{place}': the problem runs interpreted, several times slower"
        )
        return None
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
    LOGGER.warning("no C compiler found: the problem runs interpreted, several times slower")
    return None


def compiler_flags() -> tuple[str, ...]:
    """Return the flags for this machine: ``COMPILER_FLAGS``, and AVX2 where the processor has it."""
    with contextlib.suppress(OSError), _CPU_INFO.open(encoding="ascii", errors="replace") as lines:
        features = next((line for line in lines if line.startswith("flags")), "")
        if "avx2" in features.split():
            return (*COMPILER_FLAGS, "-mavx2")
    return COMPILER_FLAGS


def compile_sources(
    generated: Sequence[str], fixed: Mapping[str, str], compiler: Sequence[str]
) -> Path:
    """Compile C code into one shared library, or find it in the cache.

    Args:
        generated: C files whose numbers may differ from problem to problem.
        fixed: further files by name, headers included.

    Raises:
        SolverSetupError: the compiler fails, or the cache folder cannot be written or is not private.
    """
    text, numbers = split_numbers(_BETWEEN_FILES.join(generated))
    declaration = table_declaration() if numbers else ""
    parts = text.split(_BETWEEN_FILES)
    sources = {f"ocp_{place}.c": declaration + part for place, part in enumerate(parts)}
    sources.update(fixed)
    flags = compiler_flags()
    folder = cache_directory()
    code = f"ocp_{_cache_key(sources, compiler, flags)}"
    library = folder / f"{code}{_numbers_key(numbers)}.so"
    _make_private(folder)
    if _is_intact(library):
        _note_use(library)
        return library
    try:
        with _locked(folder / f"{code}.lock"):
            others = folder.glob(f"{code}_*.so")
            if _is_intact(library) or _copy_is_made(library, others, numbers):
                return library
            LOGGER.info("compiling the optimal control problem (once per horizon and model)")
            _remove_abandoned(folder)
            with tempfile.TemporaryDirectory(prefix=_SCRATCH_PREFIX, dir=folder) as scratch:
                sources["numbers.c"] = table_source(numbers)
                built = _build(Path(scratch), sources, [*compiler, *flags])
                _put(library, built.read_bytes(), Path(scratch))
            _remove_unused(folder)
    except OSError as error:
        raise _not_writable(folder, error) from error
    return library


def _build(scratch: Path, sources: Mapping[str, str], command: Sequence[str]) -> Path:
    """Compile files into a library, at the same time if there is more than one."""
    for name, text in sources.items():
        (scratch / name).write_text(text, encoding="ascii")
    files = [str(scratch / name) for name in sources if name.endswith(".c")]
    if len(files) > 2:
        jobs = [[*command, "-c", file, "-o", f"{file}.o"] for file in files]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(_run_compiler, jobs))
        files = [f"{file}.o" for file in files]
    built = scratch / "ocp.so"
    _run_compiler([*command, *files, "-o", str(built), "-lm"])
    return built


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Let one process at a time compile a problem: those that start together need it once."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        # Some network file systems have no locks; each process compiles there.
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _copy_is_made(library: Path, others: Iterable[Path], numbers: Sequence[float]) -> bool:
    """Make a library of one with the same code and other numbers, if there is any."""
    # What cannot be read or written here is compiled, which reports it.
    with contextlib.suppress(OSError):
        for other in filter(_is_intact, others):
            content = with_numbers(other.read_bytes()[:-DIGEST_SIZE], numbers)
            if content is not None:
                folder = tempfile.TemporaryDirectory(prefix=_SCRATCH_PREFIX, dir=library.parent)
                with folder as scratch:
                    _put(library, content, Path(scratch))
                _remove_unused(library.parent)
                return True
    return False


def _put(library: Path, content: bytes, scratch: Path) -> None:
    """Write a library with its digest; another process sees either nothing or all of it."""
    whole = scratch / "whole.so"
    whole.write_bytes(content + hashlib.sha256(content).digest())
    whole.chmod(0o700)
    whole.replace(library)


def _not_writable(folder: Path, error: OSError) -> SolverSetupError:
    return SolverSetupError(f"compiler cache '{folder}' cannot be written: {error}")


def _make_private(folder: Path) -> None:
    """Create the folder, or check that no other user can write into it."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if status.st_uid != os.getuid() or not stat.S_ISDIR(status.st_mode):
            raise SolverSetupError(
                f"compiler cache '{folder}' is not a folder of this user; allowed: another place in "
                f"${CACHE_VARIABLE}"
            )
        if status.st_mode & _OF_OTHERS:
            folder.chmod(0o700)
    except OSError as error:
        raise _not_writable(folder, error) from error


def _remove_abandoned(folder: Path) -> None:
    """Remove what processes left behind that were killed while they compiled."""
    for scratch in folder.glob(f"{_SCRATCH_PREFIX}*"):
        with contextlib.suppress(OSError):
            if time.time() - scratch.lstat().st_mtime > 2.0 * COMPILE_TIMEOUT_S:
                shutil.rmtree(scratch)


def _note_use(library: Path) -> None:
    """Keep a library from being the one unused for longest."""
    with contextlib.suppress(OSError):
        os.utime(library)


def _remove_unused(folder: Path) -> None:
    """Remove the libraries unused for longest, so that the cache does not grow without end."""
    with contextlib.suppress(OSError):
        libraries = sorted(folder.glob("*.so"), key=lambda path: path.lstat().st_mtime)
        for library in libraries[:-LIBRARIES_KEPT]:
            library.unlink(missing_ok=True)


def _is_intact(library: Path) -> bool:
    """Return whether a library is there and as this user wrote it; a cut one would crash the process."""
    try:
        descriptor = os.open(library, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            status = os.fstat(descriptor)
            if status.st_uid != os.getuid() or status.st_mode & _WRITABLE_BY_OTHERS:
                return False
            content = file.read()
    except OSError:
        return False
    return hashlib.sha256(content[:-DIGEST_SIZE]).digest() == content[-DIGEST_SIZE:]


def _run_compiler(command: list[str]) -> None:
    try:
        done = subprocess.run(  # noqa: S603 - the compiler is found on the user's own path
            command, capture_output=True, text=True, timeout=COMPILE_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise SolverSetupError(
            f"compiler {command[0]} did not finish within {COMPILE_TIMEOUT_S:g} s"
        ) from error
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        errors = [line for line in lines if "error" in line] or lines[-1:] or ["no message"]
        raise SolverSetupError(
            f"compiler {command[0]} failed with exit code {done.returncode}: {errors[0]}"
        )


def _cache_key(sources: Mapping[str, str], compiler: Sequence[str], flags: Sequence[str]) -> str:
    answer = subprocess.run(  # noqa: S603 - as above
        [*compiler, "--version"], capture_output=True, text=True, timeout=30, check=False
    ).stdout
    # The further lines may name folders and the kernel, which change nothing.
    version = answer.partition("\n")[0]
    arguments = " ".join([*compiler[1:], *flags])
    code = [part for file in sources.items() for part in file]
    parts = (*code, version, arguments, platform.machine(), ca.CasadiMeta.version())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


def _numbers_key(numbers: Sequence[float]) -> str:
    """Return what stands behind the key of the code; nothing where the code has no numbers."""
    if not numbers:
        return ""
    digest = hashlib.sha256(struct.pack(f"<{len(numbers)}d", *numbers)).hexdigest()
    return f"_{digest[:24]}"
