"""The command behind ``scripts/reproduce``: studies, from data to stored results and a report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from iptm.studies.cli import StudyCommands, chosen_store, run_studies, surveyed_campaign


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    line = StudyCommands("reproduce", __doc__, default="reproduce")
    line.add(
        "reproduce",
        "compute what is missing, then write the report",
        _reproduce,
        line.choosing,
        line.computing,
        line.writing,
    )
    text = "write the report from what is stored"
    line.add("report", text, _report, line.choosing, line.writing)
    line.add_study_commands()
    return line.run(arguments)


def _report(options: argparse.Namespace, console: Console) -> int:
    # Imported late: workers and the other commands do without matplotlib.
    from iptm_reproduction.report import build_report  # noqa: PLC0415

    store = chosen_store(options)
    campaign = surveyed_campaign(options, store)
    output = Path(options.output) if options.output else store.folder / "report"
    for path in build_report(store, campaign, output):
        console.print(f"report: {path}", markup=False, highlight=False, soft_wrap=True)
    return 0


def _reproduce(options: argparse.Namespace, console: Console) -> int:
    code = run_studies(options, console)
    return code if options.dry_run else max(code, _report(options, console))


if __name__ == "__main__":
    sys.exit(main())
