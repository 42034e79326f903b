"""Code that is used before it is optimised, and what becomes of the process that optimises it."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from tests.iptm_controller.scenes import SCENES, problem_of, solver_with

from iptm_controller.solvers.interface import SolverOptions
from iptm_core.compilation import locked
from iptm_core.optimised_code import TURN, WAITING, NewestLibrary, compile_in_steps


def await_(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert condition()


def test_a_solver_begins_unoptimised_and_goes_on_optimised_with_the_same_numbers(
    cache: Path, compiler: tuple[str, ...]
) -> None:
    del compiler
    problems = [problem_of(scene, "2x1") for scene in SCENES.values()]
    cache.mkdir(parents=True)
    with locked(cache / TURN):  # the optimised code is not compiled yet
        solver = solver_with("2x1", SolverOptions())
        assert len(list(cache.glob("*.so"))) == 1
        before = [solver.solve(*problem) for problem in problems]
    await_(lambda: len(list(cache.glob("*.so"))) == 2)
    for later in (solver, solver_with("2x1", SolverOptions())):
        for problem, expected in zip(problems, before, strict=True):
            found = later.solve(*problem)
            assert np.array_equal(found.variables, expected.variables)
            assert found.iterations == expected.iterations


def optimising(cache: Path) -> int:
    """Return how many processes optimise or wait for it: each has the file of its place open."""
    places = [str(path) for path in cache.glob("optimising_*.lock")]
    opened = 0
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            opened += any(str(each.readlink()) in places for each in (process / "fd").iterdir())
    return opened


def test_few_processes_wait_for_their_turn(cache: Path, compiler: tuple[str, ...]) -> None:
    """Of twelve models, each with code of its own; what was left out is optimised later."""
    sources = [f"int number(void) {{ return {number}; }}" for number in range(12)]

    def load(path: Path) -> ctypes.PyDLL:
        return ctypes.PyDLL(str(path))

    def improve_all() -> None:
        for source in sources:
            compile_in_steps([source], (), {}, compiler, load).improve()

    cache.mkdir(parents=True)
    with locked(cache / TURN):
        improve_all()
        assert optimising(cache) == WAITING
    await_(lambda: optimising(cache) == 0)
    while len(list(cache.glob("*.so"))) < 2 * len(sources):
        improve_all()
        await_(lambda: optimising(cache) == 0)


def in_steps(compiler: Sequence[str]) -> NewestLibrary:
    """Return a function that is 1 where it is compiled with optimisation."""
    source = """
#ifdef __OPTIMIZE__
int optimised(void) { return 1; }
#else
int optimised(void) { return 0; }
#endif
"""
    return compile_in_steps([source], (), {}, compiler, lambda path: ctypes.PyDLL(str(path)))


def optimised(compiler: Sequence[str]) -> int:
    library = in_steps(compiler)
    found: int = library.newest.optimised()
    return found


def with_a_line(folder: Path, compiler: Sequence[str], line: str) -> list[str]:
    """Return a compiler that does something before."""
    program = folder / "cc"
    program.write_text(f'#!/bin/sh\n{line}\nexec {" ".join(compiler)} "$@"\n')
    program.chmod(0o755)
    return [str(program)]


def improve_in_a_program(compiler: Sequence[str]) -> None:
    """Begin to optimise in a program that ends at once."""
    code = f"from {__name__} import in_steps; in_steps({compiler}).improve()"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


@pytest.mark.usefixtures("cache")
def test_optimised_code_is_found_after_a_program_that_ended_before(
    compiler: tuple[str, ...], tmp_path: Path
) -> None:
    gate = tmp_path / "gate"
    wait = f"while [ ! -e {gate} ]; do sleep 0.05; done"
    slow = with_a_line(tmp_path, compiler, f'for each; do [ "$each" = -O1 ] && {wait}; done')
    improve_in_a_program(slow)
    assert optimised(slow) == 0
    gate.touch()
    await_(lambda: optimised(slow) == 1)


def test_a_failure_to_optimise_is_reported_once(
    cache: Path, compiler: tuple[str, ...], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """By the program under way, else by the next one."""
    line = 'for each; do [ "$each" = -O1 ] && echo "error: no space left" >&2 && exit 1; done'
    half = with_a_line(tmp_path, compiler, line)
    library = in_steps(half)
    quick = library.newest
    library.improve()
    await_(lambda: "no space left" in caplog.text)
    assert library.newest is quick
    improve_in_a_program(half)
    await_(lambda: bool(list(cache.glob("*.failed"))))
    for _ in range(2):
        assert optimised(half) == 0
        assert caplog.text.count("no space left") == 2
