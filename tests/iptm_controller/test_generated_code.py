"""Generated C: maps in vector registers and numbers in a table, with the bits of the scalar code."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout, stages
from iptm_controller.ocp.compilation import compile_functions, vectorise_maps
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.backend import as_machine_code
from iptm_controller.solvers.riccati.program import build_program
from iptm_controller.solvers.riccati.stage_program import stage_program
from iptm_controller.solvers.riccati.stage_system import (
    StageSparsity,
    StageSystem,
    common_sparsity,
)
from iptm_core import compilation
from iptm_core.compilation import find_compiler
from iptm_core.compiler import COMPILER_FLAGS, compiler_flags
from iptm_core.parameters import load_parameters
from iptm_core.physics.powertrain import MassLoad
from iptm_core.state import FloatArray

ALL_KINDS = "3x1+5x5+10x30t"
AWKWARD = np.array([0.0, np.inf, -np.inf, np.nan, 1.0, 5e-324])
"""No zeros of both signs: C leaves open which of them is the larger or the smaller one."""

pytestmark = pytest.mark.usefixtures("compiler", "cache")


def plain_source(functions: list[ca.Function]) -> str:
    generator = ca.CodeGenerator("ocp.c", {"with_header": False})
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def load(functions: list[ca.Function]) -> list[ca.Function]:
    compiler = find_compiler()
    library = str(compile_functions(functions, compiler))
    return [ca.external(function.name(), library) for function in functions]


def both(
    functions: list[ca.Function], monkeypatch: pytest.MonkeyPatch
) -> list[tuple[ca.Function, ca.Function]]:
    """Compiled as vectors, and as CasADi writes them."""
    vectors = load(functions)
    monkeypatch.setattr("iptm_controller.ocp.compilation.vectorise_maps", lambda source: source)
    return list(zip(vectors, load(functions), strict=True))


def assert_same(vector: ca.Function, scalar: ca.Function, arguments: list[FloatArray]) -> None:
    """Bits are compared, but for the sign and payload of NaN, which mean nothing."""
    results, expected = (
        [np.array(result) for result in function.call(arguments)] for function in (vector, scalar)
    )
    for name, one, other in zip(scalar.name_out(), results, expected, strict=True):
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other), err_msg=name)
        bits = [np.where(np.isnan(array), 0.0, array).view(np.int64) for array in (one, other)]
        np.testing.assert_array_equal(*bits, err_msg=name)


def random_arguments(function: ca.Function, rng: np.random.Generator) -> list[FloatArray]:
    return [rng.uniform(0.1, 2.0, function.size_in(i)) for i in range(function.n_in())]


def make_awkward(arguments: list[FloatArray], rng: np.random.Generator, share: float) -> None:
    for argument in arguments:
        chosen = rng.random(argument.shape) < share
        argument[chosen] = rng.choice(AWKWARD, int(chosen.sum()))


def test_every_stage_kind_gives_the_bits_of_the_scalar_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = OptimalControlProblem(Horizon.parse(ALL_KINDS), PARAMETERS)
    systems = [StageSystem(stage, problem.model) for stage in problem.stage_expressions()]
    sparsity = common_sparsity(systems)
    maps = [
        function.map(kind.count)
        for index, (system, kind) in enumerate(zip(systems, problem.grid.stages, strict=True))
        for function in (
            system.linearise(sparsity, f"linearise_{index}"),
            system.evaluate(f"evaluate_{index}"),
            system.least_soft_slacks(f"slacks_{index}"),
        )
    ]
    rng = np.random.default_rng(5)
    for vector, scalar in both(maps, monkeypatch):
        for share in (0.0, 0.0, 0.001, 0.01, 0.1):
            arguments = random_arguments(scalar, rng)
            make_awkward(arguments, rng, share)
            assert_same(vector, scalar, arguments)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 8, 9, 11])
def test_every_operation_and_number_of_points(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    a, b = x[0], x[1]
    values = [a + b, a - b, a * b, a / b, -a, 2 * a, 1 / a, a**2, a**2.3, a**b, ca.sqrt(a)]
    values += [ca.fmax(a, b), ca.fmin(a, b), ca.fabs(a), ca.sign(a), ca.floor(a), ca.fmod(a, b)]
    values += [ca.sin(a), ca.cos(a), ca.tan(a), ca.exp(a), ca.log(a), ca.tanh(a), ca.atan2(a, b)]
    values += [a < b, a <= b, ca.eq(a, b), ca.ne(a, b), ca.logic_not(a), ca.logic_and(a, b)]
    values += [ca.logic_or(a, b), ca.if_else(a < b, a, y), ca.copysign(a, b), y - 0.1]
    function = ca.Function("operations", [x, y], [ca.vertcat(*values), a * y]).map(count)
    u, v = ca.MX.sym("u", 2, count), ca.MX.sym("v", 1, count)
    # The second result is not asked for, so that its pointer is null.
    first = ca.Function("first", [u, v], [function(u, v)[0]])
    rng = np.random.default_rng(count)
    for vector, scalar in both([function, first], monkeypatch):
        for share in (0.0, 0.2, 0.9):
            arguments = [rng.normal(size=scalar.size_in(i)) for i in range(2)]
            make_awkward(arguments, rng, share)
            assert_same(vector, scalar, arguments)


def test_a_solver_has_no_map_left_that_goes_point_by_point() -> None:
    """Fails when another release of CasADi writes maps in another way: correct, but slower."""
    functions = build_program(OptimalControlProblem(Horizon.parse("2x1+5x5"), PARAMETERS))
    plain = plain_source(functions)
    maps = plain.count("\n/* map")
    assert maps > 0
    assert vectorise_maps(plain).count("_group(const casadi_real** arg") == maps


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("model name\t: A\nflags\t\t: fpu avx avx2 fma\n", ("-mavx2",)),
        ("flags\t\t: fpu avx\n", ()),
        ("Features\t: fp asimd\n", ()),
        (None, ()),
    ],
)
def test_avx2_is_used_where_the_processor_has_it(
    text: str | None, expected: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "cpuinfo"
    if text is not None:
        info.write_text(text)
    monkeypatch.setattr("iptm_core.compiler._CPU_INFO", info)
    assert compiler_flags() == (*COMPILER_FLAGS, *expected)


def test_an_older_processor_computes_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = ca.SX.sym("x", 3)
    function = ca.Function("terms", [x], [ca.fmax(x[0] / x[1], ca.sqrt(x[2])) * x]).map(7)
    arguments = random_arguments(function, np.random.default_rng(1))
    (newest,) = load([function])
    monkeypatch.setattr("iptm_core.compiler._CPU_INFO", tmp_path / "none")
    (oldest,) = load([function])
    assert_same(newest, oldest, arguments)


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
    """Compared with what the compiler makes of literals."""
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


@pytest.mark.parametrize("name", ["paper_calibrated", "bmw_i3"])
@pytest.mark.parametrize("mass_kg", [921.3, 1850.0, 40e3 / 3.0])
def test_a_mass_in_the_data_gives_the_bits_of_one_in_the_code(
    name: str, mass_kg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = load_parameters(name, {"body.mass_kg": mass_kg}).values
    problem = OptimalControlProblem(Horizon.parse(ALL_KINDS), model)
    in_data = problem.without_load.stage_expressions()
    load = MassLoad.of(model.body)
    monkeypatch.setattr(stages, "MassLoad", lambda *_: load)
    in_code = problem.stage_expressions()
    rng = np.random.default_rng(7)
    both_forms = [[StageSystem(stage, model) for stage in form] for form in (in_data, in_code)]
    sparsity = common_sparsity(both_forms[0])
    assert sparsity == common_sparsity(both_forms[1])
    for systems in zip(*both_forms, strict=True):
        for own, expected in zip(*(_functions(each, sparsity) for each in systems), strict=True):
            for _ in range(20):
                arguments = random_arguments(own, rng)
                arguments[own.index_in("g")][layout.MASS_LOAD, 0] = load
                assert_same(own, expected, arguments)


def _functions(system: StageSystem, sparsity: StageSparsity) -> list[ca.Function]:
    written = (
        system.evaluate("evaluate"),
        system.least_soft_slacks("slacks"),
        system.follow("follow"),
    )
    return [system.linearise(sparsity, "linearise"), *written]


def test_other_masses_share_one_library(cache: Path) -> None:
    """No number of the mass is left in the code."""
    for mass_kg in (1500.0, 1234.5, 3000.0):
        model = load_parameters(overrides={"body.mass_kg": mass_kg}).values
        problem = OptimalControlProblem(Horizon.parse("2x3"), model)
        assert as_machine_code(problem, is_wanted=True) is not None
    assert len(list(cache.glob("*.so"))) == 1
    assert "NAN" not in "".join(stage_program(problem.without_load).sources)
