"""The commands on studies: compute, list, status, tables, prune; a package above can add its own."""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler

from iptm.studies.campaign import Campaign, plan_campaign, survey
from iptm.studies.execution import ProgressDisplay, clock_text, execute
from iptm.studies.store import ResultStore, default_store_folder
from iptm.studies.study import NOT_COMPUTED, SHORT_TRIP
from iptm.studies.study_loading import available_studies, load_study
from iptm.studies.tables import write_tables
from iptm.studies.workers import worker_count
from iptm_core.errors import IptmError
from iptm_core.program import EXIT_SIGNAL, EXIT_USER_ERROR
from iptm_core.user_input import whole_number

EXIT_FAILED_RUNS = 1
ALL = "all"
SMALL_STORE = "small"

Command = Callable[[argparse.Namespace, Console], int]
"""Performs a command; returns the exit code."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    commands = StudyCommands("studies", __doc__, default="run")
    commands.add_study_commands()
    return commands.run(arguments)


class StudyCommands:
    """A command line on studies; without a command, the default one is performed.

    Attributes:
        choosing: options that name studies and a store.
        computing: options on how runs are computed.
        writing: option that names a folder of output.
    """

    def __init__(self, program: str, description: str, default: str) -> None:
        self._default = default
        self._parser = argparse.ArgumentParser(prog=program, description=description)
        self._commands = self._parser.add_subparsers(
            dest="name", metavar="COMMAND", help=f"without one: {default}"
        )
        self.choosing, self.computing, self.writing = (
            argparse.ArgumentParser(add_help=False) for _ in range(3)
        )
        text = "shipped study or path of a study file; all of the shipped ones by default"
        self.choosing.add_argument("studies", nargs="*", metavar="STUDY", help=text)
        text = "all runs on a short trip ({duration_s:g} s of {cycle}); takes minutes".format_map(
            SHORT_TRIP
        )
        self.choosing.add_argument("--small", action="store_true", help=text)
        text = "folder of the results"
        self.choosing.add_argument("--store", type=Path, metavar="DIR", help=text)
        add_workers_option(self.computing)
        text = "show what would be computed, and the expected time"
        self.computing.add_argument("--dry-run", action="store_true", help=text)
        text = "folder of what is written"
        self.writing.add_argument("--output", type=Path, metavar="DIR", help=text)

    def add(
        self, name: str, text: str, command: Command, *options: argparse.ArgumentParser
    ) -> argparse.ArgumentParser:
        """Add a command with groups of options; returns its parser."""
        added = self._commands.add_parser(name, help=text, description=text, parents=options)
        added.set_defaults(command=command)
        return added

    def add_study_commands(self) -> None:
        """Add the commands of this package."""
        self.add("run", "compute what is missing", run_studies, self.choosing, self.computing)
        self.add("list", "list the shipped studies", _list)
        text = "list what is stored and what is missing, and why"
        status = self.add("status", text, _status, self.choosing)
        status.add_argument("--verbose", action="store_true", help="name every missing run")
        text = "write the results as CSV, one file per study"
        self.add("tables", text, _tables, self.choosing, self.writing)
        self.add("prune", "delete stored runs that the studies do not need", _prune, self.choosing)

    def run(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command of the arguments (None for those of the process); returns the exit code."""
        given = list(sys.argv[1:] if arguments is None else arguments)
        if not given or (given[0].startswith("-") and given[0] not in {"-h", "--help"}):
            given.insert(0, self._default)
        options = self._parser.parse_args(given)
        return perform_command(options.command, options)


def perform_command(command: Command, options: argparse.Namespace) -> int:
    """Perform a command; returns its exit code, or that of a refusal or an interruption, with one message."""
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    logging.basicConfig(
        level=logging.WARNING,
        format="%(message)s",
        handlers=[RichHandler(console=console, show_time=False, show_path=False)],
        force=True,
    )
    try:
        return command(options, console)
    except IptmError as error:
        console.print(f"error: {error}", style="red")
        return EXIT_USER_ERROR
    except KeyboardInterrupt:
        console.print("stopped; the same command goes on from what is stored")
        return EXIT_SIGNAL + signal.SIGINT


