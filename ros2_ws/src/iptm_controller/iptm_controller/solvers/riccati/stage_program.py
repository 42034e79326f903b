"""The functions of the stages as C, for the interior-point method in C (`iptm_controller/c`).

``riccati.c`` joins them to a horizon. The code depends on the
stage kinds and not on how many steps there are of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import StageExpressions
from iptm_controller.ocp.stage_code import LANES, TABLE, StageMap, stage_sources
from iptm_controller.solvers.riccati.recursion import backward_step, forward_step
from iptm_controller.solvers.riccati.stage_system import (
    StageSparsity,
    StageSystem,
    common_sparsity,
)
from iptm_core.physics.model_numbers import NUMBERS, SplitFunctions, split_off
from iptm_core.physics.ops import named_function

SOLVER_SOURCES = ("riccati.c", "switching.c", "clock.c")
HEADERS = ("riccati.h", "switching.h", "stages.h", "real.h", "clock.h")


@dataclass(frozen=True)
class StageProgram:
    """C source of the stages of a problem.

    Attributes:
        header: content of ``stage_sizes.h``.
        sources: C files.
        functions: written in C; also prepares `TABLE`, which they read, for a model.
    """

    header: str
    sources: tuple[str, ...]
    functions: SplitFunctions


def stage_program(problem: OptimalControlProblem, *, lanes: int = LANES) -> StageProgram:
    """Return the functions of a problem's stages; see `stage_sources` for the lanes.

    With one lane the table is constant data of the caller's, else it comes with each call.
    """
    stages = problem.stage_expressions()
    systems = [StageSystem(stage) for stage in stages]
    sparsity = common_sparsity(systems)
    maps: dict[str, list[StageMap]] = {
        "linearise": [],
        "evaluate": [],
        "least_slacks": [],
        "hamiltonian": [],
        "follow": [],
    }
    for index, (system, stage) in enumerate(zip(systems, stages, strict=True)):
        strides = {
            "x": layout.BLOCK,
            "u": layout.BLOCK,
            "x_next": layout.BLOCK,
            "p": stage.step_parameters.numel(),
            "g": 0,
            "lam": layout.STATES,
            "lam_next": layout.STATES,
            "s": system.inequality_count,
            "z": system.inequality_count,
            "costate": layout.STATES,
            "power": 1,
        }
        for name, function in (
            ("linearise", system.linearise(sparsity, f"linearise_{index}")),
            ("evaluate", system.evaluate(f"evaluate_{index}")),
            ("least_slacks", system.least_soft_slacks(f"least_slacks_{index}")),
            ("hamiltonian", _hamiltonian(stage, f"hamiltonian_{index}")),
            ("follow", system.follow(f"follow_{index}")),
        ):
            one_step = {"x": layout.STATES, "u": 0, "p": 0} if name == "follow" else {}
            maps[name].append(StageMap(function, strides | one_step))
    patterns = sparsity.dynamics, sparsity.inequalities, sparsity.hessian
    singles = _recursion(*(each.serialize() for each in patterns))
    written = [each.function for kinds in maps.values() for each in kinds]
    split = split_off(written)
    by_name = {each.name(): each for each in split.functions}
    maps = {
        name: [StageMap(by_name[each.function.name()], each.strides) for each in kinds]
        for name, kinds in maps.items()
    }
    # The largest functions by themselves, each as long to compile as all the others.
    groups = [[each] for each in maps["linearise"]]
    groups.append([each for name, kinds in maps.items() if name != "linearise" for each in kinds])
    sources = stage_sources(groups, singles, lanes=lanes)
    tables = [
        f"const iptm_stage_map iptm_{name}[] = {{{', '.join(m.function.name() for m in kinds)}}};"
        for name, kinds in maps.items()
    ]
    linearise = [each.function.name() for each in maps["linearise"]]
    tables[:0] = [
        f"void {name}(const iptm_real *const *arg, iptm_real *const *res, int count);"
        for name in linearise
    ]
    header = _header(systems[0].inequality_count, len(stages), sparsity)
    if lanes > 1:
        header += "#define IPTM_NUMBERS_GIVEN\n"
        tables.append(f"const iptm_real *{TABLE};")
    parameters = ", ".join(str(stage.step_parameters.numel()) for stage in stages)
    tables.append(f"const int iptm_kind_parameters[] = {{{parameters}}};")
    return StageProgram(
        header,
        (*sources[:-1], "\n".join([sources[-1], *tables, ""])),
        split,
    )


@lru_cache(maxsize=8)
def _recursion(*patterns: str) -> tuple[ca.Function, ca.Function]:
    sparsity = StageSparsity(*map(ca.Sparsity.deserialize, patterns))
    return backward_step(sparsity), forward_step(sparsity)


def _hamiltonian(stage: StageExpressions, name: str) -> ca.Function:
    """Return a function of ``x, u, p, g, numbers, costate, power``; the power replaces the one of u."""
    costate = ca.SX.sym("costate", layout.STATES)
    power = ca.SX.sym("power")
    inputs = [*ca.vertsplit(stage.inputs)]
    inputs[InputIndex.COMPRESSOR_POWER] = power
    symbols = [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters]
    symbols.append(stage.model.numbers)
    value = stage.cost + ca.dot(costate, stage.next_state)
    function = ca.Function(f"{name}_of_inputs", [*symbols, costate], [value], {"cse": True})
    symbols[1] = ca.vertcat(*inputs)
    return named_function(
        name,
        {
            "x": stage.state,
            "u": stage.inputs,
            "p": stage.step_parameters,
            "g": stage.global_parameters,
            NUMBERS: stage.model.numbers,
            "costate": costate,
            "power": power,
        },
        {"hamiltonian": function(*symbols, costate)},
    )


def _header(inequalities: int, kinds: int, sparsity: StageSparsity) -> str:
    sizes = {
        "INEQUALITIES": inequalities,
        "KINDS": kinds,
        "DYNAMICS_NONZEROS": sparsity.dynamics.nnz(),
        "HESSIAN_NONZEROS": sparsity.hessian.nnz(),
        "INEQUALITY_NONZEROS": sparsity.inequalities.nnz(),
        "TEMPERATURE_OFFSET_K": float(layout.STATE_OFFSET[StateIndex.CELL_1_TEMPERATURE]),
    }
    defines = "".join(f"#define IPTM_{name} {value}\n" for name, value in sizes.items())
    return f'#include "layout.h"\n{defines}'
