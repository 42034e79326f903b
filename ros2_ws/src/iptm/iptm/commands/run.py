"""Drive a trip over ROS 2 or in memory, record it and report it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from iptm.commands.tree import all_commands
from iptm_core.declaration import plain
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.extras import offered
from iptm_core.program import EXIT_OK, refused
from iptm_core.user_input import check_known, nearest, one_of

if TYPE_CHECKING:
    from rich.console import Console

    from iptm.trip import Trip

PROGRAM = "iptm run"
DEFAULT_TRIP = "wltc"
NO_COMPARISON = "none"
BENCH = "bench"
"""The command that drives a car on a bus, of an extra."""
NODES = ("plant", "v2x_bridge", "controller")
WATCHING_RATE = 10.0
"""Seconds of trip time per second of wall time when someone watches: WLTC class 3b in three minutes."""
_DESCRIPTION = """\
Drives a trip with the nodes plant, V2X bridge, controller and recorder, and ends with a summary, a picture
and results.json next to the bag.
"""
_EPILOG = """\
Every setting of a trip is GROUP.NAME, with a group of road, leader, vehicle, controller, conditions:
--set leader.latency_s=0.5, --set controller.deadline_ms=50. All of them: iptm run --settings.

exit code: 0 when the trip was finished, no hard limit was broken and the bag is complete and equal to
the received messages; 1 when not; 2 for a mistake in trip or options; 130 after Ctrl-C.
"""
SHORT = {
    "cycle": "what the leader drives: a cycle, or the path of a drive",
    "slope": "slope of the road: a shape, or the path of a track",
    "duration_s": "length of the trip, 0 for the whole cycle",
    "parameter_set": "vehicle: a shipped parameter set, or the path of a .yaml file",
    "overrides": "single parameters of it: 'body.mass_kg=1600, gap.max_gap_m=80'",
    "strategy": "cost terms and weights of the controller",
    "horizon": "prediction grid, such as 3x1+5x5",
    "mode": "lock_step, or real_time on the wall clock",
    "rate_factor": "real_time: seconds of trip time per second of wall time",
    "namespace": "of all nodes, such as car_1",
    "domain": "ROS domain; -1 takes ROS_DOMAIN_ID or a free one",
}
"""Settings with an option of their own."""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        usage=f"{PROGRAM} [TRIP] [options]",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add_trip(parser)
    add = parser.add_argument
    add("--list", action="store_true", help="list the shipped trips and end")
    add("--settings", nargs="?", const="", metavar="GROUP", help="list the settings and end")
    add("--output", type=Path, metavar="DIR", help="folder to create, which becomes the bag")
    add("--no-record", action="store_true", help="do not record a bag")
    add("--no-picture", action="store_true", help="do not draw a picture")
    add("--report", action="store_true", help="write the run as one HTML page, too: report.html")
    add("--full", action="store_true", help="print the tables of all figures before the summary")
    add("--compression", choices=["none", "lz4", "zstd"], default="none", help="of the bag")
    add(
        "--view",
        action="store_true",
        help=f"show the run in the browser; in lock-step at most {WATCHING_RATE:g} times real time",
    )
    add(
        "--processes",
        action="store_true",
        help="a process for each node, as in real time (slower)",
    )
    add(
        "--without",
        action="append",
        default=[],
        type=one_of(NODES),
        metavar="NODE",
        help=f"do not start this node ({', '.join(NODES)}), but wait for yours in the same ROS domain;"
        " repeatable",
    )
    add(
        "--wait-for",
        action="append",
        default=[],
        metavar="NODE",
        help="a further node, such as /car_2/v2x_sender, to connect before the trip begins; repeatable",
    )
    add(
        "--against",
        default=NO_COMPARISON,
        metavar="STRATEGY",
        help="drive the same trip with this strategy in memory, too, and compare (default: none)",
    )
    add("--vehicles", metavar="N", help="drive a string of vehicles, each following the one ahead")
    add(
        "--vehicle",
        metavar="NAME",
        help="drive a car on a bus in real time instead of the simulated plant: bench, or a folder with "
        "vehicle.yaml (see iptm bench --help)",
    )
    add("--over", choices=["ros", "memory"], default="ros", help="(default: %(default)s)")
    return parser


def add_trip(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that describe a trip."""
    parser.add_argument(
        "trip",
        nargs="?",
        default=DEFAULT_TRIP,
        metavar="TRIP",
        help="a shipped trip (--list), or a .yaml file (default: %(default)s)",
    )
    for name, text in SHORT.items():
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(option, dest=f"setting_{name}", metavar="VALUE", help=text)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="GROUP.NAME=VALUE",
        help="any setting of the trip; repeatable",
    )


