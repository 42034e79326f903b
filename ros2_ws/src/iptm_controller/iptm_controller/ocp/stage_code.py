"""C code for the functions of a stage, mapped over any number of steps.

A function of one stage is a list of scalar operations. Here each becomes a C function that evaluates
it for ``count`` steps at given places of flat arrays. The steps are taken in groups of four, one to a lane of
a vector: sums, products and quotients are formed in all lanes at once, everything else is the scalar
expression lane by lane. A lane goes through the operations of the scalar code in their order, so that its
results are the same to the last bit. The number of steps is an argument, so horizons of the same stage kinds
share their code.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from iptm_core.physics.model_numbers import NUMBERS

TABLE = "iptm_numbers"
"""What functions read as `NUMBERS`, see `stages.h`."""
LANES = 4
"""Points of a group: doubles in a register of AVX; for shorter registers the compiler splits a vector."""

_OF_VECTORS = {
    ca.OP_ADD: "{0}+{1}",
    ca.OP_SUB: "{0}-{1}",
    ca.OP_MUL: "{0}*{1}",
    ca.OP_DIV: "{0}/{1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0}*{0}",
    ca.OP_TWICE: "2.*{0}",
    ca.OP_INV: "1./{0}",
    ca.OP_ASSIGN: "{0}",
}
_OF_NUMBERS = {
    ca.OP_CONSTPOW: "pow({0},{1})",
    ca.OP_SIGN: "({0}<0?-1:{0}>0?1:{0})",
    ca.OP_LT: "{0}<{1}",
    ca.OP_LE: "{0}<={1}",
    ca.OP_EQ: "{0}=={1}",
    ca.OP_NE: "{0}!={1}",
    ca.OP_NOT: "!{0}",
    ca.OP_AND: "{0}&&{1}",
    ca.OP_OR: "{0}||{1}",
    ca.OP_IF_ELSE_ZERO: "({0}?{1}:0)",
    **{
        getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}})"
        for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "tanh", "asinh", "fabs", "floor")
    },
    **{
        getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}},{{1}})"
        for name in ("pow", "fmin", "fmod", "atan2", "copysign")
    },
}
"""Operations in C, of vectors and of numbers."""

# NaN and equal numbers are left to libm.
_VECTOR = f"""typedef double lanes __attribute__((vector_size({LANES}*sizeof(double))));
typedef long long lane_mask __attribute__((vector_size({LANES}*sizeof(long long))));
static __attribute__((noinline)) lanes lanes_fmax(lanes x, lanes y) {{
  lane_mask greater = (lane_mask)(x>y), decided = greater|(lane_mask)(x<y);
  if ({"&".join(f"decided[{lane}]" for lane in range(LANES))})
    return (lanes)((greater&(lane_mask)x)|(~greater&(lane_mask)y));
  return (lanes){{{",".join(f"fmax(x[{lane}],y[{lane}])" for lane in range(LANES))}}};
}}
"""
_NUMBER = """
static iptm_real iptm_fmax(iptm_real x, iptm_real y) {
  if (x > y) return x;
  return x < y ? y : fmax(x, y);
}
"""

_MAP = """
typedef struct {
  int arguments, results;
  const int *sizes, *strides, *result_sizes;
} iptm_places;

