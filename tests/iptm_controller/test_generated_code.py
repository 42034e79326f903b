"""Generated C: steps in vector registers with the bits of the scalar code, and numbers as data."""

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
from iptm_controller.ocp.layout import layout_header
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import StageExpressions
from iptm_controller.ocp.stage_code import LANES, TABLE, StageMap, stage_sources
from iptm_controller.solvers.riccati.stage_system import StageSystem, common_sparsity
from iptm_core.compilation import compile_sources
from iptm_core.compiler import COMPILER_FLAGS, compiler_flags
from iptm_core.parameters import load_parameters
from iptm_core.physics.model_numbers import NUMBERS, SymbolicModel, split_off
from iptm_core.physics.ops import named_function
from iptm_core.state import FloatArray

ALL_KINDS = "3x1+5x5+10x30t"
SETTER = f"void use_numbers(const double *given) {{ {TABLE} = given; }}\n"
NO_NUMBERS = np.empty(0)
AWKWARD = np.array([0.0, np.inf, -np.inf, np.nan, 1.0, 5e-324])
"""No zeros of both signs: C leaves open which of them is the larger or the smaller one."""

pytestmark = pytest.mark.usefixtures("cache")


class Mapped:
    """A function of one step in C, evaluated for several steps at packed places."""

    def __init__(self, function: ca.Function, lanes: int, numbers: FloatArray = NO_NUMBERS) -> None:
        self.function = function
        strides = {name: function.numel_in(name) for name in function.name_in()}
        files = stage_sources([[StageMap(function, strides)]], [], lanes=lanes)
        sizes = '#include "layout.h"\n#define IPTM_NUMBERS_GIVEN\n'
        files = (*files, f"const double *{TABLE};\n{SETTER}")
        sources = {f"stages_{place}.c": text for place, text in enumerate(files)}
        sources |= {**C_SOURCES.read("stages.h", "real.h"), "layout.h": layout_header()}
        library = ctypes.PyDLL(str(compile_sources({**sources, "stage_sizes.h": sizes})))
        self._numbers = numbers
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


def assert_lanes_are_scalar(
    function: ca.Function, counts: Iterable[int], seed: int, numbers: FloatArray = NO_NUMBERS
) -> None:
    rng = np.random.default_rng(seed)
    vector, scalar = Mapped(function, LANES, numbers), Mapped(function, 1, numbers)
    names = [name for name in function.name_in() if name != NUMBERS]
    for count in counts:
        for share in (0.0, 0.001, 0.01, 0.2, 0.9):
            arguments = [rng.uniform(0.1, 2.0, function.numel_in(name) * count) for name in names]
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
    split = split_off(_functions(problem.stage_expressions()))
    for function in split.functions:
        numbers = split.prepare(problem.numbers)
        assert_lanes_are_scalar(function, (3, 5, 10), seed=5, numbers=numbers)


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


@pytest.mark.parametrize(
    ("name", "others"),
    [
        ("paper_calibrated", {}),
        ("paper_identified", {"aging.charging_rate_factor": -1.0}),
        ("bmw_i3", {"gap.desired_time_headway_s": 1.5, "limits.max_heater_power_w": 3000.0}),
        ("bmw_i3", {"cooling.radiator_w_k": 80.0, "chiller.xi_2_1_w": 1e-4}),
    ],
)
def test_numbers_in_the_data_give_what_literals_give(name: str, others: dict[str, float]) -> None:
    """Part by part: data, split off or not, to the last bit; literals, which are combined, to rounding."""
    model = load_parameters(name, others).values
    problem = OptimalControlProblem(Horizon.parse(ALL_KINDS), model)
    data = _functions(problem.stage_expressions())
    split = split_off(data)
    literal = _functions(problem.stage_expressions(SymbolicModel.literal(model)))
    table = split.prepare(problem.numbers)
    rng = np.random.default_rng(7)
    for own, taken, expected in zip(data, split.functions, literal, strict=True):
        for _ in range(20):
            given = {name: rng.uniform(0.1, 0.9, own.size_in(name)) for name in own.name_in()}
            found, again, known = (
                {key: np.array(value) for key, value in function(**given | numbers).items()}
                for function, numbers in (
                    (own, {NUMBERS: problem.numbers}),
                    (taken, {NUMBERS: table}),
                    (expected, {NUMBERS: NO_NUMBERS}),
                )
            )
            for key, value in found.items():
                assert_same(value, again[key])
                assert np.isfinite(value).all()
                scale = np.abs(known[key]).max(initial=1.0)
                np.testing.assert_allclose(value, known[key], rtol=1e-9, atol=1e-11 * scale)


def _functions(stages: list[StageExpressions]) -> list[ca.Function]:
    systems = [StageSystem(stage) for stage in stages]
    sparsity = common_sparsity(systems)
    return [
        function
        for place, system in enumerate(systems)
        for function in (
            system.linearise(sparsity, f"linearise_{place}"),
            system.evaluate(f"evaluate_{place}"),
            system.least_soft_slacks(f"slacks_{place}"),
            system.follow(f"follow_{place}"),
        )
    ]
