"""The command behind ``scripts/reproduce``: studies, from data to stored results and a report."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler

from iptm_core.errors import IptmError, ScenarioError
from iptm_studies.campaign import Campaign, plan_campaign
from iptm_studies.cluster import ClusterOptions, available_cores
from iptm_studies.execution import execute, survey
from iptm_studies.expected_time import ExpectedTimes, clock_text
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
DEFAULT_COMMAND = "reproduce"
_REPORT_MODULE = "iptm_studies.report"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or (given[0].startswith("-") and given[0] not in {"-h", "--help"}):
        given.insert(0, DEFAULT_COMMAND)
    options = _parser().parse_args(given)
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
        console.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        return EXIT_REFUSED
    except KeyboardInterrupt:
        console.print("stopped; the same command goes on from what is stored", markup=False)
        return EXIT_INTERRUPTED
    return code


def _list(options: argparse.Namespace, console: Console) -> int:
    del options, console
    for name in available_studies():
        study = load_study(name)
        print(f"{name:20} {len(study.cases):3} cases  {study.title}")
    return 0


def _run(options: argparse.Namespace, console: Console) -> int:
    campaign, store = _campaign(options), _store(options)
    cluster = ClusterOptions(options.scheduler, options.workers)
    if options.dry_run:
        return _dry_run(campaign, store, cluster)
    with progress_display(console) as display:
        outcome = execute(campaign, store, cluster, display)
    console.print(
        f"{outcome.computed} runs computed, {outcome.found} found in {store.folder}, "
        f"{outcome.failed} failed, in {clock_text(outcome.wall_s)}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    for run, cause in campaign.failures.items():
        _complain(console, f"{run.address} failed: {cause}")
    for address, why in campaign.hopeless.items():
        _complain(console, f"{address} was left out: {why}")
    return EXIT_FAILED_RUNS if campaign.failures or campaign.hopeless else 0


def _dry_run(campaign: Campaign, store: ResultStore, cluster: ClusterOptions) -> int:
    times = ExpectedTimes()
    lacking = survey(campaign, store, times)
    for run in lacking:
        expected = clock_text(times.of(run.inputs))
        print(f"{run.address:60} {expected:>10}  {run.inputs.spec.describe()}")
    total_s = sum(times.of(run.inputs) for run in lacking)
    later = campaign.run_estimates()
    for address, inputs in later.items():
        expected = clock_text(times.of(inputs))
        print(f"{address:60} {expected:>10}  once the weights are known: {inputs.spec.describe()}")
    total_s += sum(times.of(inputs) for inputs in later.values())
    number = len(lacking) + len(later)
    text = f"{number} runs to compute, about {clock_text(total_s)} on one core"
    if not cluster.scheduler:
        workers = cluster.workers or available_cores()
        text += f", {clock_text(total_s / workers)} with {workers} workers"
    print(text)
    return 0


def _status(options: argparse.Namespace, console: Console) -> int:
    del console
    campaign, store = _campaign(options), _store(options)
    survey(campaign, store, ExpectedTimes())
    for study in campaign.studies:
        states = [state for state in campaign.cases() if state.study is study]
        done = sum(state.metrics is not None for state in states)
        print(f"{study.name:20} {done:3} of {len(states):3} cases")
        for state in states:
            if state.reason and (options.verbose or state.reason != "not computed"):
                print(f"    {state.case.name}: {state.reason}")
    return 0


def _tables(options: argparse.Namespace, console: Console) -> int:
    del console
    campaign, store = _campaign(options), _store(options)
    survey(campaign, store, ExpectedTimes())
    folder = Path(options.output) if options.output else store.folder / "tables"
    for path in write_tables(campaign, folder):
        print(path)
    return 0


def _report(options: argparse.Namespace, console: Console) -> int:
    campaign, store = _campaign(options), _store(options)
    survey(campaign, store, ExpectedTimes())
    output = Path(options.output) if options.output else store.folder / "report"
    try:
        build_report = import_module(_REPORT_MODULE).build_report
    except (ImportError, AttributeError) as error:
        raise ScenarioError(f"the report cannot be built: {error}") from error
    for path in build_report(store, campaign, output):
        console.print(f"report: {path}", markup=False, highlight=False, soft_wrap=True)
    return 0


def _reproduce(options: argparse.Namespace, console: Console) -> int:
    code = _run(options, console)
    return code if options.dry_run else max(code, _report(options, console))


def _prune(options: argparse.Namespace, console: Console) -> int:
    campaign, store = _campaign(options), _store(options)
    survey(campaign, store, ExpectedTimes())
    gone = store.prune(campaign.keys)
    console.print(f"{len(gone)} files deleted from {store.folder}", markup=False, soft_wrap=True)
    return 0


def _campaign(options: argparse.Namespace) -> Campaign:
    names = options.studies or [ALL]
    chosen = list(
        dict.fromkeys(
            name for given in names for name in (available_studies() if given == ALL else [given])
        )
    )
    return plan_campaign(chosen, SMALL if options.small else None)


def _store(options: argparse.Namespace) -> ResultStore:
    if options.store:
        return ResultStore(Path(options.store))
    folder = default_store_folder()
    return ResultStore(folder / SMALL_STORE if options.small else folder)


def _complain(console: Console, text: str) -> None:
    console.print(text, style="red", markup=False, highlight=False, soft_wrap=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="reproduce", description=__doc__)
    commands = parser.add_subparsers(
        dest="name", metavar="COMMAND", help=f"without one: {DEFAULT_COMMAND}"
    )
    chosen = argparse.ArgumentParser(add_help=False)
    chosen.add_argument(
        "studies",
        nargs="*",
        metavar="STUDY",
        help="shipped study or path of a study file; all of the shipped ones by default",
    )
    chosen.add_argument(
        "--small",
        action="store_true",
        help=f"all runs on a short trip ({SMALL.duration_s:g} s of {SMALL.cycle}); takes minutes",
    )
    chosen.add_argument("--store", default="", metavar="DIR", help="folder of the results")
    computing = argparse.ArgumentParser(add_help=False)
    computing.add_argument(
        "--workers", type=int, metavar="N", help="processes, one per core by default"
    )
    computing.add_argument(
        "--scheduler", default="", metavar="ADDRESS", help="use this Dask cluster instead"
    )
    computing.add_argument(
        "--dry-run", action="store_true", help="show what would be computed, and the expected time"
    )
    writing = argparse.ArgumentParser(add_help=False)
    writing.add_argument("--output", default="", metavar="DIR", help="folder of what is written")

    def add(name: str, text: str, function: object, *parents: argparse.ArgumentParser) -> None:
        command = commands.add_parser(name, help=text, description=text, parents=parents)
        command.set_defaults(command=function)
        if name == "status":
            command.add_argument("--verbose", action="store_true", help="name every missing run")

    add(
        "reproduce",
        "compute what is missing, then write the report",
        _reproduce,
        chosen,
        computing,
        writing,
    )
    add("run", "compute what is missing", _run, chosen, computing)
    add("report", "write the report from what is stored", _report, chosen, writing)
    add("list", "list the shipped studies", _list)
    add("status", "say what is stored and what is missing, and why", _status, chosen)
    add("tables", "write the results as CSV, one file per study", _tables, chosen, writing)
    add("prune", "delete stored runs that the studies do not need", _prune, chosen)
    return parser


if __name__ == "__main__":
    sys.exit(main())
