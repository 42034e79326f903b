"""Commands that read bags: `info`, `compare` and `export`.

What they need is imported where it is used: their ``--help`` is there at once.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from iptm_core.errors import BagError, IptmError, StoreError
from iptm_core.program import EXIT_OK, refused
from iptm_core.user_input import number

# ruff: noqa: PLC0415
if TYPE_CHECKING:
    import pandas as pd

    from iptm.comparison import Comparison

INFO, COMPARE, EXPORT = (f"iptm {name}" for name in ("info", "compare", "export"))
EXIT_DIFFERENT = 1
PIPE_WIDTH = 160
_BAG = "bag folder or file"


def console_of_width() -> Console:
    """Return a console as wide as the terminal, or as a table needs."""
    # A pipe has no width of its own.
    return Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)


def info(arguments: Sequence[str] | None = None) -> int:
    """Print the contents of a bag.

    Returns:
        0 on success, 2 when the bag cannot be read.
    """
    parser = argparse.ArgumentParser(
        INFO, description="Show the topics of a bag, what its run depended on and what it achieved."
    )
    parser.add_argument("bag", type=Path, nargs="+", help=_BAG)
    parser.add_argument(
        "--namespace", help="vehicle whose figures are wanted, if there are several"
    )
    parser.add_argument("--parameters", action="store_true", help="print the stored parameters")
    given = parser.parse_args(arguments)
    from iptm_bags.bag_info import print_information

    console = console_of_width()
    try:
        for path in given.bag:
            print_information(
                path, console, namespace=given.namespace, show_parameters=given.parameters
            )
    except IptmError as error:
        return refused(INFO, error)
    return EXIT_OK


def compare(arguments: Sequence[str] | None = None) -> int:
    """Compare runs by their figures, or two bags message by message.

    Returns:
        0 on success, 1 when two bags differ with ``--exact``, 2 when a run cannot be read or a file cannot
            be written.
    """
    parser = argparse.ArgumentParser(
        COMPARE,
        description="Compare runs with the first one: figures, their changes, and settings that differ. With"
        " --exact: compare two bags message by message; ends with 1 when they differ.",
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help=_BAG)
    parser.add_argument("--namespace", help="vehicle to read, in bags that hold several")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="write the curves as a PNG file"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write all of it as one HTML page"
    )
    exact = parser.add_argument_group("message by message")
    exact.add_argument(
        "--exact",
        action="store_true",
        help="all messages of two bags; without a tolerance bit for bit",
    )
    lists = {
        "--topics": "names or patterns to compare",
        "--exclude": "names or patterns to leave out (default: logs and parameter events)",
        "--ignore": "fields that may differ (default: wall times)",
    }
    for option, text in lists.items():
        exact.add_argument(option, nargs="+", metavar=option[2:].upper(), help=text)
    for kind in ("absolute", "relative"):
        exact.add_argument(
            f"--{kind}", type=number, help=f"{kind} tolerance of numbers (default: 0)"
        )
    given = parser.parse_args(arguments)
    of_messages = (given.topics, given.exclude, given.ignore, given.absolute, given.relative)
    try:
        if given.exact:
            return _compare_messages(given)
        if any(each is not None for each in of_messages):
            raise BagError("options of messages are given without --exact; allowed: with it")
        _compare_figures(given)
    except IptmError as error:
        return refused(COMPARE, error)
    except (OSError, ValueError) as error:  # of matplotlib: the folder, or the ending of the file
        return refused(COMPARE, f"picture cannot be written: {error}")
    return EXIT_OK


def _compare_messages(given: argparse.Namespace) -> int:
    from iptm_bags.compare_bags import (
        DEFAULT_EXCLUDED_TOPICS,
        DEFAULT_IGNORED_FIELDS,
        NumberTolerance,
        compare_bags,
        print_comparison,
    )
    from iptm_ros.recording.recorded_topics import TopicSelection

    if len(given.runs) != 2 or given.picture or given.report or given.namespace:
        raise BagError("--exact takes two bags, and no namespace, picture or report")
    excluded = DEFAULT_EXCLUDED_TOPICS if given.exclude is None else given.exclude
    comparison = compare_bags(
        *given.runs,
        selection=TopicSelection(tuple(given.topics or ()), tuple(excluded)),
        tolerance=NumberTolerance(given.absolute or 0.0, given.relative or 0.0),
        ignored_fields=DEFAULT_IGNORED_FIELDS if given.ignore is None else given.ignore,
    )
    console = console_of_width()
    agree = print_comparison(comparison, console)
    console.print("the bags agree" if agree else "the bags differ")
    return EXIT_OK if agree else EXIT_DIFFERENT


def _compare_figures(given: argparse.Namespace) -> None:
    from iptm.comparison import compare as compare_runs
    from iptm.run_file import load

    for path in filter(None, (given.picture, given.report)):
        if path.exists():
            raise StoreError(f"{path} exists already; allowed: a new file")
    comparison = compare_runs(*(load(path, given.namespace) for path in given.runs))
    _print_figures(comparison)
    if given.picture is not None:
        comparison.plot().savefig(given.picture)
    if given.report is not None:
        comparison.report(given.report)


def _print_figures(comparison: Comparison) -> None:
    from iptm.report import figure_table, outcome_lines

    console = console_of_width()
    for line in comparison.headlines:
        console.print(Text(line, "bold"), soft_wrap=True)
    for label, run in comparison.runs.items():
        for line in outcome_lines(run.metrics, run.problems):
            console.print(Text(f"{label}: {line}"), soft_wrap=True)
    figures = figure_table({label: run.metrics for label, run in comparison.runs.items()})
    made_of = comparison.parts.map("{:+.1f}".format)
    made_of.index = made_of.index.map(": ".join)
    console.print(_table("points of the saving", made_of))
    console.print(_table("figure", figures))
    if len(comparison.differences):
        console.print(_table("what differs", comparison.differences.astype(str)))
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


def export(arguments: Sequence[str] | None = None) -> int:
    """Write a run, or the messages of a topic, as a table.

    Returns:
        0 on success, 2 when the bag cannot be read or the file cannot be written.
    """
    parser = argparse.ArgumentParser(
        EXPORT,
        description="Write the run of a bag, one row per tick, or the messages of one topic as a Parquet"
        " or CSV file. Column names include units; Parquet also holds the run information.",
    )
    parser.add_argument("bag", type=Path, help=_BAG)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help="new file: .parquet or .csv",
    )
    parser.add_argument(
        "--topic", help="write the messages of this topic, one row each, not the trajectory"
    )
    parser.add_argument("--namespace", help="vehicle to write, if the bag holds several")
    given = parser.parse_args(arguments)
    from iptm_bags.export import write_table

    try:
        table = write_table(given.bag, given.output, given.topic, given.namespace)
    except IptmError as error:
        return refused(EXPORT, error)
    print(f"{table.num_rows} rows, {table.num_columns} columns in {given.output}")
    return EXIT_OK
