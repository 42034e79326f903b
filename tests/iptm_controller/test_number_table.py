"""Numbers in a table of the library: other models without a compiler, with the same bits."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import compilation
from iptm_controller.ocp.compilation import compile_functions
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.program import build_program
from iptm_core.parameters import load_parameters


def line(slope: float, offset: float) -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("line", [x], [slope * x + offset])


def value_at(function: ca.Function, x: float, compiler: tuple[str, ...]) -> float:
    return float(ca.external(function.name(), str(compile_functions([function], compiler)))(x))


def test_other_numbers_compile_nothing(
    compiler: tuple[str, ...], compilations: list[list[str]]
) -> None:
    for slope, offset in ((3.25, 0.1), (7.5, 1e-9), (1.0 / 3.0, 1e300)):
        assert value_at(line(slope, offset), 1.7, compiler) == slope * 1.7 + offset
        assert len(compilations) == 1
    # Equal numbers share an entry, so that this is other code.
    assert value_at(line(3.25, 3.25), 1.7, compiler) == 3.25 * 1.7 + 3.25
    assert len(compilations) == 2


def test_a_library_that_cannot_be_copied_is_compiled(
    compiler: tuple[str, ...],
    compilations: list[list[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    value_at(line(3.25, 0.1), 1.0, compiler)
    monkeypatch.setattr(compilation, "with_numbers", lambda *_: None)
    assert value_at(line(4.25, 0.1), 1.0, compiler) == 4.25 + 0.1
    assert len(compilations) == 2


def test_another_vehicle_shares_the_machine_code_bit_by_bit(
    compiler: tuple[str, ...],
    compilations: list[list[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside what the compiler makes of literals."""
    horizon = Horizon.parse("2x1")
    random = np.random.default_rng(1)
    programs = [
        build_program(OptimalControlProblem(horizon, load_parameters(overrides=overrides).values))
        for overrides in ({}, {"body.mass_kg": 1850.0, "body.drag_coefficient": 0.27})
    ]
    libraries = [compile_functions(program, compiler) for program in programs]
    assert len(compilations) == 1
    monkeypatch.setattr(compilation, "split_numbers", lambda source: (source, ()))
    literal = compile_functions(programs[1], compiler)
    assert len(compilations) == 2
    for function in programs[1]:
        shapes = [function.sparsity_in(place) for place in range(function.n_in())]
        arguments = [ca.DM(shape, random.uniform(0.5, 1.5, shape.nnz())) for shape in shapes]
        own, expected = (
            ca.external(function.name(), str(library)).call(arguments)
            for library in (libraries[1], literal)
        )
        for one, other in zip(own, expected, strict=True):
            assert np.array_equal(np.asarray(one), np.asarray(other), equal_nan=True)
