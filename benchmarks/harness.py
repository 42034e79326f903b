"""What all benchmarks share: clocks, a closed loop, the command line, numbers and tables, the machine."""

from __future__ import annotations

import argparse
import inspect
import json
import os
import platform
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import casadi as ca
import numpy as np

from iptm_controller.controller import Controller
from iptm_controller.horizon import MULTI_HORIZON, SINGLE_HORIZON, Horizon
from iptm_controller.ocp.compilation import compiler_flags, find_compiler
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_core.decision_record import DecisionSeries, SolveStatus
from iptm_core.errors import IptmError, StoreError
from iptm_core.markdown import markdown_table
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.routes import build_route
from iptm_core.routes.route import Route
from iptm_core.state import FloatArray
from iptm_plant_sim.plant import Plant

T = TypeVar("T")


PROPOSED = str(MULTI_HORIZON)
SINGLE = str(SINGLE_HORIZON)
WITH_THERMAL_PHASE = f"{PROPOSED}+10x30t"


@dataclass(frozen=True)
class Elapsed:
    """Time of one call: wall time is what a vehicle feels, processor time can be compared on a busy machine.

    Attributes:
        wall_s: on the wall, other programs of the machine included.
        processor_s: on the processor by all threads of this process; equals the wall time of a
            single-threaded call on a quiet machine.
    """

    wall_s: float
    processor_s: float


def timed(call: Callable[[], T]) -> tuple[T, Elapsed]:
    """Call and time it on both clocks."""
    wall, processor = time.perf_counter(), time.process_time()
    result = call()
    return result, Elapsed(time.perf_counter() - wall, time.process_time() - processor)


def closed_loop(
    cycle: str,
    horizon: str = PROPOSED,
    strategy: str = DEFAULT_STRATEGY,
    solver: SolverOptions = SolverOptions(),  # noqa: B008 - frozen
    duration_s: float | None = None,
    parameter_set: str = DEFAULT_SET,
) -> tuple[Route, Plant, Controller]:
    """Return what `run_closed_loop` drives.

    Args:
        cycle: driving cycle of ``build_route``.
        horizon: grid such as ``3x1+5x5``.
        strategy: name of the strategy.
        solver: back end and its options.
        duration_s: where the trip is cut, s; None for all of it.
        parameter_set: of vehicle and controller.

    Raises:
        IptmError: a name is unknown or the set-up fails.
    """
    parameters = load_parameters(parameter_set).values
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    options = ControllerOptions(
        strategy=strategy_by_name(strategy), horizon=Horizon.parse(horizon), solver=solver
    )
    plant = Plant(parameters, route.slope.slope_at)
    return route, plant, Controller(parameters, options)


def statuses(decisions: DecisionSeries) -> dict[str, int]:
    """Count the solves of a run by their outcome."""
    return dict(Counter(SolveStatus(int(code)).name.lower() for code in decisions.status))


def quantiles(values: FloatArray) -> dict[str, float]:
    """Return median, 99th percentile and largest value; nothing of no values."""
    if values.size == 0:
        return {}
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "max": float(values.max()),
    }


def write_numbers(path: Path, numbers: Any) -> None:
    """Write what a benchmark measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")


def formatted_table(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    """Return a table in Markdown.

    Args:
        rows: values by name.
        columns: format of the cells by heading (see `markdown_table`), such as ``{solve_ms[median]:.2f}``.
    """
    cells = columns.values()
    return markdown_table(columns, ([cell.format_map(row) for cell in cells] for row in rows))


def put(page: str, name: str, text: str) -> str:
    """Return a page with a text between its two marks.

    Raises:
        StoreError: the page lacks the marks.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    if begin not in page or end not in page:
        raise StoreError(f"the page has no marks {begin.strip()} and {end}; allowed: both of them")
    head, rest = page.split(begin, 1)
    return f"{head}{begin}\n{text.strip()}\n\n{end}{rest.split(end, 1)[1]}"


