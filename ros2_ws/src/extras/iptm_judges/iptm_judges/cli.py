"""The command `judge`: ageing of a run by many laws, and what it saves against another run."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from iptm.judging import BY, Verdicts, judge
from iptm.run_file import load
from iptm_core.compilation import cache_directory
from iptm_core.errors import IptmError
from iptm_core.metrics.run_metrics import significant
from iptm_core.program import EXIT_OK, EXIT_REFUSED, print_error, refused

PROGRAM = "iptm judge"
PIPE_WIDTH = 160


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge a run.

    Returns:
        0 on success, 1 when a judge has no figure, 2 when a run cannot be read or judged.
    """
    parser = argparse.ArgumentParser(
        PROGRAM,
        description="Judge the ageing of a run by current and temperature of its cells: by the paper's law "
        "and by laws of measured cells; with requirements/judges.txt by BLAST-Lite (blast) and PyBaMM "
        "(pybamm, pybamm_charged), too. Laws of cells and BLAST-Lite count the trip and its charging, over "
        "and over for a week. With another run: what the first one saves. Judgements are kept in the cache.",
    )
    parser.add_argument("run", type=Path, help="bag folder or file, or a saved run (.npz)")
    parser.add_argument("other", type=Path, nargs="?", help="run of the same trip to compare with")
    parser.add_argument(
        "--by",
        nargs="+",
        default=list(BY),
        metavar="JUDGE",
        help=f"groups, or single judges such as cells/NCA (default: {' '.join(BY)})",
    )
    parser.add_argument(
        "--crossed",
        action="store_true",
        help="also the current of each run at the temperatures of the other one",
    )
    parser.add_argument("--namespace", help="vehicle to read, in bags that hold several")
    given = parser.parse_args(arguments)
    try:
        run = load(given.run, given.namespace)
        other = None if given.other is None else load(given.other, given.namespace)
        cache = cache_directory() / "judged"
        found = judge(run, other, given.by, crossed=given.crossed, cache=cache)
    except IptmError as error:
        return refused(PROGRAM, error)
    _print(found)
    for name, cause in found.failures.items():
        print_error(PROGRAM, f"{name}: {cause}")
    return EXIT_REFUSED if found.failures else EXIT_OK


def _print(found: Verdicts) -> None:
    # A pipe has no width of its own.
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    table = Table("judge", "")
    for column in found.table:
        table.add_column(Text(str(column)), justify="right")
    for (group, name), row in found.table.iterrows():
        values = (
            significant(value) if "ppm" in column else f"{value:.1f}"
            for column, value in row.items()
        )
        table.add_row(Text(group), Text("" if name == group else name), *values)
    console.print(table)
    for line in found.text.splitlines():
        console.print(Text(line), soft_wrap=True)
