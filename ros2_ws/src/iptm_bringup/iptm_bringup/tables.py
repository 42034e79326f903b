"""The results of a run as tables on a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from iptm_bringup.results import Quantiles, RunResults, SolverStatistics
from iptm_core.metrics import ConstraintCheck, RunMetrics, metric_rows

PAPER_ROWS = 7
"""Rows of the paper's results table; `metric_rows` puts them first."""
TABLES_WIDTH = 124
"""Columns that both tables need side by side."""


def print_results(results: RunResults, output: Path, console: Console) -> None:
    """Print everything about a run: figures, solver, limits, and the verdict.

    Args:
        results: of the run.
        output: folder of the run.
        console: where to print.
    """
    console.print()
    tables = (figures_table(results), details_table(results))
    if console.width >= TABLES_WIDTH:
        console.print(_side_by_side(*tables))
    else:
        console.print(*tables)
    console.print(limits_table(results.metrics))
    for warning in results.warnings:
        console.print(Text.assemble(("note  ", "yellow"), warning), soft_wrap=True)
    console.print(_verdict(results))
    console.print(Text(str(output), "dim"), soft_wrap=True)


def figures_table(results: RunResults) -> Table:
    """Return the figures of the run, the paper's rows first."""
    table = Table(title=f"{results.scenario.name}: results", title_justify="left")
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for index, row in enumerate(metric_rows(results.metrics)):
        if index == PAPER_ROWS:
            table.add_section()
        table.add_row(row.label, "-" if row.value is None else _number(row.value), row.unit)
    return table


def details_table(results: RunResults) -> Table:
    """Return how the decisions came about and how fast the run was."""
    solver = results.solver
    table = Table(title="decisions", title_justify="left")
    table.add_column("")
    for heading in ("median", "p99", "largest"):
        table.add_column(heading, justify="right")
    table.add_row("solve time (ms)", *_quantiles(solver.solve_time_ms))
    table.add_row("iterations", *_quantiles(solver.iterations))
    table.add_row("age of the preview (s)", *_quantiles(solver.preview_age_s))
    table.add_section()
    for label, value in _counts(solver).items():
        table.add_row(label, "", "", value)
    table.add_section()
    table.add_row("wall time (s)", "", "", f"{results.wall_time_s:.2f}")
    table.add_row("speed-up over real time", "", "", f"{results.speed_up:.0f}")
    return table


def limits_table(metrics: RunMetrics) -> Table:
    """Return one row per limit: how often and how far it was exceeded."""
    table = Table(title="limits", title_justify="left")
    table.add_column("limit")
    table.add_column("kind")
    table.add_column("rows beyond", justify="right")
    table.add_column("worst", justify="right")
    table.add_column("at", justify="right")
    for check in metrics.constraints:
        table.add_row(*_limit_row(check))
    return table


def _limit_row(check: ConstraintCheck) -> tuple[str | Text, ...]:
    style = "" if not check.violations else ("bold red" if check.hard else "yellow")
    exceeded = check.worst_time_s is not None
    return (
        check.label,
        "hard" if check.hard else "soft",
        Text(str(check.violations), style=style),
        f"{check.worst_excess:.2g} {check.unit}" if exceeded else "-",
        f"{check.worst_time_s:g} s" if exceeded else "-",
    )


def _counts(solver: SolverStatistics) -> dict[str, str]:
    rows = {"decisions": solver.decisions}
    rows |= {f"  solver: {_words(name)}": count for name, count in solver.by_status.items()}
    rows |= {f"  command: {_words(name)}": count for name, count in solver.by_rung.items()}
    rows |= {"  without any preview": solver.without_preview}
    rows |= {"  changed by the limiter": solver.limited}
    return {
        **{label: str(count) for label, count in rows.items()},
        "largest gap slack (m)": _known(solver.gap_slack_m),
        "largest temperature slack (K)": _known(solver.temperature_slack_k),
    }


def _verdict(results: RunResults) -> Text:
    if results.problems:
        return Text("\n".join(f"PROBLEM  {problem}" for problem in results.problems), "bold red")
    checks: Mapping[bool | None, str] = {
        True: ", bag complete and equal to what the runner heard",
        None: ", not recorded",
    }
    said = checks.get(results.live_equals_bag, "")
    return Text(f"trip finished, no hard limit broken{said}", "bold green")


def _side_by_side(left: Table, right: Table) -> Table:
    grid = Table.grid()
    grid.add_row(left, Padding(right, (0, 0, 0, 3)))
    return grid


def _number(value: float) -> str:
    """Return a figure with five significant digits; large ones are written out."""
    return f"{value:.0f}" if abs(value) >= 1e5 else f"{value:.5g}"


def _quantiles(values: Quantiles) -> tuple[str, str, str]:
    return _known(values.median), _known(values.p99), _known(values.largest)


def _known(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "unknown"


def _words(name: str) -> str:
    return name.replace("_", " ")
