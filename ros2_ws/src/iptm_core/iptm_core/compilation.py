"""Generated C for the functions of a nonlinear program, compiled once and cached.

The cache key is a hash of everything the machine code depends on: the generated source, the compiler with its
version and flags, and the machine architecture. A hash of the numbers follows (model parameters, smoothing
widths, step lengths). A second start with the same problem compiles nothing, and neither does a problem that
differs in numbers alone: a library of the same code is copied with its numbers (see `compiler`). Each
library ends with the digest of what is before it, which the loader ignores: a damaged one is compiled again,
not loaded.
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
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from iptm_core.compiler import (
    COMPILE_TIMEOUT_S,
    compiler_flags,
    compiler_version,
    installed_compiler,
    numbers_key,
    run_compilers,
    split_numbers,
    table_declaration,
    table_source,
    with_numbers,
)
from iptm_core.errors import SolverSetupError

LOGGER = logging.getLogger(__name__)
CACHE_VARIABLE = "IPTM_CACHE_DIR"
LIBRARIES_KEPT = 200
"""Libraries of up to half a megabyte; the ones unused for longest are removed."""
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
    found = installed_compiler()
    if found is None:
        LOGGER.warning("no C compiler found: the problem runs interpreted, several times slower")
    return found


@dataclass(frozen=True)
class Compilation:
    """C code for one shared library, and where in the cache it belongs.

    Attributes:
        sources: C files and headers by name, but for the table of numbers.
        numbers: the table.
        command: the compiler with its flags.
        code: name of the code; libraries with the same code differ in numbers alone.
    """

    sources: Mapping[str, str]
    numbers: tuple[float, ...]
    command: tuple[str, ...]
    code: Path

    @classmethod
    def of(
        cls,
        generated: Sequence[str],
        numbers: tuple[float, ...],
        fixed: Mapping[str, str],
        compiler: Sequence[str],
        flags: Sequence[str],
    ) -> Compilation:
        """Return the compilation of C code.

        Args:
            generated: C files that read their numbers from a table, see `split_numbers`.
            numbers: the table.
            fixed: further files by name, headers included.

        Raises:
            SolverSetupError: the cache folder cannot be written or is not private.
        """
        declaration = table_declaration() if numbers else ""
        sources = {f"ocp_{place}.c": declaration + part for place, part in enumerate(generated)}
        sources.update(fixed)
        folder = cache_directory()
        _make_private(folder)
        code = folder / f"ocp_{_cache_key(sources, compiler, flags)}"
        return cls(sources, numbers, (*compiler, *flags), code)

    @property
    def library(self) -> Path:
        """The library, whether it is there or not."""
        return self.code.with_name(f"{self.code.name}{numbers_key(self.numbers)}.so")

    def find(self) -> Path | None:
        """Return the library from the cache, or a copy with other numbers of one with the same code."""
        if _is_intact(self.library):
            with contextlib.suppress(OSError):
                os.utime(self.library)  # it is not the one unused for longest
            return self.library
        # What cannot be read or written here is compiled, which reports it.
        with contextlib.suppress(OSError):
            for other in filter(_is_intact, self.code.parent.glob(f"{self.code.name}_*.so")):
                content = with_numbers(other.read_bytes()[:-DIGEST_SIZE], self.numbers)
                if content is not None:
                    with _scratch_in(self.code.parent) as scratch:
                        _put(self.library, content, scratch)
                    _remove_unused(self.code.parent)
                    return self.library
        return None

    def make(self) -> Path:
        """Compile the library, unless another process has done so meanwhile.

        Raises:
            SolverSetupError: the compiler fails, or the cache folder cannot be written.
        """
        folder = self.library.parent
        try:
            with locked(self.code.with_suffix(".lock")):
                if self.find() is not None:
                    return self.library
                LOGGER.info("compiling the optimal control problem (once per horizon and model)")
                _remove_abandoned(folder)
                with _scratch_in(folder) as scratch:
                    _put(self.library, self._build(scratch).read_bytes(), scratch)
                _remove_unused(folder)
        except OSError as error:
            raise _not_writable(folder, error) from error
        return self.library

    @property
    def _failure(self) -> Path:
        return self.library.with_suffix(".failed")

    def note_failure(self, reason: str) -> None:
        """Keep in the cache why the library could not be compiled."""
        with _scratch_in(self._failure.parent) as scratch:
            (scratch / "reason").write_text(reason, encoding="utf-8")
            (scratch / "reason").replace(self._failure)

    def take_failure(self) -> str:
        """Return, and remove from the cache, why the library could not be compiled; empty if it could."""
        try:
            reason = self._failure.read_text(encoding="utf-8")
            self._failure.unlink()
        except OSError:
            return ""
        return reason

    def _build(self, scratch: Path) -> Path:
        """Compile files into a library, at the same time if there is more than one."""
        sources = {**self.sources, "numbers.c": table_source(self.numbers)}
        for name, text in sources.items():
            (scratch / name).write_text(text, encoding="ascii")
        files = [str(scratch / name) for name in sources if name.endswith(".c")]
        if len(files) > 2:
            run_compilers([*self.command, "-c", file, "-o", f"{file}.o"] for file in files)
            files = [f"{file}.o" for file in files]
        built = scratch / "ocp.so"
        run_compilers([[*self.command, *files, "-o", str(built), "-lm"]])
        return built


def compile_sources(
    generated: Sequence[str], fixed: Mapping[str, str], compiler: Sequence[str]
) -> Path:
    """Compile C code into one shared library, or find it in the cache; see `Compilation`."""
    text, numbers = split_numbers(_BETWEEN_FILES.join(generated))
    parts = text.split(_BETWEEN_FILES) if generated else []
    compilation = Compilation.of(parts, numbers, fixed, compiler, compiler_flags())
    return compilation.find() or compilation.make()


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


def _cache_key(sources: Mapping[str, str], compiler: Sequence[str], flags: Sequence[str]) -> str:
    import casadi as ca  # noqa: PLC0415  not for the process that only compiles

    version = compiler_version(tuple(compiler))
    arguments = " ".join([*compiler[1:], *flags])
    code = [part for file in sources.items() for part in file]
    parts = (*code, version, arguments, platform.machine(), ca.CasadiMeta.version())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]
