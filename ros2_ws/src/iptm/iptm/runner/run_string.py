"""The command ``run_string``: drive a string of vehicles over ROS 2, record each, and report the string."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm.bags import load
from iptm.run import Run
from iptm.runner.comparison import NO_COMPARISON, controller_for, headless_run, plant_for
from iptm.runner.environment import domain_of_run
from iptm.runner.run_closed_loop import chosen_scenario, parsed_options
from iptm.runner.run_folder import LOGS, RunFolder
from iptm.runner.runner import EXIT_RUN_FAILED
from iptm.runner.scenario import Scenario
from iptm.runner.string_run import complaint, drive_string, results_in
from iptm.runner.tables import TABLES_WIDTH
from iptm.runner.viewer import live_view
from iptm.string_report import save_string_picture, string_parts
from iptm.vehicle_string import run_string
from iptm_controller.horizon import SINGLE_HORIZON
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.markdown import cells_of
from iptm_core.program import EXIT_OK, EXIT_SIGNAL, EXIT_USER_ERROR, print_error, refused
from iptm_core.settings import VEHICLE_LENGTH_M, PreviewSettings
from iptm_core.vehicle_string import (
    MAX_VEHICLES,
    vehicle_count,
    vehicle_length_m,
    vehicles_in_string,
)
from iptm_ros.process import StopRequest

PROGRAM = "run_string"
PICTURE = "string.png"
_DESCRIPTION = """\
Drives a string of vehicles in lock-step, each with its own nodes, clock, frames and bag: car_1 follows the
driving cycle, every other vehicle follows the one before, whose plan of a tick is the preview of that tick.
Ends with tables, and with a picture next to the bags.
"""
_EPILOG = """\
All other arguments are those of scripts/run_demo (see its --help) and hold for every vehicle, for example

  scripts/run_string --vehicles 3 --cycle us06 --slope large

exit code: 0 when all trips were finished, no hard limit was broken and all bags are complete; 1 when not;
2 for a mistake in scenario or options; 130 after Ctrl-C.
"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of what a string has beyond the run of one vehicle."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        usage=f"{PROGRAM} [scenario] [options]",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--vehicles", default="5", metavar="N", help=f"2 to {MAX_VEHICLES} (default: %(default)s)"
    )
    parser.add_argument(
        "--vehicle-length-m",
        default=str(VEHICLE_LENGTH_M),
        metavar="LENGTH",
        help="of every vehicle, front to rear bumper (default: %(default)s)",
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="folder to create, with a bag for each vehicle (default: bags/string_<date>_<time>)",
    )
    parser.add_argument(
        "--against",
        choices=[NO_COMPARISON, *STRATEGIES],
        default=NO_COMPARISON,
        help="drive a string of vehicles with this strategy, too, without ROS, and compare place by place "
        "(default: %(default)s; of scripts/run_string: reference)",
    )
    parser.add_argument(
        "--view",
        action="store_true",
        help="show the vehicles in the browser while they drive, one at a time",
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive a string.

    Returns:
        Exit code of the process, see the epilog of ``--help``.
    """
    parsed, rest = build_parser().parse_known_args(arguments)
    console = Console(width=None if sys.stdout.isatty() else TABLES_WIDTH)
    try:
        return _run(parsed, rest, console)
    except IptmError as error:
        return refused(PROGRAM, error)


def _run(parsed: argparse.Namespace, rest: list[str], console: Console) -> int:
    count = vehicle_count(parsed.vehicles, "--vehicles")
    length_m = vehicle_length_m(parsed.vehicle_length_m, "--vehicle-length-m")
    scenario = _scenario(rest)
    stop = StopRequest()
    stop.install()
    gap_m = scenario.vehicle.values.gap.initial_gap_m
    vehicles = vehicles_in_string(count, gap_m, length_m, scenario.namespace)
    with ExitStack() as stack:
        asked, own = scenario.domain, scenario.full_namespace
        domain = stack.enter_context(domain_of_run(asked, own))
        output = RunFolder.of_run(parsed.output, "string").output
        heading = f"{count} vehicles; to watch: export ROS_DOMAIN_ID={domain.number}"
        console.print(heading, highlight=False)
        bags = {vehicle.namespace: output / vehicle.name for vehicle in vehicles}
        stay_open = None
        if parsed.view:
            view = live_view(scenario, domain.number, output / LOGS, bags, console)
            stay_open = stack.enter_context(view)
        ends = drive_string(vehicles, rest, length_m, output, domain.number, stop, console)
        if stop.number is not None:
            return EXIT_SIGNAL + int(stop.number)
        results = [results_in(bag) for bag in bags.values()]
        complaints = [complaint(*one) for one in zip(ends, results, strict=True)]
        for end, text in zip(ends, complaints, strict=True):
            if text:
                print_error(PROGRAM, f"{end.name}: {text}")
        code = EXIT_RUN_FAILED if any(complaints) else EXIT_OK
        if all(results):
            runs = [load(bag, namespace) for namespace, bag in bags.items()]
            wall_time_s = max(float(each["wall_time_s"]) for each in results)
            with console.status("driving the strings to compare with ..."):
                others = _headless_string(scenario, count, length_m, parsed.against)
            save_string_picture(output / PICTURE, runs)
            for part in string_parts(runs, others):
                table = Table(*(head.removesuffix(":") for head in part.columns))
                for cells in cells_of(part.rows, part.columns):
                    table.add_row(*cells)
                console.print(table)
            pace = scenario.trip.duration_s / wall_time_s
            console.print(
                f"{count} vehicles, {wall_time_s:.1f} s: {pace:.1f} × real time", highlight=False
            )
            console.print(str(output), highlight=False, soft_wrap=True)
        else:
            code = EXIT_USER_ERROR if EXIT_USER_ERROR in {end.code for end in ends} else code
            print(f"logs: {output / LOGS}", file=sys.stderr)
        if stay_open is not None:
            stay_open(stop)
        return code


def _scenario(rest: list[str]) -> Scenario:
    """Return the scenario of every vehicle.

    Raises:
        ScenarioError: it is none, or nothing for a string.
    """
    options = parsed_options(rest)
    unfit = [name for name in ("list", "no_record", "without") if getattr(options, name)]
    if unfit:
        option = unfit[0].replace("_", "-")
        raise ScenarioError(f"--{option} is given for a string; allowed: with one vehicle")
    scenario = chosen_scenario(options)
    if not scenario.is_lock_step:
        raise ScenarioError("mode is real_time; allowed in a string: lock_step")
    return scenario


def _headless_string(scenario: Scenario, count: int, length_m: float, strategy: str) -> list[Run]:
    """Drive the string of another strategy to compare with; empty for none."""
    if strategy == NO_COMPARISON:
        return []
    string = run_string(
        scenario.trip,
        count,
        plant_for(scenario),
        lambda: controller_for(scenario, strategy, SINGLE_HORIZON),
        PreviewSettings.of(scenario),
        length_m,
    )
    return [headless_run(scenario, strategy, each) for each in string]


if __name__ == "__main__":
    sys.exit(main())
