"""Writes the page of results from the numbers of the benchmarks; nothing in it is typed by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.compare_solvers import ContenderSummary, table
from benchmarks.plots import plot_comparison, plot_scaling
from benchmarks.report_files import read_numbers
from benchmarks.targets import Target, targets

NOTICE = "<!-- Made by scripts/benchmark; do not edit. -->"
INTRODUCTION = """\
Times are processor times (all threads of the solving process), which equal wall times on a quiet
machine; where the wall clock is meant, it is said. Ratios compare contenders within one run, in turn,
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
    found = {path.stem: read_numbers(path) for path in sorted(numbers.glob("*.json"))}
    pictures = page.with_suffix("")
    pictures.mkdir(parents=True, exist_ok=True)
    reached = targets(found)
    parts = ["# Solver benchmarks", NOTICE, _targets(reached), INTRODUCTION]
    parts += _machine(found.get("machine"))
    parts += _comparisons(found.get("comparisons"), pictures)
    parts += _scaling(found.get("scaling"), pictures)
    parts += _loops(found.get("loops"))
    parts += _equivalence(found.get("equivalence"))
    parts += _ros(found.get("ros"))
    parts += _start_up(found.get("start_up"))
    parts += _deadline(found.get("deadline"))
    page.write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")
    return reached


def _targets(reached: Sequence[Target]) -> str:
    lines = ["| target | measured | met |", "|---|---|---|"]
    lines += [f"| {t.text} | {t.measured} | {t.verdict} |" for t in reached]
    return "\n".join(lines)


