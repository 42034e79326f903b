"""Compute the studies of the paper and compare them with what it prints."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from iptm_studies.cli import (
    add_command,
    add_study_commands,
    choice_options,
    chosen_store,
    compute,
    compute_options,
    output_options,
    run_command,
    say,
    surveyed_campaign,
)
from iptm_studies.report.building import build_report

DEFAULT_COMMAND = "reproduce"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or (given[0].startswith("-") and given[0] not in {"-h", "--help"}):
        given.insert(0, DEFAULT_COMMAND)
    parser = argparse.ArgumentParser(prog="reproduce", description=__doc__)
    commands = parser.add_subparsers(
        dest="name", metavar="COMMAND", help=f"without one: {DEFAULT_COMMAND}"
    )
    add_command(
        commands,
        DEFAULT_COMMAND,
        "compute what is missing, then write the report",
        _reproduce,
        choice_options,
        compute_options,
        output_options,
    )
    add_command(
        commands,
        "report",
        "write the report from what is stored",
        _report,
        choice_options,
        output_options,
    )
    add_study_commands(commands)
    return run_command(parser, given)


def _report(options: argparse.Namespace, console: Console) -> int:
    store = chosen_store(options)
    output = Path(options.output) if options.output else store.folder / "report"
    for path in build_report(store, surveyed_campaign(options, store), output):
        say(console, f"report: {path}")
    return 0


def _reproduce(options: argparse.Namespace, console: Console) -> int:
    code = compute(options, console)
    return code if options.dry_run else max(code, _report(options, console))


if __name__ == "__main__":
    sys.exit(main())
