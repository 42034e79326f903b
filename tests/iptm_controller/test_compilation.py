"""Compiled problems: once, cached, shared, and a clear message when that is not possible."""

from __future__ import annotations

import ctypes
import logging
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.iptm_controller.scenes import PARAMETERS, solver_with

from iptm_controller.horizon import Horizon
from iptm_controller.solvers.factory import build_plain_solver
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.solvers.riccati import backend
from iptm_core import compilation
from iptm_core.compilation import CACHE_VARIABLE, cache_directory, compile_sources
from iptm_core.compiler import WHEEL_COMPILER, find_compiler, installed_compiler
from iptm_core.errors import SolverSetupError


def square(factor: float = 1.0) -> dict[str, str]:
    return {"square.c": f"double square(double x) {{ return {factor} * x * x; }}\n"}


def at_three(library: Path) -> float:
    function = ctypes.CDLL(str(library)).square
    function.argtypes, function.restype = [ctypes.c_double], ctypes.c_double
    return float(function(3.0))


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide every compiler, of the system and of the environment."""
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, WHEEL_COMPILER, None)


def test_compiles_once_and_finds_it_again(cache: Path, compilations: list[list[str]]) -> None:
    library = compile_sources(square())
    assert library.parent == cache
    assert at_three(library) == 9.0
    assert compile_sources(square()) == library
    assert len(compilations) == 1
    # Nothing but the library and its lock is left behind.
    assert {path.name for path in cache.iterdir()} == {library.name, f"{library.stem}.lock"}


def test_processes_that_need_a_problem_at_once_compile_it_once(
    compiler: tuple[str, ...],
    compilations: list[list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As the controllers of a string of vehicles do."""
    slow = tmp_path / "slow_cc"
    slow.write_text(f'#!/bin/sh\nsleep 0.2\nexec {" ".join(compiler)} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setenv("CC", str(slow))
    with ThreadPoolExecutor(3) as pool:
        libraries = list(pool.map(lambda _: compile_sources(square()), range(3)))
    assert len(set(libraries)) == 1
    assert len(compilations) == 1


@pytest.mark.parametrize("damage", [lambda c: c[:2000], lambda c: c + b"x", lambda _: b""])
def test_a_damaged_library_is_compiled_again(
    cache: Path,
    compilations: list[list[str]],
    damage: Callable[[bytes], bytes],
) -> None:
    """The loader would crash the process on a cut one, at every start."""
    library = compile_sources(square())
    library.write_bytes(damage(library.read_bytes()))
    assert compile_sources(square()) == library
    assert at_three(library) == 9.0
    assert len(compilations) == 2
    assert list(cache.glob("*.so")) == [library]


def test_a_library_of_something_else_is_a_clear_error(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreign = compile_sources(square())
    monkeypatch.setattr(backend, "compile_sources", lambda _: foreign)
    with pytest.raises(SolverSetupError, match="'riccati' cannot be set up") as caught:
        solver_with("1x1", SolverOptions())
    assert foreign.parent == cache
    assert "iptm_checked_work_size" in str(caught.value)


@pytest.mark.parametrize("place", ["file", "noexec", "/proc/none"])
def test_a_cache_that_cannot_run_code_is_replaced(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    place: str,
) -> None:
    """By a temporary folder; where that cannot either, both are named."""
    (tmp_path / "file").write_text("in the way")
    folder, is_noexec = tmp_path / place / "cache", place == "noexec"
    spare = tmp_path / "temporary"
    spare.mkdir()
    monkeypatch.setenv(CACHE_VARIABLE, str(folder))
    monkeypatch.setattr("tempfile.tempdir", str(spare))
    mounted = os.statvfs

    def statvfs(path: Path) -> object:
        """Every folder but that of temporary files is on a noexec mount."""
        flags = 0 if Path(path).is_relative_to(spare) or not is_noexec else os.ST_NOEXEC
        return SimpleNamespace(f_flag=mounted(path).f_flag | flags)

    monkeypatch.setattr(os, "statvfs", statvfs)
    with caplog.at_level(logging.WARNING):
        library = compile_sources(square())
    assert library.parent == spare / f"iptm_user_{os.getuid()}"
    assert caplog.text.count("is used") == 1
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    with pytest.raises(SolverSetupError, match="IPTM_CACHE_DIR"):
        compile_sources(square())


def test_a_compiler_that_fails_is_quoted(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = tmp_path / "cc_broken"
    fake.write_text("#!/bin/sh\necho 'fatal: no target' >&2\nexit 4\n")
    fake.chmod(0o755)
    monkeypatch.setenv("CC", str(fake))
    with pytest.raises(SolverSetupError, match="failed with exit code 4: fatal: no target"):
        build_plain_solver(Horizon.parse("1x1"), PARAMETERS, SolverOptions())
    assert not list(cache.glob("*.so"))


@pytest.mark.usefixtures("cache")
def test_a_compiler_that_hangs_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "cc_slow"
    fake.write_text('#!/bin/sh\n[ "$1" = --version ] && exit 0\nexec sleep 60\n')
    fake.chmod(0o755)
    monkeypatch.setattr("iptm_core.compiler.COMPILE_TIMEOUT_S", 0.2)
    monkeypatch.setenv("CC", str(fake))
    with pytest.raises(SolverSetupError, match="did not finish within"):
        compile_sources(square())


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_error_names_both(cache: Path) -> None:
    with pytest.raises(SolverSetupError, match=f"gcc.*{WHEEL_COMPILER}"):
        build_plain_solver(Horizon.parse("1x1"), PARAMETERS, SolverOptions())
    assert not cache.exists()


@pytest.mark.usefixtures("no_compiler")
def test_compiler_of_the_environment_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "my_cc"
    own.write_text("#!/bin/sh\n")
    own.chmod(0o755)
    monkeypatch.setenv("CC", str(own))
    assert find_compiler() == (str(own),)
    monkeypatch.setenv("CC", f"{own} -march=native")
    assert find_compiler() == (str(own), "-march=native")
    monkeypatch.setenv("CC", "no_such_compiler_anywhere")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert installed_compiler() is None
    own.rename(tmp_path / "gcc")
    assert find_compiler() == (str(tmp_path / "gcc"),)


def test_compiler_of_the_environments_wheel_comes_last(
    tmp_path: Path, cache: Path, compiler: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its default is the processor of this machine; what is in the cache must run on any."""
    compile_sources(square())
    package = tmp_path / "site" / WHEEL_COMPILER
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    shim = f'PATH={os.environ["PATH"]}\n[ "$1 $2" = "cc -target" ] && shift 3 && exec '
    (package / "zig").write_text(f'#!/bin/sh\n{shim}{" ".join(compiler)} "$@"\n')
    (package / "zig").chmod(0o755)
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    monkeypatch.delitem(sys.modules, WHEEL_COMPILER, raising=False)
    monkeypatch.syspath_prepend(package.parent)
    found = find_compiler()
    assert found[:3] == (str(package / "zig"), "cc", "-target")
    assert at_three(compile_sources(square())) == 9.0
    # What other arguments make of the same source is another entry; the machine may have the wheel's only.
    assert len(list(cache.glob("*.so"))) == 1 + (compiler[1:] != found[1:])
    monkeypatch.setenv("CC", compiler[0])
    assert find_compiler() == compiler[:1]


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({CACHE_VARIABLE: "/somewhere"}, "/somewhere"),
        ({"XDG_CACHE_HOME": "/xdg"}, "/xdg/iptm"),
        ({"HOME": "/home/someone"}, "/home/someone/.cache/iptm"),
    ],
)
def test_place_of_the_cache(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], expected: str
) -> None:
    for name in (CACHE_VARIABLE, "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert cache_directory() == Path(expected) / f"user_{os.getuid()}"


def test_code_of_others_is_never_loaded(
    cache: Path, compilations: list[list[str]], tmp_path: Path
) -> None:
    """Write access to the folder would allow running code as its owner."""
    cache.mkdir(parents=True, mode=0o777)
    cache.chmod(0o777)
    library = compile_sources(square())
    assert cache.stat().st_mode & 0o777 == 0o700
    library.chmod(0o666)  # writable by any user
    compile_sources(square())
    assert len(compilations) == 2
    moved = library.rename(tmp_path / "elsewhere.so")
    library.symlink_to(moved)
    compile_sources(square())
    assert len(compilations) == 3
    assert not library.is_symlink()


def test_a_folder_of_another_user_is_refused(
    cache: Path, tmp_path: Path, compilations: list[list[str]]
) -> None:
    (tmp_path / "theirs").mkdir()
    cache.parent.mkdir()
    cache.symlink_to(tmp_path / "theirs")
    with pytest.raises(SolverSetupError, match="not a folder of this user"):
        compile_sources(square())
    assert not compilations


def test_what_killed_compilations_left_is_removed(cache: Path) -> None:
    cache.mkdir(parents=True)
    old, new = cache / "build_old", cache / "build_new"
    for folder in (old, new):
        folder.mkdir()
        (folder / "square.c").touch()
    os.utime(old, (0, 0))
    compile_sources(square())
    assert not old.exists()
    assert new.exists(), "another process may still be compiling there"


def test_the_cache_keeps_what_was_used_last(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "LIBRARIES_KEPT", 2)
    first, second = (compile_sources(square(factor)) for factor in (3.25, 4.25))
    for age_s, library in ((200.0, first), (100.0, second)):
        os.utime(library, (time.time() - age_s,) * 2)
    assert compile_sources(square(3.25)) == first  # in use again
    third = compile_sources(square(5.25))
    assert set(cache.glob("*.so")) == {first, third}