def _machine(description: dict[str, str] | None) -> list[str]:
    if description is None:
        return []
    lines = ["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in description.items())]
    return ["## Machine", "\n".join(lines)]


def _comparisons(comparisons: dict[str, Any] | None, pictures: Path) -> list[str]:
    if not comparisons:
        return []
    parts = ["## Solvers by grid"]
    for title, rows in comparisons.items():
        parts += [f"### {title}", table([ContenderSummary(**row) for row in rows])]
    plot_comparison(comparisons, pictures / "solvers.png")
    parts.append(f"![times of all contenders]({pictures.name}/solvers.png)")
    return parts


def _scaling(scaling: dict[str, Any] | None, pictures: Path) -> list[str]:
    if not scaling:
        return []
    lines = [
        "| solver | nodes | median ms | max ms | iterations | ms per iteration | not converged |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| `{row['solver']}` | {row['nodes']} | {row['median_ms']:.2f} | {row['max_ms']:.2f} "
        f"| {row['iterations']:.0f} | {row['ms_per_iteration']:.3f} "
        f"| {row['unconverged']} of {row['problems']} |"
        for row in scaling["rows"]
    ]
    said = [
        f"`{name}`: {fit['offset_ms']:.3f} ms + {fit['per_node_us']:.2f} µs per node and iteration "
        f"(largest relative residual {100 * fit['largest_relative_residual']:.0f} %); "
        f"from 60 nodes on the time per iteration grows as nodes^{fit['exponent']:.2f}."
        for name, fit in scaling["fits"].items()
        if math.isfinite(fit["per_node_us"])
    ]
    plot_scaling(scaling, pictures / "nodes.png")
    return [
        "## Cost over the number of nodes",
        "\n".join(lines),
        "\n".join(f"- {line}" for line in said),
        f"![cost over nodes]({pictures.name}/nodes.png)",
    ]


def _loops(loops: Sequence[dict[str, Any]] | None) -> list[str]:
    if not loops:
        return []
    lines = [
        (
            "| trip | strategy, grid | ticks | wall s | processor s "
            "| share of solver / data / plant / bridge / rest "
            "| solve median / p99 / max ms | on the wall ms | iterations median / p99 / max "
            "| not converged | fallback ticks |"
        ),
        "|---|---|" + "---:|" * 9,
    ]
    for run in loops:
        share = " / ".join(f"{100 * value:.0f} %" for value in run["processor_share"].values())
        solve, wall, iterations = run["solve_ms"], run["solve_wall_ms"], run["iterations"]
        bad = run["ticks"] - run["statuses"].get("solved", 0)
        lines.append(
            f"| {run['cycle']} | {run['strategy']}, {run['horizon']} | {run['ticks']} | {run['wall_s']:.1f} "
            f"| {run['processor_s']:.1f} | {share} "
            f"| {solve['median']:.2f} / {solve['p99']:.2f} / {solve['max']:.2f} "
            f"| {wall['median']:.2f} / {wall['p99']:.2f} / {wall['max']:.2f} "
            f"| {iterations['median']:.0f} / {iterations['p99']:.0f} / {iterations['max']:.0f} "
            f"| {bad} | {run['fallback_ticks']} |"
        )
    explained = [
        f"- {run['cycle']}, {run['horizon']}, tick {bad['tick']}: {bad['status']} "
        f"after {bad['iterations']} iterations"
        for run in loops
        for bad in run["unconverged"]
    ]
    note = "Solves include the second start that tries the compressor."
    return ["## Headless closed loop", "\n".join(lines), note, "\n".join(explained)]


def _equivalence(runs: Sequence[dict[str, Any]] | None) -> list[str]:
    if not runs:
        return []
    parts = ["## Same trip with the reference solver (IPOPT, 1e-8)"]
    for run in runs:
        lines = ["| | default | reference | change |", "|---|---:|---:|---:|"]
        for row in run["rows"]:
            change = row["relative_change"]
            said = "" if change is None else f"{100 * change:+.4f} %"
            lines.append(
                f"| {row['label']}, {row['unit']} | {row['default']:.6g} | {row['reference']:.6g} "
                f"| {said} |"
            )
        parts += [
            (
                f"{run['cycle']}, {run['strategy']}, {run['horizon']}, {run['ticks']} ticks; largest "
                f"difference of speed {run['largest_speed_difference_m_s']:.1e} m/s; not converged: "
                f"{run['unconverged']['default']} and {run['unconverged']['reference']}."
            ),
            "\n".join(lines),
        ]
    return parts


def _ros(runs: Sequence[dict[str, Any]] | None) -> list[str]:
    if not runs:
        return []
    lines = [
        (
            "| scenario | recorded | trip s | wall s | times real time | solve median / p99 / max ms (wall) "
            "| solves by status | good |"
        ),
        "|---|---|---:|---:|---:|---:|---|---|",
    ]
    for run in runs:
        solve = run["solve_time_ms"]
        lines.append(
            f"| {run['scenario']} | {'yes' if run['recorded'] else 'no'} | {run['trip_s']:.0f} "
            f"| {run['wall_s']:.1f} | {run['speed_up']:.0f} "
            f"| {solve['median']:.2f} / {solve['p99']:.2f} / {solve['largest']:.2f} "
            f"| {_counts(run['statuses'])} | {'yes' if run['good'] else 'no'} |"
        )
    return ["## Closed loop over ROS 2 (lock-step, separate processes)", "\n".join(lines)]


def _start_up(starts: dict[str, Any] | None) -> list[str]:
    if not starts:
        return []
    lines = [
        "| cache | starts | topics matched s | first command s, median | max | peak memory MiB |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {name} | {start['starts']} | {start['ready_median_s']:.2f} "
        f"| {start['first_command_median_s']:.2f} | {start['first_command_max_s']:.2f} "
        f"| {start['peak_memory_mib']:.0f} |"
        for name, start in starts.items()
        if start
    ]
    return ["## Start of the controller process (wall clock)", "\n".join(lines)]


def _deadline(deadline: dict[str, Any] | None) -> list[str]:
    if not deadline:
        return []
    lines = [
        (
            "| busy processes | ticks | period ms | deadline ms | overruns "
            "| answer median / p99 / max ms | solve median / p99 / max ms | solves by status "
            "| fallback ticks |"
        ),
        "|---:|---:|---:|---:|---:|---:|---:|---|---:|",
    ]
    for run in deadline["headless"]:
        answer, solve = run["answer_ms"], run["solve_ms"]
        lines.append(
            f"| {run['busy_processes']} | {run['ticks']} | {run['period_ms']:.0f} "
            f"| {run['deadline_ms']:.0f} | {run['overruns']} "
            f"| {answer['median']:.1f} / {answer['p99']:.1f} / {answer['max']:.1f} "
            f"| {solve['median']:.1f} / {solve['p99']:.1f} / {solve['max']:.1f} "
            f"| {_counts(run['statuses'])} | {run['fallback_ticks']} |"
        )
    parts = ["## Real time with other load (wall clock)", "\n".join(lines)]
    ros = deadline.get("ros")
    if ros:
        solve = ros["solve_ms"]
        parts.append(
            f"Over ROS 2, scenario `real_time` at {ros['rate_factor']:g} times real time with "
            f"{ros['busy_processes']} busy processes: {ros['decisions']} decisions in "
            f"{ros['trip_s']:.0f} s of trip, rungs {_counts(ros['rungs'])}, solves "
            f"{_counts(ros['statuses'])}, {solve['median']:.1f} / {solve['p99']:.1f} / "
            f"{solve['largest']:.1f} ms, complaints of the nodes: "
            f"{'; '.join([*ros['problems'], *ros['warnings']]) or 'none'}."
        )
    return parts


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())