def add_workers_option(parser: argparse.ArgumentParser) -> None:
    """Add the option on how many runs are computed at a time."""
    parser.add_argument(
        "--workers", type=whole_number, metavar="N", help="processes, one per core by default"
    )


def compute(campaign: Campaign, store: ResultStore, workers: int, console: Console) -> None:
    """Compute the missing runs of a campaign, with progress, and print their number."""
    began = time.perf_counter()
    display = ProgressDisplay(console)
    with display.bar:
        computed = execute(campaign, store, workers, display)
    console.print(
        f"{computed} runs computed, {campaign.finished - computed} found in {store.folder}, "
        f"{len(campaign.failures)} failed, in {clock_text(time.perf_counter() - began)}"
    )


def chosen_store(options: argparse.Namespace) -> ResultStore:
    """Return the store that the options name."""
    folder = default_store_folder()
    return ResultStore(options.store or (folder / SMALL_STORE if options.small else folder))


def surveyed_campaign(options: argparse.Namespace, store: ResultStore) -> Campaign:
    """Return the chosen studies, compared with what is stored."""
    campaign = _chosen_campaign(options)
    survey(campaign, store)
    return campaign


def _chosen_campaign(options: argparse.Namespace) -> Campaign:
    names: list[str] = []
    for given in options.studies or [ALL]:
        names += available_studies() if given == ALL else [given]
    return plan_campaign(dict.fromkeys(names), SHORT_TRIP["duration_s"] if options.small else None)


def run_studies(options: argparse.Namespace, console: Console) -> int:
    """Compute what is missing, or show what that would be; returns the exit code."""
    campaign, store = _chosen_campaign(options), chosen_store(options)
    workers = worker_count(options.workers)
    if options.dry_run:
        return _dry_run(campaign, store, workers)
    compute(campaign, store, workers, console)
    for text, causes in (("failed", campaign.failures), ("was left out", campaign.left_out)):
        for address, cause in causes.items():
            console.print(f"{address} {text}: {cause}", style="red")
    return EXIT_FAILED_RUNS if campaign.failures or campaign.left_out else 0


def _dry_run(campaign: Campaign, store: ResultStore, workers: int) -> int:
    lacking, later = survey(campaign, store), campaign.later_runs()
    total_s = 0.0
    for remark, runs in (("", lacking), ("once the weights are known: ", later)):
        for inputs in runs:
            expected_s = campaign.expected.of(inputs)
            total_s += expected_s
            what = f"{remark}{inputs.spec.describe()}"
            print(f"{inputs.address:60} {clock_text(expected_s):>10}  {what}")
    print(
        f"{len(lacking) + len(later)} runs to compute, about {clock_text(total_s)} on one core, "
        f"{clock_text(total_s / workers)} with {workers} workers"
    )
    return 0


def _list(options: argparse.Namespace, console: Console) -> int:
    del options, console
    for name in available_studies():
        study = load_study(name)
        print(f"{name:20} {len(study.cases):3} cases  {study.title}")
    return 0


def _status(options: argparse.Namespace, console: Console) -> int:
    del console
    campaign = surveyed_campaign(options, chosen_store(options))
    for study in campaign.studies:
        cases = campaign.cases_of(study)
        done = sum(case.metrics is not None for case in cases)
        print(f"{study.name:20} {done:3} of {len(cases):3} cases")
        for case in cases:
            if case.reason and (options.verbose or case.reason != NOT_COMPUTED):
                print(f"    {case.name}: {case.reason}")
    return 0


def _tables(options: argparse.Namespace, console: Console) -> int:
    del console
    store = chosen_store(options)
    folder = options.output or store.folder / "tables"
    for path in write_tables(surveyed_campaign(options, store), folder):
        print(path)
    return 0


def _prune(options: argparse.Namespace, console: Console) -> int:
    store = chosen_store(options)
    gone = store.prune(surveyed_campaign(options, store).keys)
    console.print(f"{len(gone)} files deleted from {store.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
