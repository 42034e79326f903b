"""C code for the functions of a stage, mapped over any number of steps.

CasADi writes a function of one stage as scalar statements. Here each becomes a C function that evaluates
it for ``count`` steps at given places of flat arrays, four steps at a time in vector registers (see
`compilation`). The number of steps is an argument, so horizons of the same stage kinds share their code.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from iptm_controller.ocp.compilation import LANES, PREAMBLE, STRAIGHT_LINE, in_lanes
from iptm_core.compiler import split_numbers

_WRAPPER = re.compile(
    r"CASADI_SYMBOL_EXPORT int (\w+)\(const casadi_real\*\* arg[^{]*\{\s*return (casadi_f\d+)\("
)
_DESCRIPTION = re.compile(
    r"^static const casadi_int casadi_s\d+\[\d+\] =[^;]*;\n"
    r"|^CASADI_SYMBOL_EXPORT [^{;]*\{[^}]*\}\n"
    r"|^#define casadi_[sf]\d+ .*\n",
    re.MULTILINE,
)
_MAXIMUM = re.compile(
    r"^#define casadi_fmax [^\n]*\n|^casadi_real casadi_fmax\(.*?^\}\n", re.MULTILINE | re.DOTALL
)
_HELPER = re.compile(
    r"^casadi_real (casadi_\w+)\([^)]*\) \{(?:.*\}\n|\n(?:.*\n)*?\}\n)", re.MULTILINE
)
_READ = re.compile(r"arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0")
_WRITE = re.compile(r"if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=")

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

_SCALAR_MAXIMUM = """
static iptm_real iptm_fmax(iptm_real x, iptm_real y) {
  if (x > y) return x;
  return x < y ? y : fmax(x, y);
}
"""


@dataclass(frozen=True)
class _Shape:
    """Name of a map in C, and the sizes and strides of what it reads and writes."""

    name: str
    sizes: tuple[int, ...]
    strides: tuple[int, ...]
    result_sizes: tuple[int, ...]


@dataclass(frozen=True)
class StageMap:
    """A function of one stage that is evaluated for many steps.

    Attributes:
        strides: from a step to the next one, by argument; results are packed.
    """

    function: ca.Function
    strides: Mapping[str, int]

    @property
    def shape(self) -> _Shape:
        """Its shape."""
        f = self.function
        return _Shape(
            f.name(),
            tuple(f.nnz_in(index) for index in range(f.n_in())),
            tuple(self.strides[f.name_in(index)] for index in range(f.n_in())),
            tuple(f.nnz_out(index) for index in range(f.n_out())),
        )


def stage_sources(
    maps: Sequence[Sequence[StageMap]], singles: Sequence[ca.Function], *, lanes: int = LANES
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Return C code of maps, ``name(arg, res, count)``, and of single functions, ``name(arg, res)``.

    Args:
        maps: one file for each group of them, so that they can be compiled at the same time; the single
            functions are in the last one.
        lanes: steps that are evaluated at once; 1 gives plain C99.

    Returns:
        The files, and the table of their numbers, see `split_numbers`; plain C99 has them as literals.
    """
    generator = ca.CodeGenerator("stages.c", {"with_header": False})
    for function in (*(each.function for group in maps for each in group), *singles):
        generator.add(function)
    source: str = generator.dump()
    numbers: tuple[float, ...] = ()
    if lanes > 1:
        source, numbers = split_numbers(source)
    shapes = tuple(tuple(each.shape for each in group) for group in maps)
    return _files(source, shapes, tuple(each.name() for each in singles), lanes), numbers


