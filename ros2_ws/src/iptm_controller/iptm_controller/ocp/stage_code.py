"""C code for the functions of a stage, mapped over any number of steps.

CasADi writes a function of one stage as scalar statements. Here each becomes a C function that evaluates
it for ``count`` steps at given places of flat arrays. The steps are taken in groups of four, one to a lane of
a vector: sums, products and quotients are formed in all lanes at once, everything else is the scalar
expression lane by lane. A lane goes through the operations of the scalar code in their order, so that its
results are the same to the last bit. The number of steps is an argument, so horizons of the same stage kinds
share their code.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from iptm_core.compiler import split_numbers

NUMBERS = "iptm_numbers"
"""Array in the code, see `stages.h`."""
LANES = 4
"""Points of a group: doubles in a register of AVX; for shorter registers the compiler splits a vector."""

_SIGNATURE = (
    r"static int (?P<name>casadi_f\d+)\(const casadi_real\*\* arg, casadi_real\*\* res, "
    r"casadi_int\* iw, casadi_real\* w, int mem\) \{\n"
)
_STRAIGHT_LINE = re.compile(
    _SIGNATURE + r"(?P<variables>(?:  casadi_real a\d+(?:, a\d+)*;\n)+)"
    r"(?P<statements>(?:  (?:a\d+=|if \(res\[\d+\]!=0\) res\[\d+\]\[\d+\]=a).*;\n)+)"
    r"  return 0;\n\}\n"
)
_RESULT = re.compile(r"  if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=(a\d+);")
_ARGUMENT = re.compile(r"  (a\d+)=arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0;")
_SQUARE = re.compile(r"casadi_sq\((a\d+)\)")
_ALL_LANES = re.compile(r"  a\d+=\((?:a\d+[-+*/]|-|2\.\*|1\./)a\d+\);")
_LARGER = re.compile(r"casadi_fmax\((a\d+),(a\d+)\)")
_VARIABLE = re.compile(r"\ba\d+\b")

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

# NaN and equal numbers are left to libm.
_PREAMBLE = f"""#include <math.h>
typedef double lanes __attribute__((vector_size({LANES}*sizeof(double))));
typedef long long lane_mask __attribute__((vector_size({LANES}*sizeof(long long))));
static __attribute__((noinline)) lanes lanes_fmax(lanes x, lanes y) {{
  lane_mask greater = (lane_mask)(x>y), decided = greater|(lane_mask)(x<y);
  if ({"&".join(f"decided[{lane}]" for lane in range(LANES))})
    return (lanes)((greater&(lane_mask)x)|(~greater&(lane_mask)y));
  return (lanes){{{",".join(f"fmax(x[{lane}],y[{lane}])" for lane in range(LANES))}}};
}}

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
        The files, and their numbers, see `split_numbers`; plain C99 has them as literals.
    """
    generator = ca.CodeGenerator("stages.c", {"with_header": False})
    for function in (*(each.function for group in maps for each in group), *singles):
        generator.add(function)
    source: str = generator.dump()
    numbers: tuple[float, ...] = ()
    if lanes > 1:
        source, numbers = split_numbers(source, NUMBERS)
    shapes = tuple(tuple(each.shape for each in group) for group in maps)
    return _files(source, shapes, tuple(each.name() for each in singles), lanes), numbers


@lru_cache(maxsize=8)  # other numbers have the same code
def _files(
    source: str, maps: tuple[tuple[_Shape, ...], ...], singles: tuple[str, ...], lanes: int
) -> tuple[str, ...]:
    every = [each for group in maps for each in group]
    bodies = {found["name"]: found for found in _STRAIGHT_LINE.finditer(source)}
    by_name = {name: bodies[body] for name, body in _WRAPPER.findall(source)}
    helpers = source[: min(found.start() for found in bodies.values())]
    # The comment that describes the first function stays behind, and what describes arguments to CasADi.
    helpers = _DESCRIPTION.sub("", helpers[: helpers.rindex("/*")])
    helpers = _MAXIMUM.sub("", helpers)
    most_arguments = max(len(each.sizes) for each in every)
    most_results = max(len(each.result_sizes) for each in every)
    preamble = (
        (_PREAMBLE if lanes > 1 else "")
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
        lines += [_in_lanes(line, by_pointer, points) for line in body["statements"].splitlines()]
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


def _in_lanes(line: str, strides: dict[str, int], points: Sequence[int]) -> str:
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
    rewritten = _LARGER.sub(r"lanes_fmax(\1,\2)", _SQUARE.sub(r"(\1*\1)", line))
    if rewritten != line:
        return rewritten
    variable, _, expression = line.rstrip(";").partition("=")
    scalars = (_VARIABLE.sub(rf"\g<0>[{lane}]", expression) for lane in range(LANES))
    return f"{variable}=(lanes){{{','.join(scalars)}}};"