static void iptm_map(void (*group)(const iptm_real *const *, iptm_real *const *), const iptm_places *places,
                     const iptm_real *const *arg, iptm_real *const *res, int count, iptm_real *scratch) {
  const iptm_real *from[MOST_ARGUMENTS];
  iptm_real *to[MOST_RESULTS], *free = scratch;
  int i, j, step, first;
  if (count >= LANES) {
    for (first = 0; first < count; first += LANES) {
      /* Where the steps do not come out even, the last group overlaps the one before. */
      int start = first + LANES <= count ? first : count - LANES;
      for (i = 0; i < places->arguments; ++i) from[i] = arg[i] + places->strides[i] * start;
      for (i = 0; i < places->results; ++i) to[i] = res[i] + places->result_sizes[i] * start;
      group(from, to);
    }
    return;
  }
  /* Fewer steps than lanes: the last one is evaluated several times. */
  for (i = 0; i < places->arguments; ++i) {
    const int size = places->sizes[i], stride = places->strides[i];
    from[i] = free;
    for (j = 0; j < LANES; ++j) {
      step = j < count ? j : count - 1;
      memcpy(free + stride * j, arg[i] + stride * step, sizeof(iptm_real) * (size_t)size);
    }
    free += stride * (LANES - 1) + size;
  }
  for (i = 0; i < places->results; ++i) {
    to[i] = free;
    free += places->result_sizes[i] * LANES;
  }
  group(from, to);
  for (i = 0; i < places->results; ++i) {
    memcpy(res[i], to[i], sizeof(iptm_real) * (size_t)(places->result_sizes[i] * count));
  }
}
"""


@dataclass(frozen=True)
class StageMap:
    """A function of one stage that is evaluated for many steps.

    Attributes:
        strides: from a step to the next one, by argument; results are packed.
    """

    function: ca.Function
    strides: Mapping[str, int]


def stage_sources(
    maps: Sequence[Sequence[StageMap]], singles: Sequence[ca.Function], *, lanes: int = LANES
) -> tuple[str, ...]:
    """Return C code of maps, ``name(arg, res, count)``, and of single functions, ``name(arg, res)``.

    Args:
        maps: one file for each group of them, so that they can be compiled at the same time; the single
            functions are in the last one. `NUMBERS`, the last argument if a map has it, is read from `TABLE`.
        lanes: steps that are evaluated at once; 1 gives plain C99.
    """
    every = [each.function for group in maps for each in group]
    preamble = (
        '#include <stddef.h>\n#include <string.h>\n#include "stages.h"\n'
        f"{_VECTOR if lanes > 1 else ''}{_NUMBER}#define LANES {lanes}\n"
        f"#define MOST_ARGUMENTS {max(each.n_in() for each in every)}\n"
        f"#define MOST_RESULTS {max(each.n_out() for each in every)}\n{_MAP}"
    )
    files = [[preamble, *(_mapped(each, lanes) for each in group)] for group in maps]
    for function in singles:
        head = f"void {function.name()}(const iptm_real *const *arg, iptm_real *const *res)"
        files[-1].append(f"{head};\n{head} {{\n{_body(function)}}}\n")
    return tuple("\n".join(parts) for parts in files)


def _mapped(each: StageMap, lanes: int) -> str:
    function, name = each.function, each.function.name()
    names = [argument for argument in function.name_in() if argument != NUMBERS]
    sizes = [function.nnz_in(argument) for argument in names]
    strides = [each.strides[argument] for argument in names]
    result_sizes = [function.nnz_out(place) for place in range(function.n_out())]
    scratch = sum(stride * (lanes - 1) + size for stride, size in zip(strides, sizes, strict=True))
    scratch += sum(size * lanes for size in result_sizes)
    head = f"void {name}(const iptm_real *const *arg, iptm_real *const *res, int count)"
    return (
        f"static void {name}_group(const iptm_real *const *arg, iptm_real *const *res) {{\n"
        f"{_body(function, lanes, (*strides, 0), result_sizes)}}}\n{head};\n{head} {{\n"
        f"  static const int sizes[] = {_braced(sizes)}, strides[] = {_braced(strides)};\n"
        f"  static const int result_sizes[] = {_braced(result_sizes)};\n"
        f"  static const iptm_places places = {{{len(sizes)}, {len(result_sizes)}, sizes, strides, "
        "result_sizes};\n"
        f"  iptm_real scratch[{scratch}];\n"
        f"  iptm_map({name}_group, &places, arg, res, count, scratch);\n}}\n"
    )


def _body(
    function: ca.Function, lanes: int = 1, strides: Sequence[int] = (), sizes: Sequence[int] = ()
) -> str:
    """Return the operations of a function, for as many points as there are lanes.

    Args:
        strides: from a point to the next one, by argument.
        sizes: the same, by result.
    """
    read, written, lines = set(), set(), []
    for place in range(function.n_instructions()):
        operation = function.instruction_id(place)
        given, to = function.instruction_input(place), function.instruction_output(place)
        if operation == ca.OP_OUTPUT:
            written.add(to[0])
            lines += [
                f"  res_{to[0]}[{to[1] + (sizes[to[0]] * lane if lane else 0)}]="
                f"a{given[0]}{f'[{lane}]' if lanes > 1 else ''};"
                for lane in range(lanes)
            ]
            continue
        if operation == ca.OP_INPUT:
            read.add(given[0])
            entries = (
                given[1] + (strides[given[0]] * lane if lane else 0) for lane in range(lanes)
            )
            value = _vector([f"arg_{given[0]}[{entry}]" for entry in entries])
        elif operation == ca.OP_CONST:
            value = _vector([_number(function.instruction_constant(place))] * lanes)
        elif operation == ca.OP_FMAX:
            value = f"{'lanes' if lanes > 1 else 'iptm'}_fmax(a{given[0]},a{given[1]})"
        elif operation in _OF_VECTORS:
            value = _OF_VECTORS[operation].format(*(f"a{each}" for each in given))
        else:
            form = _OF_NUMBERS[operation]
            indices = [f"[{lane}]" for lane in range(lanes)] if lanes > 1 else [""]
            value = _vector([form.format(*(f"a{v}{index}" for v in given)) for index in indices])
        lines.append(f"  a{to[0]}={value};")
    pointers = [
        f"  const iptm_real *const arg_{index} = {TABLE if name == NUMBERS else f'arg[{index}]'};"
        for index, name in enumerate(function.name_in())
        if index in read
    ]
    pointers += [f"  iptm_real *const res_{index} = res[{index}];" for index in sorted(written)]
    variables = ", ".join(f"a{index}" for index in range(function.sz_w()))
    kind = "lanes" if lanes > 1 else "iptm_real"
    return "\n".join([*pointers, f"  {kind} {variables};", *lines, ""])


def _vector(values: Sequence[str]) -> str:
    return values[0] if len(values) == 1 else f"(lanes){_braced(values)}"


def _number(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    return repr(value) if math.isfinite(value) else f"{'-' if value < 0.0 else ''}INFINITY"


def _braced(values: Sequence[object]) -> str:
    return "{" + ",".join(map(str, values)) + "}"
