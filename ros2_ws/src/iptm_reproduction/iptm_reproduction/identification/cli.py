"""The command behind ``scripts/identify``: search, show what was found, ship it under its names."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from iptm.studies.cli import add_workers_option, perform_command
from iptm.studies.store import default_store_folder
from iptm.studies.workers import worker_count
from iptm_core.program import EXIT_USER_ERROR
from iptm_core.user_input import whole_number
from iptm_reproduction.identification.evaluations import EvaluationTable, deviations, misfit
from iptm_reproduction.identification.search import STAGES, Scored, Search
from iptm_reproduction.identification.shipping import ship
from iptm_reproduction.identification.unknowns import (
    Candidate,
    Unknowns,
    read_unknowns,
    shipped_unknowns,
)

TABLE_NAME = "identification.jsonl"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="identify", description=__doc__)
    parser.add_argument(
        "command",
        nargs="?",
        default="search",
        choices=("search", "show", "ship"),
        help="search: go on with the search (default); show: the best candidates; ship: write the best one "
        "as composition comprehensive_identified and set paper_identified",
    )
    parser.add_argument("--table", default="", metavar="FILE", help="table of the runs")
    parser.add_argument("--unknowns", default="", metavar="FILE", help="bounds and priors")
    add_workers_option(parser)
    parser.add_argument(
        "--best", type=whole_number, default=5, metavar="N", help="candidates to show"
    )
    return perform_command(_run, parser.parse_args(arguments))


def _run(options: argparse.Namespace, console: Console) -> int:
    unknowns = read_unknowns(Path(options.unknowns) if options.unknowns else shipped_unknowns())
    path = Path(options.table) if options.table else default_store_folder() / TABLE_NAME
    table = EvaluationTable(path)
    if options.command == "search":
        workers = worker_count(options.workers)
        found = Search(unknowns, table, workers, console.print).run()
        console.print(f"{len(table.entries)} runs in {path}")
        _show(found[: options.best])
        return 0
    found = _stored(table, unknowns)
    if not found:
        console.print(f"{path} holds no candidate with all six strategies; run the search first")
        return EXIT_USER_ERROR
    if options.command == "show":
        _show(found[: options.best])
        return 0
    for written in ship(found[0].candidate, table):
        console.print(str(written))
    return 0


def _stored(table: EvaluationTable, unknowns: Unknowns) -> list[Scored]:
    """Return the candidates of a table that were driven with every strategy, the best first."""
    every = set(STAGES[-1].strategies)
    found = []
    for values, runs in table.by_candidate():
        if every <= set(runs):
            fit = misfit(runs)
            found.append(Scored(Candidate(unknowns, values), fit, fit, runs))
    return sorted(found, key=lambda scored: scored.misfit)


def _show(found: Sequence[Scored]) -> None:
    for number, scored in enumerate(found, start=1):
        print(f"{number}. misfit {scored.misfit:.3f}")
        for key, value in scored.candidate.values.items():
            print(f"     {key:48} {value:g}")
        for (strategy, figure), value in deviations(scored.runs).items():
            print(f"     deviation of {strategy:24} {figure:24} {value:+.2f}")


if __name__ == "__main__":
    sys.exit(main())