@lru_cache(maxsize=8)  # other numbers have the same code
def _files(
    source: str, maps: tuple[tuple[_Shape, ...], ...], singles: tuple[str, ...], lanes: int
) -> tuple[str, ...]:
    every = [each for group in maps for each in group]
    bodies = {found["name"]: found for found in STRAIGHT_LINE.finditer(source)}
    by_name = {name: bodies[body] for name, body in _WRAPPER.findall(source)}
    helpers = source[: min(found.start() for found in bodies.values())]
    # The comment that describes the first function stays behind, and what describes arguments to CasADi.
    helpers = _DESCRIPTION.sub("", helpers[: helpers.rindex("/*")])
    helpers = _MAXIMUM.sub("", helpers)
    most_arguments = max(len(each.sizes) for each in every)
    most_results = max(len(each.result_sizes) for each in every)
    preamble = (
        (PREAMBLE if lanes > 1 else "")
        + '#include <stddef.h>\n#include <string.h>\n#include "stages.h"\n#define casadi_real iptm_real\n'
        + f"{_SCALAR_MAXIMUM}{helpers}\n#define LANES {lanes}\n"
        + f"#define MOST_ARGUMENTS {most_arguments}\n#define MOST_RESULTS {most_results}\n{_MAP}"
    )
    files = [
        [preamble, *(_mapped(by_name[each.name], each, lanes) for each in group)] for group in maps
    ]
    for name in singles:
        head = f"void {name}(const iptm_real *const *arg, iptm_real *const *res)"
        files[-1].append(f"{head};\n{head} {{\n{_scalar_body(by_name[name])}}}\n")
    return tuple(_with_used_helpers("\n".join(parts)) for parts in files)


def _with_used_helpers(text: str) -> str:
    """Return a file whose helpers are its own, and are there if they are called."""

    def kept(found: re.Match[str]) -> str:
        return f"static {found[0]}" if text.count(f"{found[1]}(") > 1 else ""

    return _HELPER.sub(kept, text)


def _scalar_body(body: re.Match[str]) -> str:
    text = body["variables"] + body["statements"]
    reads = sorted({int(index) for index, _ in _READ.findall(text)})
    writes = sorted({int(index) for index, _ in _WRITE.findall(text)})
    pointers = [f"  const iptm_real *const arg_{index} = arg[{index}];\n" for index in reads]
    pointers += [f"  iptm_real *const res_{index} = res[{index}];\n" for index in writes]
    text = _READ.sub(r"arg_\1[\2]", text)
    text = _WRITE.sub(r"res_\1[\2]=", text)
    return "".join(pointers) + text.replace("casadi_fmax(", "iptm_fmax(")


def _mapped(body: re.Match[str], each: _Shape, lanes: int) -> str:
    name, sizes, strides, result_sizes = each.name, each.sizes, each.strides, each.result_sizes
    group = f"static void {name}_group(const iptm_real *const *arg, iptm_real *const *res) {{\n"
    if lanes == 1:
        group += _scalar_body(body)
    else:
        by_pointer = {f"arg_{index}": stride for index, stride in enumerate(strides)}
        by_pointer |= {f"res_{index}": size for index, size in enumerate(result_sizes)}
        lines = [
            f"  const iptm_real *const arg_{index} = arg[{index}];" for index in range(len(sizes))
        ]
        lines += [
            f"  iptm_real *const res_{index} = res[{index}];" for index in range(len(result_sizes))
        ]
        lines += [line.replace("casadi_real", "lanes") for line in body["variables"].splitlines()]
        points = range(lanes)
        lines += [in_lanes(line, by_pointer, points) for line in body["statements"].splitlines()]
        group += "\n".join(lines) + "\n"
    scratch = sum(stride * (lanes - 1) + size for stride, size in zip(strides, sizes, strict=True))
    scratch += sum(size * lanes for size in result_sizes)
    head = f"void {name}(const iptm_real *const *arg, iptm_real *const *res, int count)"
    return (
        f"{group}}}\n{head};\n{head} {{\n"
        f"  static const int sizes[] = {_braced(sizes)}, strides[] = {_braced(strides)};\n"
        f"  static const int result_sizes[] = {_braced(result_sizes)};\n"
        f"  static const iptm_places places = {{{len(sizes)}, {len(result_sizes)}, sizes, strides, "
        "result_sizes};\n"
        f"  iptm_real scratch[{scratch}];\n"
        f"  iptm_map({name}_group, &places, arg, res, count, scratch);\n}}\n"
    )


def _braced(numbers: Sequence[int]) -> str:
    return "{" + ", ".join(map(str, numbers)) + "}"