def parsed_options(
    parser: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> argparse.Namespace:
    """Return the parsed command line.

    Raises:
        ScenarioError: an option is unknown.
    """
    parsed, unknown = parser.parse_known_args(arguments)
    if unknown:
        from iptm.trip_settings import HOME  # noqa: PLC0415  only for the hint

        name = unknown[0].partition("=")[0]
        setting = name.removeprefix("--").replace("-", "_")
        if setting in HOME:
            raise ScenarioError(
                f"argument {name} is unknown; allowed: --set {HOME[setting]}.{setting}=VALUE"
            )
        options = [each for action in parser._actions for each in action.option_strings]  # noqa: SLF001
        near = nearest(name, options)
        hint = f"did you mean {near}?" if near else "allowed: those of --help"
        raise ScenarioError(f"argument {name} is unknown; {hint}")
    return parsed


def chosen_trip(parsed: argparse.Namespace, *, watched: bool = False) -> Trip:
    """Return the trip that the arguments describe, one that is watched with a pace for it.

    Raises:
        ScenarioError: an argument or the file of the trip is wrong.
    """
    from iptm.trip_files import assigned, load_trip  # noqa: PLC0415

    given = {name: getattr(parsed, f"setting_{name}") for name in SHORT}
    options = {name: text for name, text in given.items() if text is not None}
    options |= assigned(parsed.set)
    return load_trip(parsed.trip, watchable(parsed.trip, options) if watched else options)


def watchable(trip: str, options: Mapping[str, str]) -> dict[str, str]:
    """Return options with a pace that can be watched, where neither they nor the trip state one."""
    from iptm.trip_files import load_trip  # noqa: PLC0415

    if "mode" in options or not load_trip(trip).is_lock_step:
        return dict(options)
    if "rate_factor" in options:
        return {"mode": "real_time", **options}
    return {"pace": f"{WATCHING_RATE:g}", **options}


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive a trip.

    Returns:
        Exit code of the process, see the epilog of ``--help``.
    """
    try:
        parsed = parsed_options(build_parser(), arguments)
        return _run(parsed)
    except IptmError as error:
        return refused(PROGRAM, error)


def _run(parsed: argparse.Namespace) -> int:
    from rich.console import Console  # noqa: PLC0415

    # A pipe has no width of its own.
    console = Console(width=None if sys.stdout.isatty() else 124)
    if parsed.list:
        _list_trips(console)
        return EXIT_OK
    if parsed.settings is not None:
        _list_settings(parsed.settings)
        return EXIT_OK
    trip: Trip = chosen_trip(parsed, watched=parsed.view and parsed.vehicles is None)
    trip = trip.changed(foreign=frozenset(parsed.without))
    if parsed.without and trip.conditions.faults:
        raise ScenarioError(
            f"--without is {parsed.without[0]} for a trip with faults; allowed: without faults"
        )
    if parsed.vehicle is not None:
        return _run_vehicle(trip, parsed)
    if parsed.over == "memory":
        return _run_in_memory(trip, parsed, console)
    from iptm.runner.runner import RunOptions, check_over_ros, run  # noqa: PLC0415

    options = RunOptions(
        output=parsed.output,
        record=not parsed.no_record,
        picture=not parsed.no_picture,
        report=parsed.report,
        compression=parsed.compression,
        against=parsed.against,
        view=parsed.view,
        full=parsed.full,
        processes=parsed.processes,
        wait_for=tuple(parsed.wait_for),
    )
    if parsed.vehicles is not None:
        strings = offered("strings")
        if not strings:
            raise ScenarioError(
                f"--vehicles is {parsed.vehicles}; allowed: where strings are installed (an extra)"
            )
        count = strings[0].vehicle_count(parsed.vehicles, "--vehicles")
        return int(strings[0].run_string(trip, count, options, console))
    return run(check_over_ros(trip), options, console)


def _run_vehicle(trip: Trip, parsed: argparse.Namespace) -> int:
    """Drive a car on a bus with the cycle, length and strategy of the trip.

    Raises:
        ScenarioError: an option does not fit, or the extra with the bench is not installed.
    """
    bench = all_commands().get(BENCH)
    if bench is None:
        raise ScenarioError(
            f"--vehicle is {parsed.vehicle}; allowed: where the command {BENCH} is installed (an extra)"
        )
    for name in ("view", "without", "report", "vehicles", "full", "processes"):
        if getattr(parsed, name):
            raise ScenarioError(f"--{name} is given with --vehicle; allowed: --output")
    given = [
        f"--vehicle={parsed.vehicle}",
        f"--cycle={trip.road.cycle}",
        f"--duration-s={trip.route.duration_s}",
        f"--strategy={trip.controller.strategy}",
        *([f"--output={parsed.output}"] if parsed.output else []),
    ]
    return bench.load()(given) or EXIT_OK


def _run_in_memory(trip: Trip, parsed: argparse.Namespace, console: Console) -> int:
    """Drive a trip in memory and print its summary."""
    from iptm.driving import drive_in_memory  # noqa: PLC0415
    from iptm.runner.summary import headline  # noqa: PLC0415

    for name in ("view", "without", "output", "report", "vehicles", "processes"):
        if getattr(parsed, name):
            raise ScenarioError(f"--{name} is given with --over memory; allowed: over ros")
    run = drive_in_memory(trip)
    if parsed.against != NO_COMPARISON:
        run = replace(run, other=drive_in_memory(trip.against(parsed.against)))
    console.print(run.name, style="bold", highlight=False, soft_wrap=True)
    for label, text in headline(run).lines:
        console.print(f"{label:<14} {text}", highlight=False, soft_wrap=True)
    return EXIT_OK


def _list_trips(console: Console) -> None:
    from iptm.trip_files import load_trip, shipped_trips  # noqa: PLC0415

    for name in shipped_trips():
        description = load_trip(name).description
        console.print(f"[bold]{name:<18}[/] {description}", highlight=False, soft_wrap=True)


def _list_settings(group: str) -> None:
    from iptm.trip_settings import GROUPS, HOME, SPECS  # noqa: PLC0415

    if group:
        check_known(group, GROUPS, "--settings", "group", ScenarioError)
    for name, spec in SPECS.items():
        if group in {"", HOME[name]}:
            allowed = "" if spec.allowed == "a text" else f"; {spec.allowed}"
            print(f"{HOME[name]}.{name}={plain(spec.default)}\n    {spec.description}{allowed}")


if __name__ == "__main__":
    sys.exit(main())
