"""Functions of a nonlinear program as machine code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from iptm_controller.ocp.vectorised_map import vectorise_maps
from iptm_core.compilation import compile_sources, find_compiler
from iptm_core.errors import SolverSetupError


def as_machine_code(
    functions: Sequence[ca.Function], solver: str, *, is_wanted: bool
) -> tuple[list[ca.Function], bool]:
    """Return functions, and whether they are machine code: where that is wanted and a compiler is found."""
    compiler = find_compiler() if is_wanted else None
    if compiler is None:
        return list(functions), False
    library = str(compile_functions(functions, compiler))
    try:
        return [ca.external(function.name(), library) for function in functions], True
    except RuntimeError as error:
        last = str(error).strip().splitlines()[-1]
        raise SolverSetupError(f"solver '{solver}' cannot be set up: {last}") from error


def compile_functions(functions: Sequence[ca.Function], compiler: Sequence[str]) -> Path:
    """Compile functions into one shared library, or find it in the cache; see `compile_sources`."""
    return compile_sources([_generate_source(functions)], {}, compiler)


def _generate_source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("ocp.c", {"with_header": False})
    for function in functions:
        generator.add(function)
    return vectorise_maps(generator.dump())
