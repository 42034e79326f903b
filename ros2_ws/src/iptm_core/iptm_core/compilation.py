"""C code as shared libraries, compiled once and cached.

The cache key is a hash of everything the machine code depends on: the source, the compiler with its version
and flags, and the machine architecture. A second start with the same code compiles nothing, and neither does
a problem that differs in numbers alone (see `compiler`). Each library ends with the digest of what is before
it, which the loader ignores: a damaged one is compiled again, not loaded.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import logging
import os
import platform
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from iptm_core.compiler import (
    COMPILE_TIMEOUT_S,
    compiler_flags,
    compiler_version,
    find_compiler,
    run_compilers,
)
from iptm_core.errors import SolverSetupError

LOGGER = logging.getLogger(__name__)
CACHE_VARIABLE = "IPTM_CACHE_DIR"
LIBRARIES_KEPT = 200
"""Libraries of up to half a megabyte; the ones unused for longest are removed."""
_OF_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_SCRATCH_PREFIX = "build_"
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


def compile_sources(sources: Mapping[str, str]) -> Path:
    """Compile C code into one shared library, or find it in the cache.

    Args:
        sources: C files and headers by name.

    Raises:
        SolverSetupError: there is no compiler, it fails, or the cache folder cannot be written, is not
            private or can run no code.
    """
    command = (*find_compiler(), *compiler_flags())
    folder = cache_directory()
    if not _can_run_code(folder):
        raise SolverSetupError(
            f"compiler cache '{folder}' cannot be written, or code in it run; allowed: another folder in "
            f"${CACHE_VARIABLE}"
        )
    _make_private(folder)
    library = folder / f"iptm_{_cache_key(sources, command)}.so"
    if _is_intact(library):
        with contextlib.suppress(OSError):
            os.utime(library)  # it is not the one unused for longest
        return library
    try:
        with locked(library.with_suffix(".lock")):
            if _is_intact(library):  # another process has compiled it meanwhile
                return library
            LOGGER.info("compiling the optimal control problem (once per horizon)")
            _remove_abandoned(folder)
            with _scratch_in(folder) as scratch:
                _put(library, _built(sources, command, scratch).read_bytes(), scratch)
            _remove_unused(folder)
    except OSError as error:
        raise _not_writable(folder, error) from error
    return library


def _built(sources: Mapping[str, str], command: Sequence[str], scratch: Path) -> Path:
    """Compile files into a library, at the same time if there is more than one."""
    for name, text in sources.items():
        (scratch / name).write_text(text, encoding="ascii")
    files = [str(scratch / name) for name in sources if name.endswith(".c")]
    if len(files) > 1:
        run_compilers([*command, "-c", file, "-o", f"{file}.o"] for file in files)
        files = [f"{file}.o" for file in files]
    built = scratch / "iptm.so"
    run_compilers([[*command, *files, "-o", str(built), "-lm"]])
    return built


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Let one process at a time compile a problem: those that start together need it once."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        # Some network file systems have no locks; each process compiles there.
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        # Closed alone, it would stay locked in a fork of this process.
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)


@contextlib.contextmanager
def _scratch_in(folder: Path) -> Iterator[Path]:
    """Provide a folder for a while; one of `tempfile` is removed as soon as the program ends."""
    scratch = Path(tempfile.mkdtemp(prefix=_SCRATCH_PREFIX, dir=folder))
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


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


def _cache_key(sources: Mapping[str, str], command: Sequence[str]) -> str:
    version = compiler_version(find_compiler())
    code = [part for file in sources.items() for part in file]
    parts = (*code, version, " ".join(command[1:]), platform.machine())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]
