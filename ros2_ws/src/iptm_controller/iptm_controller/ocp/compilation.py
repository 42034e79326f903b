"""Functions of a nonlinear program as machine code; their maps evaluate several points at once.

CasADi writes a function as scalar statements, and its map over the points as a loop of calls. Here the points
are taken in groups, one to a lane of a vector: sums, products and quotients are formed in all lanes at once,
everything else is the scalar expression lane by lane. A lane goes through the operations of the scalar code
in their order, so that its results are the same to the last bit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

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


LANES = 4
"""Points of a group: doubles in a register of AVX; for shorter registers the compiler splits a vector."""

_SIGNATURE = (
    r"static int (?P<name>casadi_f\d+)\(const casadi_real\*\* arg, casadi_real\*\* res, "
    r"casadi_int\* iw, casadi_real\* w, int mem\) \{\n"
)
_MAP = re.compile(
    _SIGNATURE + r"(?:  .*\n)+?"
    r"  for \(i=0; i<(?P<count>\d+); \+\+i\) \{\n"
    r"    if \((?P<function>casadi_f\d+)\(arg1, res1, iw, w, 0\)\) return 1;\n"
    r"(?P<advance>(?:    if \((?:arg|res)1\[\d+\]\) (?:arg|res)1\[\d+\]\+=\d+;\n)+)"
    r"  \}\n  return 0;\n\}\n"
)
_ADVANCE = re.compile(r"(arg|res)1\[(\d+)\]\+=(\d+);")
STRAIGHT_LINE = re.compile(
    _SIGNATURE + r"(?P<variables>(?:  casadi_real a\d+(?:, a\d+)*;\n)+)"
    r"(?P<statements>(?:  (?:a\d+=|if \(res\[\d+\]!=0\) res\[\d+\]\[\d+\]=a).*;\n)+)"
    r"  return 0;\n\}\n"
)
_RESULT = re.compile(r"  if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=(a\d+);")
_ARGUMENT = re.compile(r"  (a\d+)=arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0;")
_SQUARE = re.compile(r"casadi_sq\((a\d+)\)")
_ALL_LANES = re.compile(r"  a\d+=\((?:a\d+[-+*/]|-|2\.\*|1\./)a\d+\);")
_MAXIMUM = re.compile(r"casadi_fmax\((a\d+),(a\d+)\)")
_VARIABLE = re.compile(r"\ba\d+\b")

# NaN and equal numbers are left to libm.
PREAMBLE = f"""#include <math.h>
typedef double lanes __attribute__((vector_size({LANES}*sizeof(double))));
typedef long long lane_mask __attribute__((vector_size({LANES}*sizeof(long long))));
static __attribute__((noinline)) lanes lanes_fmax(lanes x, lanes y) {{
  lane_mask greater = (lane_mask)(x>y), decided = greater|(lane_mask)(x<y);
  if ({"&".join(f"decided[{lane}]" for lane in range(LANES))})
    return (lanes)((greater&(lane_mask)x)|(~greater&(lane_mask)y));
  return (lanes){{{",".join(f"fmax(x[{lane}],y[{lane}])" for lane in range(LANES))}}};
}}

"""


def vectorise_maps(source: str) -> str:
    """Return generated C that computes the same with its maps in vector registers.

    Args:
        source: what ``casadi.CodeGenerator`` writes. Maps of functions that are not straight lines of scalar
            statements stay as they are, and so does everything else.
    """
    bodies = {found["name"]: found for found in STRAIGHT_LINE.finditer(source)}

    def vectorised(found: re.Match[str]) -> str:
        body = bodies.get(found["function"])
        return found[0] if body is None else _vectorised(found, body, int(found["count"]))

    return PREAMBLE + _MAP.sub(vectorised, source)


def _vectorised(found: re.Match[str], body: re.Match[str], count: int) -> str:
    """Return the function of a group, and a map that calls nothing else.

    Where the points do not come out even, the last group overlaps the one before, or repeats the last point.
    """
    head, _, _ = found[0].partition("\n")
    starts = [min(start, max(count - LANES, 0)) for start in range(0, count, LANES)]
    calls = "".join(f"  {found['name']}_group(arg, res, {start});\n" for start in starts)
    return f"{_group(found, body, count)}{head}\n{calls}  return 0;\n}}\n"


def _group(found: re.Match[str], body: re.Match[str], count: int) -> str:
    """Return the function that evaluates the points from ``first`` on."""
    strides = {
        f"{kind}_{slot}": int(stride) for kind, slot, stride in _ADVANCE.findall(found["advance"])
    }
    points = [min(lane, count - 1) for lane in range(LANES)]
    size = LANES * max(strides.values())
    name = f"{found['name']}_group"
    lines = [
        f"static void {name}(const casadi_real** arg, casadi_real** res, casadi_int first) {{",
        f"  static const casadi_real zeros[{size}];",
        f"  casadi_real unused[{size}];",
    ]
    for pointer, stride in strides.items():
        kind, _, slot = pointer.partition("_")
        constant, instead = ("const ", "zeros") if kind == "arg" else ("", "unused")
        lines.append(
            f"  {constant}casadi_real* {pointer}="
            f"{kind}[{slot}] ? {kind}[{slot}]+{stride}*first : {instead};"
        )
    lines += [line.replace("casadi_real", "lanes") for line in body["variables"].splitlines()]
    lines += [in_lanes(line, strides, points) for line in body["statements"].splitlines()]
    return "\n".join(lines) + "\n}\n\n"


def in_lanes(line: str, strides: dict[str, int], points: Sequence[int]) -> str:
    """Return a scalar statement for all lanes."""
    if _ALL_LANES.fullmatch(line):
        return line
    result = _RESULT.fullmatch(line)
    if result is not None:
        pointer, entry, variable = f"res_{result[1]}", int(result[2]), result[3]
        return "  " + " ".join(
            f"{pointer}[{entry + strides[pointer] * point}]={variable}[{lane}];"
            for lane, point in enumerate(points)
        )
    argument = _ARGUMENT.fullmatch(line)
    if argument is not None:
        pointer, entry = f"arg_{argument[2]}", int(argument[3])
        loads = (f"{pointer}[{entry + strides[pointer] * point}]" for point in points)
        return f"  {argument[1]}=(lanes){{{','.join(loads)}}};"
    rewritten = _MAXIMUM.sub(r"lanes_fmax(\1,\2)", _SQUARE.sub(r"(\1*\1)", line))
    if rewritten != line:
        return rewritten
    variable, _, expression = line.rstrip(";").partition("=")
    scalars = (_VARIABLE.sub(rf"\g<0>[{lane}]", expression) for lane in range(LANES))
    return f"{variable}=(lanes){{{','.join(scalars)}}};"
