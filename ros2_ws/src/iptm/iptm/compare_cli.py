"""The command `compare`: bags side by side, as a table, a picture and a page."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from iptm.bags import load
from iptm.comparison import Comparison, compare
from iptm.report import figure_table, outcome_lines
from iptm_core.errors import IptmError, StoreError
from iptm_core.program import refused

PIPE_WIDTH = 160


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="compare",
        description="Compare runs with the first one: figures, changes, and the settings that differ."
        " Whether two bags hold the same messages is what compare_bags is for.",
    )
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="bag folder or file",
    )
    parser.add_argument("--namespace", help="vehicle to read, in bags that hold several")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="write the curves as a PNG file"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write all of it as one HTML page"
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare runs.

    Returns:
        0 on success, 2 when a run cannot be read or a file cannot be written.
    """
    given = build_parser().parse_args(arguments)
    try:
        for path in filter(None, (given.picture, given.report)):
            if path.exists():
                raise StoreError(f"{path} exists already; allowed: a new file")
        comparison = compare(*(load(path, given.namespace) for path in given.runs))
        _print(comparison)
        if given.picture is not None:
            comparison.plot().savefig(given.picture)
        if given.report is not None:
            comparison.report(given.report)
    except IptmError as error:
        return refused("compare", error)
    except (OSError, ValueError) as error:  # of matplotlib: the folder, or the ending of the file
        return refused("compare", f"picture cannot be written: {error}")
    return 0


def _print(comparison: Comparison) -> None:
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    for line in comparison.headlines:
        console.print(Text(line, "bold"), soft_wrap=True)
    for label, run in comparison.runs.items():
        for line in outcome_lines(run.metrics):
            console.print(Text(f"{label}: {line}"), soft_wrap=True)
    console.print(
        _table(
            "figure", figure_table({label: run.metrics for label, run in comparison.runs.items()})
        )
    )
    differences = comparison.differences
    if len(differences):
        console.print(_table("what differs", differences.astype(str)))
    else:
        console.print("the settings do not differ")


def _table(corner: str, frame: pd.DataFrame) -> Table:
    # As plain text: units stand in brackets, which are markup to rich.
    table = Table(corner)
    for name in frame.columns:
        table.add_column(Text(name), justify="right")
    for row in frame.itertuples():
        table.add_row(*(Text(str(value)) for value in row))
    return table


if __name__ == "__main__":
    sys.exit(main())
