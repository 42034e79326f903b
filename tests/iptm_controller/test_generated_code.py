"""Generated C: steps in vector registers and numbers in an array, with the bits of the scalar code."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS

from iptm_controller.c_sources import C_SOURCES
from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout, stages
from iptm_controller.ocp.layout import layout_header
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage_code import LANES, NUMBERS, StageMap, stage_sources
from iptm_controller.solvers.riccati.stage_system import (
    StageSparsity,
    StageSystem,
    common_sparsity,
)
from iptm_core.compilation import compile_sources
from iptm_core.compiler import COMPILER_FLAGS, compiler_flags
from iptm_core.parameters import load_parameters
from iptm_core.physics.ops import named_function
from iptm_core.physics.powertrain import MassLoad
from iptm_core.state import FloatArray

ALL_KINDS = "3x1+5x5+10x30t"
SETTER = f"void use_numbers(const double *given) {{ {NUMBERS} = given; }}\n"
AWKWARD = np.array([0.0, np.inf, -np.inf, np.nan, 1.0, 5e-324])
"""No zeros of both signs: C leaves open which of them is the larger or the smaller one."""

pytestmark = pytest.mark.usefixtures("cache")


class Mapped:
    """A function of one step in C, evaluated for several steps at packed places."""

    def __init__(self, function: ca.Function, lanes: int) -> None:
        self.function = function
        strides = {name: function.numel_in(name) for name in function.name_in()}
        files, numbers = stage_sources([[StageMap(function, strides)]], [], lanes=lanes)
        sizes = '#include "layout.h"\n'
        if numbers:
            sizes += "#define IPTM_NUMBERS\n"
            files = (*files, f"const double *{NUMBERS};\n{SETTER}")
        sources = {f"stages_{place}.c": text for place, text in enumerate(files)}
        sources |= {**C_SOURCES.read("stages.h", "real.h"), "layout.h": layout_header()}
        library = ctypes.PyDLL(str(compile_sources({**sources, "stage_sizes.h": sizes})))
        self._numbers = np.array(numbers)
        if numbers:
            library.use_numbers(ctypes.c_void_p(self._numbers.ctypes.data))
        self._call = library[function.name()]

    def __call__(self, arguments: list[FloatArray], count: int) -> list[FloatArray]:
        results = [
            np.empty(self.function.nnz_out(place) * count) for place in range(self.function.n_out())
        ]
        pointers = (
            (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
            for arrays in (arguments, results)
        )
        self._call(*pointers, count)
        return results


def assert_lanes_are_scalar(function: ca.Function, counts: Iterable[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    vector, scalar = Mapped(function, LANES), Mapped(function, 1)
    for count in counts:
        for share in (0.0, 0.001, 0.01, 0.2, 0.9):
            arguments = [
                rng.uniform(0.1, 2.0, function.numel_in(place) * count)
                for place in range(function.n_in())
            ]
            make_awkward(arguments, rng, share)
            for one, other in zip(vector(arguments, count), scalar(arguments, count), strict=True):
                assert_same(one, other)


def assert_same(one: FloatArray, other: FloatArray) -> None:
    """Bits are compared, but for the sign and payload of NaN, which mean nothing."""
    np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
    bits = [np.where(np.isnan(array), 0.0, array).view(np.int64) for array in (one, other)]
    np.testing.assert_array_equal(*bits)


def make_awkward(arguments: list[FloatArray], rng: np.random.Generator, share: float) -> None:
    for argument in arguments:
        chosen = rng.random(argument.shape) < share
        argument[chosen] = rng.choice(AWKWARD, int(chosen.sum()))


def test_every_stage_kind_gives_the_bits_of_the_scalar_code() -> None:
    problem = OptimalControlProblem(Horizon.parse(ALL_KINDS), PARAMETERS)
    systems = [StageSystem(stage, problem.model) for stage in problem.stage_expressions()]
    sparsity = common_sparsity(systems)
    for system in systems:
        for function in _functions(system, sparsity):
            assert_lanes_are_scalar(function, (3, 5, 10), seed=5)


def test_every_operation_and_number_of_points() -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    a, b = x[0], x[1]
    values = [a + b, a - b, a * b, a / b, -a, 2 * a, 1 / a, a**2, a**2.3, a**b, ca.sqrt(a)]
    values += [ca.fmax(a, b), ca.fmin(a, b), ca.fabs(a), ca.sign(a), ca.floor(a), ca.fmod(a, b)]
    values += [ca.sin(a), ca.cos(a), ca.tan(a), ca.exp(a), ca.log(a), ca.tanh(a), ca.atan2(a, b)]
    values += [a < b, a <= b, ca.eq(a, b), ca.ne(a, b), ca.logic_not(a), ca.logic_and(a, b)]
    values += [ca.logic_or(a, b), ca.if_else(a < b, a, y), ca.copysign(a, b), y - 0.1]
    results = {"values": ca.vertcat(*values), "product": a * y}
    function = named_function("operations", {"x": x, "y": y}, results)
    assert_lanes_are_scalar(function, (1, 2, 3, 4, 5, 8, 9, 11), seed=1)


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
    terms = ca.fmax(x[0] / x[1], ca.sqrt(x[2])) * x
    function = named_function("terms", {"x": x}, {"terms": terms})
    arguments = [np.random.default_rng(1).uniform(0.1, 2.0, 21)]
    newest = Mapped(function, LANES)(arguments, 7)
    monkeypatch.setattr("iptm_core.compiler._CPU_INFO", tmp_path / "none")
    assert_same(newest[0], Mapped(function, LANES)(arguments, 7)[0])


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
                arguments = [rng.uniform(0.1, 2.0, own.size_in(i)) for i in range(own.n_in())]
                arguments[own.index_in("g")][layout.MASS_LOAD, 0] = load
                results = (function.call(arguments) for function in (own, expected))
                for one, other in zip(*results, strict=True):
                    assert_same(np.array(one), np.array(other))


def _functions(system: StageSystem, sparsity: StageSparsity) -> list[ca.Function]:
    written = (
        system.evaluate("evaluate"),
        system.least_soft_slacks("slacks"),
        system.follow("follow"),
    )
    return [system.linearise(sparsity, "linearise"), *written]
