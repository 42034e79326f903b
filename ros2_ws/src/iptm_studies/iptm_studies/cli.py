"""Compute studies: closed loops without ROS, kept in a store and computed once.

The commands are parts, so that other programs (such as the reproduction of the paper) add their own.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler

from iptm_core.errors import IptmError
from iptm_studies.campaign import NOT_COMPUTED, Campaign, plan_campaign
from iptm_studies.cluster import ClusterOptions, available_cores
from iptm_studies.execution import execute, survey
from iptm_studies.expected_time import clock_text
from iptm_studies.progress import progress_display
from iptm_studies.store import ResultStore, default_store_folder
from iptm_studies.study import SMALL
from iptm_studies.study_loading import available_studies, load_study
from iptm_studies.tables import write_tables

EXIT_FAILED_RUNS = 1
EXIT_REFUSED = 2
EXIT_INTERRUPTED = 130
ALL = "all"
SMALL_STORE = "small"

Command = Callable[[argparse.Namespace, Console], int]
"""Does what is asked and returns the exit code."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line of the studies alone; returns the exit code."""
    parser = argparse.ArgumentParser(prog="studies", description=__doc__)
    add_study_commands(parser.add_subparsers(dest="name", metavar="COMMAND", required=True))
    return run_command(parser, sys.argv[1:] if arguments is None else arguments)


def run_command(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> int:
    """Parse arguments and run their command; errors become a line and an exit code."""
    options = parser.parse_args(arguments)
    console = Console(stderr=True)
    logging.basicConfig(
        level=logging.WARNING,
        format="%(message)s",
        handlers=[RichHandler(console=console, show_time=False, show_path=False)],
        force=True,
    )
    try:
        code: int = options.command(options, console)
    except IptmError as error:
        complain(console, f"error: {error}")
        return EXIT_REFUSED
    except KeyboardInterrupt:
        console.print("stopped; the same command goes on from what is stored", markup=False)
        return EXIT_INTERRUPTED
    return code


def add_command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    text: str,
    function: Command,
    *option_groups: Callable[[argparse.ArgumentParser], None],
) -> None:
    """Add a command.

    Args:
        commands: what ``add_subparsers`` returned.
        name: of the command.
        text: what it does, for the help.
        function: does it.
        option_groups: functions that add options, such as ``choice_options``.
    """
    parser = commands.add_parser(name, help=text, description=text)
    parser.set_defaults(command=function)
    for add_options in option_groups:
        add_options(parser)


def add_study_commands(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands that compute studies and look after their results."""
    add_command(
        commands, "run", "compute what is missing", compute, choice_options, compute_options
    )
    add_command(commands, "list", "list the shipped studies", _list)
    add_command(
        commands,
        "status",
        "say what is stored and what is missing, and why",
        _status,
        choice_options,
        _status_options,
    )
    add_command(
        commands,
        "tables",
        "write the results as CSV, one file per study",
        _tables,
        choice_options,
        output_options,
    )
    add_command(
        commands,
        "prune",
        "delete stored runs that the studies do not need",
        _prune,
        choice_options,
    )


def choice_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose studies and store."""
    parser.add_argument(
        "studies",
        nargs="*",
        metavar="STUDY",
        help="shipped study or path of a study file; all of the shipped ones by default",
    )
    parser.add_argument(
        "--small",
        action="store_true",
        help=f"all runs on a short trip ({SMALL.duration_s:g} s of {SMALL.cycle}); takes minutes",
    )
    parser.add_argument("--store", default="", metavar="DIR", help="folder of the results")


def compute_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of commands that compute."""
    parser.add_argument(
        "--workers", type=int, metavar="N", help="processes, one per core by default"
    )
    parser.add_argument(
        "--scheduler", default="", metavar="ADDRESS", help="use this Dask cluster instead"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="show what would be computed, and the expected time"
    )


def output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of commands that write files."""
    parser.add_argument("--output", default="", metavar="DIR", help="folder of what is written")


def _status_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--verbose", action="store_true", help="name every missing run")


def chosen_store(options: argparse.Namespace) -> ResultStore:
    """Return the store that ``choice_options`` name."""
    if options.store:
        return ResultStore(Path(options.store))
    folder = default_store_folder()
    return ResultStore(folder / SMALL_STORE if options.small else folder)


def chosen_campaign(options: argparse.Namespace) -> Campaign:
    """Plan the studies that ``choice_options`` name."""
    names = [
        name
        for given in options.studies or [ALL]
        for name in (available_studies() if given == ALL else [given])
    ]
    return plan_campaign(dict.fromkeys(names), SMALL if options.small else None)


def surveyed_campaign(options: argparse.Namespace, store: ResultStore) -> Campaign:
    """Plan the chosen studies and compare them with a store."""
    campaign = chosen_campaign(options)
    survey(campaign, store)
    return campaign


def say(console: Console, text: str) -> None:
    """Print a line as it is."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def complain(console: Console, text: str) -> None:
    """Print a line as it is, in red."""
    console.print(text, style="red", markup=False, highlight=False, soft_wrap=True)


def compute(options: argparse.Namespace, console: Console) -> int:
    """Compute what is missing, or with ``--dry-run`` show what that would be."""
    campaign, store = chosen_campaign(options), chosen_store(options)
    cluster = ClusterOptions(options.scheduler, options.workers)
    if options.dry_run:
        return _dry_run(campaign, store, cluster)
    with progress_display(console) as display:
        totals = execute(campaign, store, cluster, display)
    say(
        console,
        f"{totals.computed} runs computed, {totals.found} found in {store.folder}, "
        f"{totals.failed} failed, in {clock_text(totals.wall_s)}",
    )
    for address, cause in campaign.failures.items():
        complain(console, f"{address} failed: {cause}")
    for address, reason in campaign.left_out.items():
        complain(console, f"{address} was left out: {reason}")
    return EXIT_FAILED_RUNS if campaign.failures or campaign.left_out else 0


def _dry_run(campaign: Campaign, store: ResultStore, cluster: ClusterOptions) -> int:
    lacking, later = survey(campaign, store), campaign.later_runs()
    total_s = 0.0
    for remark, runs in (("", lacking), ("once the weights are known: ", later)):
        for inputs in runs:
            expected_s = campaign.expected.of(inputs)
            total_s += expected_s
            what = f"{remark}{inputs.spec.describe()}"
            print(f"{inputs.address:60} {clock_text(expected_s):>10}  {what}")
    text = f"{len(lacking) + len(later)} runs to compute, about {clock_text(total_s)} on one core"
    if not cluster.scheduler:
        workers = cluster.workers or available_cores()
        text += f", {clock_text(total_s / workers)} with {workers} workers"
    print(text)
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
        states = [state for state in campaign.cases if state.study is study]
        done = sum(state.metrics is not None for state in states)
        print(f"{study.name:20} {done:3} of {len(states):3} cases")
        for state in states:
            if state.reason and (options.verbose or state.reason != NOT_COMPUTED):
                print(f"    {state.case.name}: {state.reason}")
    return 0


def _tables(options: argparse.Namespace, console: Console) -> int:
    del console
    store = chosen_store(options)
    folder = Path(options.output) if options.output else store.folder / "tables"
    for path in write_tables(surveyed_campaign(options, store), folder):
        print(path)
    return 0


def _prune(options: argparse.Namespace, console: Console) -> int:
    store = chosen_store(options)
    gone = store.prune(surveyed_campaign(options, store).keys)
    say(console, f"{len(gone)} files deleted from {store.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
