"""The command ``traffic``: drive the ego vehicle through simulated traffic and report it."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import STRATEGIES
from iptm_core.declaration import parameter_specs
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.metrics.figures import FIGURES, TRIP_FIGURES, figure_values
from iptm_core.metrics.saving import judge_saving
from iptm_core.parameters import DEFAULT_SET, ModelParameters, load_parameters
from iptm_core.program import EXIT_OK, refused
from iptm_core.user_input import number
from iptm_traffic.demand import DemandSettings, TrafficScenario
from iptm_traffic.own_network import DEPART_S, OwnNetwork
from iptm_traffic.trip import PredictionInput, TrafficDrive

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from iptm_traffic.drive import TrafficResult
    from iptm_traffic.world import SumoWorld

PROGRAM = "traffic"
OVER_ROS = "iptm_traffic.node_drive"
"""A program of its own, so that all the rest does without ROS."""
EXIT_NOT_GOOD = 1
NO_COMPARISON = "none"
TABLES_WIDTH = 110
LARGEST_DEVIATION_M = 1e-3
_EPILOG = """\
exit code: 0; 1 when a closed line was passed, the ego vehicle has met another car or a person, or plant and
SUMO do not agree about the ego vehicle to a millimetre; 2 for a mistake in the options, or without SUMO.
"""


def traffic_rows(world: SumoWorld) -> dict[str, str]:
    """Return rows of every table: what happened in the traffic."""
    return {
        "Smallest gap less s_min, cars that move in left out (m)": f"{world.smallest_margin_m:.2f}",
        "Stop lines passed": f"{len(world.lines)}",
        "Stop lines passed while closed": f"{world.lines_passed_closed}",
        "Cars ahead, one after the other": f"{len(world.leaders)}",
        "Messages sent around the ego vehicle": f"{world.radio.sent}",
        "Collisions of the ego vehicle": f"{len(world.simulation.collisions)}",
        "Largest deviation of plant and SUMO (m)": f"{world.simulation.ego.largest_deviation_m:.1e}",
    }


def build_parser() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description=__doc__,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--scenario",
        choices=[str(entry) for entry in TrafficScenario],
        default=str(TrafficScenario.FOLLOWING),
        help="what happens around the ego vehicle (default: %(default)s)",
    )
    parser.add_argument(
        "--prediction",
        choices=[str(entry) for entry in PredictionInput],
        default=str(PredictionInput.SIGNALS),
        help="input of the leader's prediction: its announced path, its past motion, or its past motion "
        "within signal phases and speed limits (default: %(default)s)",
    )
    parser.add_argument(
        "--signals-by-radio",
        action="store_true",
        help="the ego vehicle learns signals and speed limits from the messages of roadside stations only, "
        "and none are given (needs requirements/roadside.txt)",
    )
    parser.add_argument(
        "--duration-s", type=number, default=600.0, help="length of the trip (default: 600)"
    )
    parser.add_argument(
        "--step-s",
        type=number,
        default=TrafficDrive.step_s,
        help="step of SUMO, also the period of the messages; a part of a second (default: %(default)s)",
    )
    parser.add_argument(
        "--strategy",
        choices=list(STRATEGIES),
        default=ControllerSettings.strategy,
        help="the controller's (default: %(default)s)",
    )
    parser.add_argument(
        "--against",
        choices=[NO_COMPARISON, *STRATEGIES],
        default="reference",
        help="drive in the same traffic with this strategy, too, and compare (default: %(default)s)",
    )
    parser.add_argument("--parameter-set", default=DEFAULT_SET, help="of the model")
    parser.add_argument("--output", type=Path, metavar="FILE.csv", help="write the trajectory")
    parser.add_argument(
        "--fcd",
        type=Path,
        metavar="FILE.xml",
        help="write what all vehicles do, as SUMO's floating car data; FILE.xml#VEHICLE is a driving cycle",
    )
    parser.add_argument(
        "--bag",
        type=Path,
        metavar="DIR",
        help="drive over ROS 2 instead: plant, bridge, controller and recorder as processes of their own, "
        "the messages over UDP; the folder becomes the bag (nothing is compared, no trajectory is written)",
    )
    own = parser.add_argument_group("own network")
    own.add_argument(
        "--net",
        type=Path,
        metavar="FILE",
        help="drive in this network instead: SUMO's .net.xml or .sumocfg, or what netconvert makes one of, "
        ".netccfg or .osm",
    )
    own.add_argument(
        "--routes",
        type=Path,
        metavar="FILE",
        action="append",
        default=[],
        help="its vehicles and persons, SUMO's .rou.xml; may be given again",
    )
    own.add_argument(
        "--ego",
        metavar="NAME",
        default="",
        help="the vehicle of the routes whose place the ego vehicle takes",
    )
    own.add_argument(
        "--ego-route",
        metavar="EDGE,EDGE,...",
        default="",
        help="or the ego vehicle's way: its edges, or some of them with the shortest ways between",
    )
    own.add_argument(
        "--ego-depart-s",
        type=number,
        default=DEPART_S,
        help="when the ego vehicle departs on --ego-route, s of SUMO's time (default: %(default)g)",
    )
    traffic = parser.add_argument_group("traffic")
    for spec in parameter_specs(DemandSettings):
        traffic.add_argument(
            f"--{spec.name.replace('_', '-')}",
            type=type(spec.default),
            default=spec.default,
            help=f"{spec.description}; {spec.allowed} (default: {spec.default})",
        )
    return parser


def drive_from(arguments: argparse.Namespace) -> TrafficDrive:
    """Return the drive that the arguments describe.

    Raises:
        IptmError: one of them is out of range.
    """
    own = None
    if arguments.net is not None:
        if arguments.bag is not None:
            raise ScenarioError("--bag is given with --net; allowed: --net without ROS 2")
        own = OwnNetwork(
            arguments.net,
            tuple(arguments.routes),
            arguments.ego,
            tuple(edge.strip() for edge in arguments.ego_route.split(",") if edge.strip()),
            arguments.ego_depart_s,
        )
    elif arguments.routes or arguments.ego or arguments.ego_route:
        raise ScenarioError("--routes and --ego are given without --net; allowed: with it")
    given = {spec.name: getattr(arguments, spec.name) for spec in parameter_specs(DemandSettings)}
    return TrafficDrive(
        TrafficScenario(arguments.scenario),
        PredictionInput(arguments.prediction),
        arguments.duration_s,
        arguments.strategy,
        DemandSettings(**given),
        arguments.step_s,
        arguments.signals_by_radio,
        own,
    )


def results_table(result: TrafficResult, other: TrafficResult | None) -> Table:
    """Return the figures of a drive, compared with another one in the same traffic."""
    from rich.table import Table  # noqa: PLC0415

    title = f"{result.drive.title}, {result.drive.knowledge} known"
    table = Table(title=title, title_justify="left")
    for head in ("figure", result.drive.strategy):
        table.add_column(head, justify="left" if head == "figure" else "right")
    runs = [result] if other is None else [result, other]
    if other is not None:
        table.add_column(other.drive.strategy, justify="right")
    values = [figure_values(run.metrics) for run in runs]
    for key in TRIP_FIGURES:
        figure = FIGURES[key]
        table.add_row(figure.title, *(figure.precise_text(value.get(key)) for value in values))
    table.add_section()
    rows = [
        {
            "Largest excess over the speed limit (m/s)": f"{run.largest_excess_m_s:.2f}",
            "Ticks without a solution to follow": f"{run.fallback_ticks}",
            **traffic_rows(run.world),
            "Times real time": f"{run.times_real_time:.0f}",
            "Times real time, by processor time": f"{run.times_processor_time:.0f}",
            "Digest": f"{run.digest:.12}",
        }
        for run in runs
    ]
    for label in rows[0]:
        table.add_row(label, *(row[label] for row in rows))
    return table


def headline(result: TrafficResult, other: TrafficResult, parameters: ModelParameters) -> str:
    """Return one line on what a drive saves against another one."""
    found = judge_saving(result.metrics, other.metrics, parameters)
    return f"against the {other.drive.strategy} in the same traffic: {found.headline}"


def verdict(world: SumoWorld) -> list[str]:
    """Return the violated requirements."""
    wrong = []
    if world.lines_passed_closed:
        wrong.append(f"{world.lines_passed_closed} stop lines were passed while closed")
    wrong += [f"collision: {text}" for text in world.simulation.collisions]
    if world.smallest_gap_m <= 0.0:
        wrong.append(f"the smallest gap is {world.smallest_gap_m:.2f} m")
    deviation_m = world.simulation.ego.largest_deviation_m
    if deviation_m > LARGEST_DEVIATION_M:
        wrong.append(f"plant and SUMO are {deviation_m:.4f} m apart")
    return wrong


def judged(world: SumoWorld, console: Console) -> int:
    """Print the violated requirements and return the exit code."""
    wrong = verdict(world)
    for line in wrong:
        console.print(f"PROBLEM  {line}", style="bold red")
    return EXIT_NOT_GOOD if wrong else EXIT_OK


def write_trajectory(result: TrafficResult, file: Path) -> None:
    """Write a trajectory as CSV, with units in the column names.

    Raises:
        ScenarioError: the file cannot be written.
    """
    columns = result.trajectory.to_arrays()
    try:
        np.savetxt(
            file,
            np.column_stack(list(columns.values())),
            "%.17g",
            ",",
            header=",".join(columns),
            comments="",
        )
    except OSError as reason:
        raise ScenarioError(f"--output {file} cannot be written: {reason}") from reason


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive; see the module."""
    parsed = build_parser().parse_args(arguments)
    if parsed.bag is not None:
        given = sys.argv[1:] if arguments is None else arguments
        os.execv(sys.executable, [sys.executable, "-m", OVER_ROS, *given])  # noqa: S606
    from rich.console import Console  # noqa: PLC0415  a third of a second of imports, not for --help

    from iptm_traffic.drive import drive_in_traffic  # noqa: PLC0415

    console = Console(width=None if sys.stdout.isatty() else TABLES_WIDTH)
    try:
        drive = drive_from(parsed)
        parameters = load_parameters(parsed.parameter_set).values
        result = drive_in_traffic(drive, parameters, parsed.fcd)
        other = None
        if parsed.against not in {NO_COMPARISON, drive.strategy}:
            other = drive_in_traffic(replace(drive, strategy=parsed.against), parameters)
        if parsed.output is not None:
            write_trajectory(result, parsed.output)
    except IptmError as error:
        return refused(PROGRAM, error)
    if other is not None:
        console.print(headline(result, other, parameters), style="bold green")
    console.print(results_table(result, other))
    return judged(result.world, console)


if __name__ == "__main__":
    sys.exit(main())