def run_benchmark(
    measure: Callable[..., Any],
    arguments: Sequence[str] | None = None,
    text_of: Callable[[Any], str] = lambda numbers: json.dumps(numbers, indent=1),
) -> int:
    """Measure by the command line, print the numbers and write them if asked to.

    Args:
        measure: its parameters become the options and its docstring their help; one without a default
            becomes a positional argument, a tuple may be repeated.
        arguments: command line, None for that of the process.
        text_of: what is printed of the numbers.

    Returns:
        The exit code.
    """
    name = Path(inspect.getfile(measure)).stem
    parser = argparse.ArgumentParser(prog=name, description=inspect.getmodule(measure).__doc__)
    texts = dict(re.findall(r"^ +(\w+): (.+)\.$", measure.__doc__ or "", re.MULTILINE))
    options = inspect.signature(measure, eval_str=True).parameters
    for option, parameter in options.items():
        kind = (get_args(parameter.annotation) or (parameter.annotation,))[0]
        repeated = get_origin(parameter.annotation) is tuple
        if parameter.default is parameter.empty:
            many: dict[str, Any] = {"nargs": "+"} if repeated else {}
            parser.add_argument(option, type=kind, help=texts[option], **many)
            continue
        usual = ", ".join(parameter.default) if repeated else parameter.default
        parser.add_argument(
            f"--{option.replace('_', '-')}",
            type=kind,
            action="append" if repeated else "store",
            help=f"{texts[option]} ({usual})",
        )
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = vars(parser.parse_args(arguments))
    path = given.pop("json")
    try:
        numbers = measure(**{key: value for key, value in given.items() if value is not None})
    except IptmError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    print(text_of(numbers))
    if path is not None:
        write_numbers(path, numbers)
    return 0


def machine_description() -> dict[str, str]:
    """Return processor, memory, load and versions in readable pairs, without the name of the machine."""
    load = os.getloadavg()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        "processor": _value_of(Path("/proc/cpuinfo"), "model name")
        or platform.processor()
        or "unknown",
        "cores": str(os.cpu_count()),
        "memory": f"{memory / 2**30:.0f} GiB",
        "load average at the time (1, 5, 15 min)": ", ".join(f"{value:.1f}" for value in load),
        "system": f"{platform.system()} {platform.machine()}",
        "compiler": f"{_compiler_version()}, {' '.join(compiler_flags())}",
        "Python": platform.python_version(),
        "CasADi": ca.CasadiMeta.version(),
        "NumPy": np.__version__,
    }


def peak_memory_mib(process_id: int) -> float:
    """Return the largest resident memory that a process has had, MiB; NaN if it is not known."""
    value = _value_of(Path(f"/proc/{process_id}/status"), "VmHWM")
    return float(value.split()[0]) / 1024.0 if value else float("nan")


def resident_memory_mib(process_id: int) -> float:
    """Return the resident memory of a process now, MiB; NaN if it is not known."""
    value = _value_of(Path(f"/proc/{process_id}/status"), "VmRSS")
    return float(value.split()[0]) / 1024.0 if value else float("nan")


def _value_of(path: Path, key: str) -> str:
    """Return the first value of a key in a file of the kernel, empty if there is none."""
    try:
        text = path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
    found = re.search(rf"^{key}\s*:\s*(.*)$", text, re.MULTILINE)
    return found[1].strip() if found else ""


def _compiler_version() -> str:
    compiler = find_compiler()
    if compiler is None:
        return "none"
    done = subprocess.run(  # noqa: S603 - the compiler found on the user's own path
        [*compiler, "--version"], capture_output=True, text=True, timeout=30, check=False
    )
    numbers = re.findall(r"\d+(?:\.\d+)+", done.stdout.partition("\n")[0])
    return " ".join([Path(compiler[0]).name, *numbers[-1:]])
