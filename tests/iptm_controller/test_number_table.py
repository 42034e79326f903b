"""Numbers in a table of the library: other models without a compiler, with the same bits."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import compilation
from iptm_controller.ocp.compilation import CACHE_VARIABLE, compile_functions, find_compiler
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.program import build_program
from iptm_core.parameters import load_parameters

COMPILER = find_compiler()
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")


@pytest.fixture
def compilations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Command lines of the compiler, with a cache of their own."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    commands: list[list[str]] = []
    original = subprocess.run

    def run(command: list[str], **options: Any) -> Any:
        if "--version" not in command:
            commands.append(command)
        return original(command, **options)

    monkeypatch.setattr(subprocess, "run", run)
    return commands


def line(slope: float, offset: float) -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("line", [x], [slope * x + offset])


def value_at(function: ca.Function, x: float) -> float:
    return float(ca.external(function.name(), str(compile_functions([function], COMPILER)))(x))


@needs_compiler
def test_other_numbers_compile_nothing(compilations: list[list[str]]) -> None:
    for slope, offset in ((3.25, 0.1), (7.5, 1e-9), (1.0 / 3.0, 1e300)):
        assert value_at(line(slope, offset), 1.7) == slope * 1.7 + offset
        assert len(compilations) == 1
    # Equal numbers share an entry, so that this is other code.
    assert value_at(line(3.25, 3.25), 1.7) == 3.25 * 1.7 + 3.25
    assert len(compilations) == 2


@needs_compiler
def test_a_library_that_cannot_be_copied_is_compiled(
    compilations: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    value_at(line(3.25, 0.1), 1.0)
    monkeypatch.setattr(compilation, "with_numbers", lambda *_: None)
    assert value_at(line(4.25, 0.1), 1.0) == 4.25 + 0.1
    assert len(compilations) == 2


@needs_compiler
def test_another_vehicle_shares_the_machine_code_bit_by_bit(
    compilations: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside what the compiler makes of literals."""
    horizon = Horizon.parse("2x1")
    random = np.random.default_rng(1)
    programs = [
        build_program(OptimalControlProblem(horizon, load_parameters(overrides=overrides).values))
        for overrides in ({}, {"body.mass_kg": 1850.0, "body.drag_coefficient": 0.27})
    ]
    libraries = [compile_functions(program, COMPILER) for program in programs]
    assert len(compilations) == 1
    monkeypatch.setattr(compilation, "split_numbers", lambda source: (source, ()))
    literal = compile_functions(programs[1], COMPILER)
    assert len(compilations) == 2
    for function in programs[1]:
        arguments = [
            random.uniform(0.5, 1.5, function.sparsity_in(place).nnz())
            for place in range(function.n_in())
        ]
        arguments = [
            ca.DM(function.sparsity_in(place), values) for place, values in enumerate(arguments)
        ]
        results = [
            [
                np.asarray(result)
                for result in ca.external(function.name(), str(library)).call(arguments)
            ]
            for library in (*libraries, literal)
        ]
        for own, expected in zip(results[1], results[2], strict=True):
            assert np.array_equal(own, expected, equal_nan=True)
