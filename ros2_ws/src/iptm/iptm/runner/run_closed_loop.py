"""The command ``run_closed_loop``: drive a scenario over ROS 2, record it and report it."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from iptm.runner.comparison import NO_COMPARISON
from iptm.runner.runner import PROGRAM, RunOptions, run
from iptm.runner.scenario import NODES, Scenario, prepare
from iptm.runner.scenario_files import (
    DEFAULT_SCENARIO,
    load_scenario,
    shipped_scenarios,
    with_node_parameters,
)
from iptm.runner.tables import TABLES_WIDTH
from iptm_controller.strategy import STRATEGIES
from iptm_core.declaration import parameter_specs, plain
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.program import EXIT_OK, refused
from iptm_core.settings import LoopMode
from iptm_core.user_input import nearest

WATCHING_RATE = 10.0
"""Seconds of trip time per second of wall time when someone watches: WLTC class 3b in three minutes."""
_DESCRIPTION = """\
Starts plant, V2X bridge, controller and recorder as processes of their own, drives one scenario, and ends
with a summary, a picture and results.json next to the bag.
"""
_EPILOG = """\
exit code: 0 when the trip was finished, no hard limit was broken and the bag is complete and equal to
the received messages; 1 when not; 2 for a mistake in scenario or options; 130 after Ctrl-C.
"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser; every field of a scenario is an option."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        usage=f"{PROGRAM} [scenario] [options]",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "scenario",
        nargs="?",
        default=DEFAULT_SCENARIO,
        help=f"one of {', '.join(shipped_scenarios())}, or a .yaml file (default: %(default)s)",
    )
    parser.add_argument("--list", action="store_true", help="list the shipped scenarios and end")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="folder to create, which becomes the bag (default: bags/<scenario>_<date>_<time>)",
    )
    parser.add_argument("--no-record", action="store_true", help="do not record a bag")
    parser.add_argument(
        "--view",
        action="store_true",
        help="show the run in the browser while it takes place; without another --mode it then follows the "
        f"wall clock, {WATCHING_RATE:g} times as fast (--rate-factor)",
    )
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        choices=list(NODES),
        help="do not start this node, but wait for one that you start in the same ROS domain; repeatable. "
        "Figures are computed from what it publishes",
    )
    parser.add_argument(
        "--wait-for",
        action="append",
        default=[],
        metavar="NODE",
        help="a further node, such as /car_2/v2x_sender, that must hear the others, and they it, before the "
        "trip begins; repeatable",
    )
    parser.add_argument("--no-picture", action="store_true", help="do not draw a picture")
    parser.add_argument(
        "--report", action="store_true", help="write the run as one HTML page, too: report.html"
    )
    parser.add_argument(
        "--full", action="store_true", help="print the tables of all figures before the summary"
    )
    parser.add_argument(
        "--compression",
        choices=["none", "lz4", "zstd"],
        default="none",
        help="of the bag (default: %(default)s)",
    )
    parser.add_argument(
        "--against",
        choices=[NO_COMPARISON, *STRATEGIES],
        default=NO_COMPARISON,
        help="drive the same trip with this strategy, too, without ROS, and compare "
        "(default: %(default)s; of scripts/run_demo: reference)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NODE.NAME=VALUE",
        help="a parameter of plant, v2x_bridge or controller, e.g. controller.deadline_ms=50; repeatable",
    )
    fields = parser.add_argument_group("fields of the scenario")
    for spec in parameter_specs(Scenario):
        allowed = "" if spec.allowed == "a text" else f"; {spec.allowed}"
        description = f"{spec.description}{allowed} (default: {plain(spec.default)!r})"
        fields.add_argument(
            f"--{spec.name.replace('_', '-')}",
            dest=f"field_{spec.name}",
            metavar="VALUE",
            help=description.replace("%", "%%"),
        )
    return parser


def parsed_options(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the parsed command line.

    Raises:
        ScenarioError: an option is unknown.
    """
    parser = build_parser()
    parsed, unknown = parser.parse_known_args(arguments)
    if unknown:
        name = unknown[0].partition("=")[0]
        near = nearest(name, re.findall(r"--[a-z][a-z0-9-]+", parser.format_help()))
        hint = f"did you mean {near}?" if near else "allowed: those of --help"
        raise ScenarioError(f"argument {name} is unknown; {hint}")
    return parsed


def chosen_scenario(arguments: argparse.Namespace) -> Scenario:
    """Return the scenario that the arguments describe.

    Raises:
        ScenarioError: an argument or the scenario file is wrong.
    """
    given = {
        spec.name: getattr(arguments, f"field_{spec.name}") for spec in parameter_specs(Scenario)
    }
    options = {name: text for name, text in given.items() if text is not None}
    if arguments.view:
        options = watchable(arguments.scenario, options)
    scenario = load_scenario(arguments.scenario, options)
    extra = with_node_parameters(scenario, arguments.set)
    return prepare(replace(scenario, node_parameters=extra))


def watchable(scenario: str, options: Mapping[str, str]) -> dict[str, str]:
    """Return options with a pace that can be watched, where neither they nor the scenario state one."""
    is_chosen = "mode" in options or load_scenario(scenario).mode is LoopMode.REAL_TIME
    pace = {"mode": str(LoopMode.REAL_TIME), "rate_factor": f"{WATCHING_RATE:g}"}
    return dict(options) if is_chosen else {**pace, **options}


def list_scenarios(console: Console) -> None:
    """Print name and description of the shipped scenarios."""
    for name in shipped_scenarios():
        description = load_scenario(name).description
        console.print(f"[bold]{name:<18}[/] {description}", highlight=False, soft_wrap=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive a scenario.

    Returns:
        Exit code of the process, see the epilog of ``--help``.
    """
    try:
        parsed = parsed_options(arguments)
    except ScenarioError as error:
        return refused(PROGRAM, error)
    # A pipe has no width of its own.
    console = Console(width=None if sys.stdout.isatty() else TABLES_WIDTH)
    if parsed.list:
        list_scenarios(console)
        return EXIT_OK
    try:
        scenario = replace(chosen_scenario(parsed), foreign=frozenset(parsed.without))
        if parsed.without and scenario.faults:
            raise ScenarioError(
                f"--without is {parsed.without[0]} for a scenario with faults; allowed: without faults"
            )
        options = RunOptions(
            output=parsed.output,
            record=not parsed.no_record,
            picture=not parsed.no_picture,
            report=parsed.report,
            compression=parsed.compression,
            against=parsed.against,
            view=parsed.view,
            full=parsed.full,
            wait_for=tuple(parsed.wait_for),
        )
        return run(scenario, options, console)
    except IptmError as error:
        return refused(PROGRAM, error)


if __name__ == "__main__":
    sys.exit(main())
