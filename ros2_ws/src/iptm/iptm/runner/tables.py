"""All results of a run on a terminal: figures, decisions and limits as tables."""

from __future__ import annotations

import math
from enum import Enum

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from iptm.report import change_text, relative_changes
from iptm.run import Run
from iptm_core.decision_record import DecisionStatistics
from iptm_core.metrics.constraints import ConstraintCheck
from iptm_core.metrics.figures import FIGURES, PAPER_TABLE, TRIP_FIGURES
from iptm_core.metrics.run_metrics import RunMetrics

TABLES_WIDTH = 124
"""Columns that both tables need side by side."""
COMPARISON_WIDTH = 24
"""Columns that a comparison adds."""


def print_tables(run: Run, console: Console) -> None:
    """Print all figures, how the decisions came about, and the limits that were exceeded."""
    tables = (figures_table(run), details_table(run))
    if console.width >= TABLES_WIDTH + COMPARISON_WIDTH * (run.other is not None):
        console.print(_side_by_side(*tables))
    else:
        console.print(*tables)
    console.print(limits_table(run.metrics))


def figures_table(run: Run) -> Table:
    """Return the figures of the trip, the paper's rows first; times out of limits where there are any."""
    table = Table(title=run.name, title_justify="left")
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    values, other = run.figures, run.other
    others = other.figures if other else {}
    changes = relative_changes(values, others)
    if other:
        table.add_column(other.strategy, justify="right")
        table.add_column("change", justify="right")
    paper = [key for key in TRIP_FIGURES if key in PAPER_TABLE]
    for section in (paper, [key for key in TRIP_FIGURES if key not in PAPER_TABLE]):
        for key in section:
            figure = FIGURES[key]
            if key.startswith("longest_") and not values.get(key):
                continue
            row = [figure.label, figure.precise_text(values.get(key)), figure.unit]
            if other:
                row += [figure.precise_text(others.get(key)), change_text(key, changes)]
            table.add_row(*row)
        table.add_section()
    return table


def details_table(run: Run) -> Table:
    """Return how the decisions came about and how fast the run was."""
    statistics = DecisionStatistics.of(run.decisions, run.trajectory)
    table = decisions_table("decisions", statistics)
    table.add_section()
    for label, text in _counts(statistics).items():
        table.add_row(label, "", "", text)
    table.add_section()
    table.add_row("wall time (s)", "", "", f"{run.wall_time_s:.2f}")
    table.add_row("speed-up over real time", "", "", f"{run.speed_up:.0f}")
    return table


def decisions_table(title: str, statistics: DecisionStatistics) -> Table:
    """Return the spread of what every decision reports."""
    table = Table("", title=title, title_justify="left")
    headings = ("median", "p99", "largest")
    for heading in headings:
        table.add_column(heading, justify="right")
    for label, scale, spread in (
        ("solve time (ms)", 1e3, statistics.solve_time_s),
        ("iterations", 1.0, statistics.iterations),
        ("age of the preview (s)", 1.0, statistics.preview_age_s),
    ):
        values = [spread[heading] for heading in headings]
        table.add_row(label, *("unknown" if math.isnan(v) else f"{scale * v:.4g}" for v in values))
    return table


def limits_table(metrics: RunMetrics) -> Table | Text:
    """Return one row per limit that was exceeded: how often and how far."""
    exceeded = [check for check in metrics.constraints if check.worst_time_s is not None]
    if not exceeded:
        return Text(f"none of {len(metrics.constraints)} limits exceeded")
    table = Table(title="limits", title_justify="left")
    table.add_column("limit")
    table.add_column("kind")
    table.add_column("rows beyond", justify="right")
    table.add_column("worst", justify="right")
    table.add_column("at", justify="right")
    for check in exceeded:
        table.add_row(*_limit_row(check))
    return table


def _limit_row(check: ConstraintCheck) -> tuple[str | Text, ...]:
    style = "" if not check.violations else ("bold red" if check.hard else "yellow")
    return (
        check.label,
        "hard" if check.hard else "soft",
        Text(str(check.violations), style=style),
        f"{check.worst_excess:.2g} {check.unit}",
        f"{check.worst_time_s:g} s",
    )


def _counts(decisions: DecisionStatistics) -> dict[str, str]:
    rows = {"decisions": decisions.decisions}
    rows |= {
        f"  solver: {_words(status)}": count
        for status, count in decisions.by_status.items()
        if count
    }
    rows |= {
        f"  command: {_words(rung)}": count for rung, count in decisions.by_rung.items() if count
    }
    rows |= {"  too late: an earlier command held": decisions.held}
    rows |= {"  none: stopped for want of commands": decisions.undecided}
    rows |= {"  without any preview": decisions.without_preview}
    rows |= {"  changed by the limiter": decisions.limited}
    return {
        **{label: str(count) for label, count in rows.items()},
        "largest gap slack (m)": _known(decisions.gap_slack_m["largest"]),
        "largest temperature slack (K)": _known(decisions.temperature_slack_k["largest"]),
    }


def _side_by_side(left: Table, right: Table) -> Table:
    grid = Table.grid()
    grid.add_row(left, Padding(right, (0, 0, 0, 3)))
    return grid


def _known(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "unknown"


def _words(entry: Enum) -> str:
    return entry.name.lower().replace("_", " ")
