"""Writes the page of results from the numbers of the benchmarks; nothing in it is typed by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.compare_solvers import comparison_table
from benchmarks.harness import formatted_table
from benchmarks.plots import plot_comparison, plot_scaling
from benchmarks.targets import Target, targets

NOTICE = "<!-- Made by scripts/benchmark; do not edit. -->"
INTRODUCTION = """\
Times are processor times (all threads of the solving process), which equal wall times on a quiet
machine; wall times are marked as such. Ratios compare contenders within one run, in turn,
a few ticks at a time. Solvers are judged on the very same recorded problems, from the same shifted
guess; SQP also carries its multipliers along. The KKT residual is an independent evaluation of the
solution with CasADi's virtual machine and the best multipliers there are (a linear program), not the
solver's word. `peer_plain` is the same problem written in CasADi's Opti and solved by IPOPT with the
same tolerance; `peer_expanded` is the same with expansion into scalar operations switched on;
`riccati_interpreted` is the default solver without compiled code. "Other optimum": cost more than 0.1 %
above the best of all contenders.
"""


def write_page(numbers: Path, page: Path) -> list[Target]:
    """Write the page and its pictures.

    Args:
        numbers: folder with the numbers of the benchmarks that were run.
        page: Markdown file; the pictures go into a folder of the same name beside it.

    Returns:
        The targets with what was measured.
    """
    files = sorted(numbers.glob("*.json"))
    found = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in files}
    pictures = page.with_suffix("")
    pictures.mkdir(parents=True, exist_ok=True)
    reached = targets(found)
    judged = {"target": "{text}", "measured": "{measured}", "met": "{verdict}"}
    rows = [{**vars(target), "verdict": target.verdict} for target in reached]
    parts = ["# Solver benchmarks", NOTICE, formatted_table(rows, judged), INTRODUCTION]
    sections: dict[str, Callable[[Any], list[str]]] = {
        "machine": _machine,
        "comparisons": lambda numbers: _comparisons(numbers, pictures),
        "scaling": lambda numbers: _scaling(numbers, pictures),
        "loops": _loops,
        "equivalence": _equivalence,
        "ros": _ros,
        "start_up": _start_up,
        "deadline": _deadline,
    }
    for name, section in sections.items():
        if found.get(name):
            parts += section(found[name])
    page.write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")
    return reached


def _machine(description: dict[str, str]) -> list[str]:
    lines = ["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in description.items())]
    return ["## Machine", "\n".join(lines)]


def _comparisons(comparisons: dict[str, Any], pictures: Path) -> list[str]:
    parts = ["## Solvers by grid"]
    for title, rows in comparisons.items():
        parts += [f"### {title}", comparison_table(rows)]
    plot_comparison(comparisons, pictures / "solvers.png")
    return [*parts, f"![times of all contenders]({pictures.name}/solvers.png)"]


def _scaling(scaling: dict[str, Any], pictures: Path) -> list[str]:
    columns = {
        "solver": "`{solver}`",
        "nodes:": "{nodes}",
        "median ms:": "{median_ms:.2f}",
        "max ms:": "{max_ms:.2f}",
        "iterations:": "{iterations:.0f}",
        "ms per iteration:": "{ms_per_iteration:.3f}",
        "not converged:": "{unconverged} of {problems}",
    }
    lines = [
        f"- `{name}`: {fit['offset_ms']:.3f} ms + {fit['per_node_us']:.2f} µs per node and iteration "
        f"(largest relative residual {100 * fit['largest_relative_residual']:.0f} %); "
        f"from 60 nodes on the time per iteration grows as nodes^{fit['exponent']:.2f}."
        for name, fit in scaling["fits"].items()
        if math.isfinite(fit["per_node_us"])
    ]
    plot_scaling(scaling, pictures / "nodes.png")
    return [
        "## Cost over the number of nodes",
        formatted_table(scaling["rows"], columns),
        "\n".join(lines),
        f"![cost over nodes]({pictures.name}/nodes.png)",
    ]


def _loops(loops: Sequence[dict[str, Any]]) -> list[str]:
    rows = [
        {
            **run,
            "share": " / ".join(
                f"{100 * value:.0f} %" for value in run["processor_share"].values()
            ),
            "bad": run["ticks"] - run["statuses"].get("solved", 0),
        }
        for run in loops
    ]
    columns = {
        "trip": "{cycle}",
        "strategy, grid": "{strategy}, {horizon}",
        "ticks:": "{ticks}",
        "wall s:": "{wall_s:.1f}",
        "processor s:": "{processor_s:.1f}",
        "share of solver / data / plant / bridge / rest:": "{share}",
        "solve median / p99 / max ms:": _spread("solve_ms", ".2f"),
        "on the wall ms:": _spread("solve_wall_ms", ".2f"),
        "iterations median / p99 / max:": _spread("iterations", ".0f"),
        "not converged:": "{bad}",
        "fallback ticks:": "{fallback_ticks}",
    }
    explained = [
        f"- {run['cycle']}, {run['horizon']}, tick {bad['tick']}: {bad['status']} "
        f"after {bad['iterations']} iterations"
        for run in loops
        for bad in run["unconverged"]
    ]
    note = "Solves include the second start that tries the compressor."
    return [
        "## Headless closed loop",
        formatted_table(rows, columns),
        note,
        *(["\n".join(explained)] if explained else []),
    ]


def _equivalence(runs: Sequence[dict[str, Any]]) -> list[str]:
    columns = {
        "": "{label}, {unit}",
        "default:": "{default:.6g}",
        "reference:": "{reference:.6g}",
        "change:": "{change}",
    }
    parts = ["## Same trip with the reference solver (IPOPT, 1e-8)"]
    for run in runs:
        rows = [
            {**row, "change": "" if change is None else f"{100 * change:+.4f} %"}
            for row in run["rows"]
            for change in [row["relative_change"]]
        ]
        parts += [
            (
                f"{run['cycle']}, {run['strategy']}, {run['horizon']}, {run['ticks']} ticks; largest "
                f"difference of speed {run['largest_speed_difference_m_s']:.1e} m/s; not converged: "
                f"{run['unconverged']['default']} and {run['unconverged']['reference']}."
            ),
            formatted_table(rows, columns),
        ]
    return parts


def _ros(runs: Sequence[dict[str, Any]]) -> list[str]:
    rows = [
        {
            **run,
            "recorded": _yes(run["recorded"]),
            "good": _yes(run["good"]),
            "outcomes": _counts(run["statuses"]),
        }
        for run in runs
    ]
    columns = {
        "scenario": "{scenario}",
        "recorded": "{recorded}",
        "trip s:": "{trip_s:.0f}",
        "wall s:": "{wall_s:.1f}",
        "times real time:": "{speed_up:.0f}",
        "solve median / p99 / max ms (wall):": _spread("solve_time_ms", ".2f", "largest"),
        "solves by status": "{outcomes}",
        "good": "{good}",
    }
    title = "## Closed loop over ROS 2 (lock-step, separate processes)"
    return [title, formatted_table(rows, columns)]


def _start_up(starts: dict[str, Any]) -> list[str]:
    columns = {
        "cache": "{cache}",
        "starts:": "{starts}",
        "topics matched s:": "{ready_median_s:.2f}",
        "first command s, median:": "{first_command_median_s:.2f}",
        "max:": "{first_command_max_s:.2f}",
        "peak memory MiB:": "{peak_memory_mib:.0f}",
    }
    rows = [{"cache": name, **start} for name, start in starts.items() if start]
    return ["## Start of the controller process (wall clock)", formatted_table(rows, columns)]


def _deadline(deadline: dict[str, Any]) -> list[str]:
    rows = [{**run, "outcomes": _counts(run["statuses"])} for run in deadline["headless"]]
    columns = {
        "busy processes:": "{busy_processes}",
        "ticks:": "{ticks}",
        "period ms:": "{period_ms:.0f}",
        "deadline ms:": "{deadline_ms:.0f}",
        "overruns:": "{overruns}",
        "answer median / p99 / max ms:": _spread("answer_ms", ".1f"),
        "solve median / p99 / max ms:": _spread("solve_ms", ".1f"),
        "solves by status": "{outcomes}",
        "fallback ticks:": "{fallback_ticks}",
    }
    parts = ["## Real time with other load (wall clock)", formatted_table(rows, columns)]
    ros = deadline.get("ros")
    if ros:
        parts.append(
            f"Over ROS 2, scenario `real_time` at {ros['rate_factor']:g} times real time with "
            f"{ros['busy_processes']} busy processes: {ros['decisions']} decisions in "
            f"{ros['trip_s']:.0f} s of trip, rungs {_counts(ros['rungs'])}, solves "
            f"{_counts(ros['statuses'])}, {_spread('solve_ms', '.1f', 'largest').format_map(ros)} ms, "
            f"complaints of the nodes: {'; '.join([*ros['problems'], *ros['warnings']]) or 'none'}."
        )
    return parts


def _spread(name: str, form: str, largest: str = "max") -> str:
    """Return the format of a cell with median, 99th percentile and largest value."""
    return " / ".join(f"{{{name}[{key}]:{form}}}" for key in ("median", "p99", largest))


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _yes(value: bool) -> str:  # noqa: FBT001 - the value itself
    return "yes" if value else "no"
