"""One run with everything around it: folder, domain, processes, results, picture, exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import yaml
from rich.console import Console
from rich.text import Text

from iptm.runner.composition import (
    INJECTOR,
    MODULES,
    RECORDER,
    SHARED,
    grouped,
    node_command,
    node_parameters,
    parameter_file_text,
    recorder_arguments,
    run_information,
    shared_command,
    trip_members,
    vehicle_arguments,
)
from iptm.runner.drive import DriveOutcome, DriveResult, NodeDrive
from iptm.runner.fork import Companion, draw, prepare
from iptm.runner.fork import drive as reference
from iptm.runner.process_faults import ProcessFaults, unclean_ends
from iptm.runner.progress import PROGRAM, ConsoleProgress, Progress
from iptm.runner.run_folder import RunFolder
from iptm.runner.supervisor import (
    INTERRUPT_PATIENCE_S,
    RunDomain,
    Supervisor,
    domain_of_run,
    environment_of_run,
    process_environment,
)
from iptm.trip import NO_COMPARISON, Trip
from iptm.trip_files import trip_text
from iptm.trip_settings import NODES
from iptm_core.errors import DriveError, IptmError, ScenarioError
from iptm_core.program import (
    EXIT_OK,
    EXIT_SIGNAL,
    EXIT_USER_ERROR,
    LOWEST_PRIORITY,
    StopRequest,
    print_error,
)
from iptm_plant_sim.plant_kinds import plant_topics
from iptm_ros.discovery import for_vehicles
from iptm_ros.recording.run_information import collect_run_information
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT

if TYPE_CHECKING:
    from rclpy.context import Context

    from iptm.run import Run
    from iptm.runner.monitor import RunMonitor

EXIT_RUN_FAILED = 1
LOOK_AROUND_S = 2.0
"""Time to find another run in a domain that the user chose; the controller takes as long to start."""

MOST_PATIENCE_S = 100.0
"""For which processes of a string may take to end on a busy machine."""
_WITHOUT_PLANT = (BRIDGE, CONTROLLER, INJECTOR, RECORDER)


@dataclass(frozen=True)
class RunOptions:
    """Options of the user in addition to the trip.

    Attributes:
        output: folder to create; None for a new one under ``bags/``.
        record: whether to record a bag.
        picture: whether to draw the run.
        report: whether to write it as an HTML page.
        compression: of the bag: none, lz4 or zstd.
        against: strategy to compare with, driven without ROS after the run; "none" for no comparison.
        view: whether to show it in the browser while it takes place.
        full: whether to print the tables of all figures.
        processes: whether plant, bridge and controller are processes of their own in lock-step, too.
        wait_for: full names of further nodes that must hear the others before the trip begins.
    """

    output: Path | None = None
    record: bool = True
    picture: bool = True
    report: bool = False
    compression: str = "none"
    against: str = NO_COMPARISON
    view: bool = False
    full: bool = False
    processes: bool = False
    wait_for: tuple[str, ...] = ()

    def shares_process(self, trip: Trip) -> bool:
        """Return whether the nodes of a vehicle share a process, which takes less time.

        Apart, they keep the pace of real time better, and a fault or a user can replace one of them.
        """
        return trip.is_lock_step and not (self.processes or trip.foreign or trip.conditions.faults)


def run(trip: Trip, options: RunOptions, console: Console) -> int:
    """Drive, record and report a trip.

    Returns:
        0 if the trip was finished, no hard limit was broken, and the bag is complete; 1 if not; 2 for a
        mistake of the user; 128 + n after signal n.

    Raises:
        ScenarioError: the output exists, or another run has the ROS domain.
    """
    stop = StopRequest()
    stop.install()
    with ExitStack() as stack:
        domain = stack.enter_context(domain_of_run(trip.conditions.domain, trip.full_namespace))
        folder = RunFolder.of_run(options.output, trip.name)
        console.print(_introduction(trip, domain.number), soft_wrap=True)
        stay_open = None
        if options.view:
            from iptm.runner.viewer import live_view  # noqa: PLC0415  few runs are watched

            bags = {trip.conditions.namespace: folder.output if options.record else None}
            view = live_view(trip, domain.number, folder.logs, bags, console, options.against)
            stay_open = stack.enter_context(view)
        progress = ConsoleProgress(console, trip.route.duration_s)
        # The reference would drive the plant of the suite, not the user's.
        is_compared = options.against != NO_COMPARISON and PLANT not in trip.foreign
        companion, painter = (
            stack.enter_context(Companion(folder.log_path(name), niceness))
            for name, niceness in (("companion", LOWEST_PRIORITY), ("painter", 0))
        )

        def begun() -> None:
            """Prepare for the end while the nodes drive."""
            if options.picture:
                painter.request(prepare)
            if is_compared:
                other = trip.against(options.against)
                companion.request(reference, other, folder.reference, trip.title)
            import iptm.runner.evaluation  # noqa: F401, PLC0415

        result, drive = drive_processes(
            folder, {folder: trip}, options, domain, progress, stop, begun, forks=True
        )
        if result.outcome is DriveOutcome.FINISHED:
            driven = (drive, result.wall_time_s)
            options = options if is_compared else replace(options, against=NO_COMPARISON)
            code = _report(folder, trip, options, driven, (companion, painter), console, stop)
        else:
            code = report_failure(result, folder, stop)
        if stay_open is not None and result.outcome is not DriveOutcome.REFUSED:
            stay_open(stop)
        return code


def drive_processes(
    folder: RunFolder,
    trips: Mapping[RunFolder, Trip],
    options: RunOptions,
    domain: RunDomain,
    progress: Progress,
    stop: StopRequest,
    begun: Callable[[], None] = lambda: None,
    *,
    forks: bool = False,
) -> tuple[DriveResult, NodeDrive]:
    """Start the processes of a trip or a string, watch it, and end them.

    Args:
        folder: takes the logs of the processes.
        trips: of the vehicles, the first one first, by the folders for their bags.
        begun: called when the trip has begun.
        forks: whether the processes may be copies of this one.
    """
    environment = environment_of_run(domain.number, folder.logs / "ros")
    if len(trips) > 1:
        environment |= for_vehicles(len(trips), folder.logs, environment)
    # One process closes the bags of all.
    patience_s = min(len(trips) * INTERRUPT_PATIENCE_S, MOST_PATIENCE_S)
    supervisor = Supervisor(environment, folder.log_path, patience_s, forks=forks)
    trip = next(iter(trips.values()))
    process_faults = ProcessFaults(supervisor, trip.conditions.faults)
    commands = _commands(trips, options)
    # A private domain has no other participants to look for.
    first = commands if domain.is_private else (CONTROLLER, RECORDER)
    early = {name: command for name, command in commands.items() if name in first}
    with ExitStack() as stack:
        stack.callback(supervisor.stop)
        stack.enter_context(process_environment(environment))  # it takes part in the graph itself
        for name, command in early.items():
            supervisor.start(name, command)
        # Loading ROS starts threads; and the nodes load it at the same time.
        from iptm.runner.monitor import RunMonitor  # noqa: PLC0415
        from iptm_ros.process import joined_nodes  # noqa: PLC0415

        def monitor(each: Trip, context: Context) -> RunMonitor:
            members = (*trip_members(each, recorder=options.record), *options.wait_for)
            return RunMonitor(each.full_namespace, context, each.foreign, members)

        monitors, executor = stack.enter_context(
            joined_nodes([partial(monitor, each) for each in trips.values()], domain.number)
        )
        plants = tuple(name for name in commands if name not in _WITHOUT_PLANT)
        drive = NodeDrive(
            supervisor, monitors, executor, progress, stop, process_faults, trip, plants
        )
        stack.enter_context(drive)
        drive.start(early)
        result = drive.look_around(0.0 if domain.is_private else LOOK_AROUND_S)
        if result.outcome is DriveOutcome.FINISHED:
            drive.start(commands)
            drive.expect(NODES)
            result = drive.run(begun)
        if result.outcome is not DriveOutcome.FINISHED:
            progress.failed(result.message)
    return result, drive


def _commands(trips: Mapping[RunFolder, Trip], options: RunOptions) -> dict[str, list[str]]:
    """Write the files that the processes need, and return the commands that start them."""
    parameters = {
        folder: {
            node: values
            for node, values in node_parameters(trip).items()
            if node not in trip.foreign
        }
        for folder, trip in trips.items()
    }
    paths = {
        folder: {
            node: folder.write_log(f"{node}_parameters.yaml", parameter_file_text(node, values))
            for node, values in nodes.items()
        }
        for folder, nodes in parameters.items()
    }
    folders, commands = list(trips), {}
    for group in grouped(folders, min(len(folders), len(os.sched_getaffinity(0)))):
        first, last = (trips[group[place]] for place in (0, -1))
        if len(folders) > 1 or options.shares_process(first):
            name = first.name if first is last else f"{first.name}_to_{last.name}"
            own = [
                vehicle_arguments(paths[each].values(), trips[each].full_namespace)
                for each in group
            ]
            commands[PLANT if len(folders) == 1 else name] = shared_command(SHARED, own)
        else:
            commands |= {
                node: node_command(node, path, first.full_namespace, first.conditions.faults)
                for node, path in paths[group[0]].items()
            }
    if options.record:
        recorders = []
        for folder, trip in trips.items():
            text = yaml.safe_dump(run_information(trip, parameters[folder]), sort_keys=False)
            path = folder.write_log("run_information.yaml", text)
            # As the user wrote it: the recorder's diagnostics name it, and they go into the bag.
            place, namespace = folder.given, trip.full_namespace
            given = (place, path, options.compression, namespace)
            also = plant_topics(trip.vehicle.plant)
            recorders.append(recorder_arguments(*given, repeats=not trip.foreign, also=also))
        commands[RECORDER] = shared_command(MODULES[RECORDER], recorders)
    return commands


def _report(
    folder: RunFolder,
    trip: Trip,
    options: RunOptions,
    driven: tuple[NodeDrive, float],
    companions: tuple[Companion, Companion],
    console: Console,
    stop: StopRequest,
) -> int:
    """Evaluate a finished trip, write its files and print its tables; a stop leaves out what is not ready."""
    from iptm.runner.evaluation import results_json  # noqa: PLC0415  see begun
    from iptm.runner.summary import print_end, print_results  # noqa: PLC0415

    drive, wall_time_s = driven
    companion, painter = companions
    try:
        run = evaluated(folder if options.record else None, trip, drive, wall_time_s)
        if options.against != NO_COMPARISON:
            with console.status(f"driving the same trip with strategy {options.against} ..."):
                run = replace(run, other=companion.answer(stop))
        if options.picture:
            painter.request(draw, folder.picture, run)
    except IptmError as error:
        unclean = unclean_ends(drive.supervisor, drive.process_faults)
        print_error(PROGRAM, "; ".join((str(error), *unclean)))
        return EXIT_RUN_FAILED
    folder.results.write_text(results_json(run, trip), encoding="utf-8")
    if options.report:
        run.report(folder.report, run.other)
    print_results(run, console, full=options.full)
    if options.picture:
        painter.answer(stop)
    print_end(run, folder, console)
    if stop.number is not None:
        print_error(PROGRAM, f"stopped by {stop.number.name}")
        return EXIT_SIGNAL + int(stop.number)
    return EXIT_RUN_FAILED if run.problems else EXIT_OK


def evaluated(
    bag: RunFolder | None, trip: Trip, drive: NodeDrive, wall_time_s: float, vehicle: int = 0
) -> Run:
    """Return the run of a finished trip, of a vehicle by its place in a string."""
    from iptm.runner.evaluation import evaluate  # noqa: PLC0415  see begun

    monitor = drive.monitors[vehicle]
    return evaluate(
        trip,
        monitor.recorded,
        None if bag is None else bag.output,
        collect_run_information(),
        wall_time_s,
        unclean_ends(drive.supervisor, drive.process_faults),
        tuple(monitor.warnings),
    )


def drive_over_ros(trip: Trip, bag: Path | None = None) -> Run:
    """Drive a trip with processes of its own and return the run; see `iptm.drive`.

    Args:
        trip: the trip to drive.
        bag: folder to create, with bag and logs; None to keep nothing.

    Raises:
        IptmError: the trip is not sound, the folder exists, or another run has the ROS domain.
        DriveError: the trip did not come to its end.
    """
    check_over_ros(trip)
    with ExitStack() as stack:
        domain = stack.enter_context(domain_of_run(trip.conditions.domain, trip.full_namespace))
        if bag is None:
            bag = Path(stack.enter_context(TemporaryDirectory())) / trip.name
        folder, options = RunFolder(bag), RunOptions(picture=False)
        trips, stop = {folder: trip}, StopRequest()
        result, drive = drive_processes(folder, trips, options, domain, Progress(), stop)
        if result.outcome is not DriveOutcome.FINISHED:
            raise DriveError("; ".join((result.message, *result.last_lines[-1:])))
        return evaluated(folder, trip, drive, result.wall_time_s)


def check_over_ros(trip: Trip) -> Trip:
    """Return a trip that nodes can drive.

    Raises:
        IptmError: it is not sound, or only a trip in memory can be driven so.
    """
    trip.checked().vehicle.model()
    trip_text(trip)
    if trip.full_namespace == "/":
        return trip
    from rclpy.exceptions import InvalidNamespaceException  # noqa: PLC0415
    from rclpy.validate_namespace import validate_namespace  # noqa: PLC0415

    try:
        validate_namespace(trip.full_namespace)
    except InvalidNamespaceException as error:
        reason = " ".join(str(error).split("\n")[0].split())
        raise ScenarioError(
            f"trip {trip.name}: namespace: {reason}; allowed: letters, digits and _, parts joined by /"
        ) from None
    return trip


def report_failure(result: DriveResult, folder: RunFolder, stop: StopRequest) -> int:
    """Print what belongs to the reason why a run did not come to its end; return the exit code."""
    if result.outcome is DriveOutcome.REFUSED:
        folder.discard()
        return EXIT_USER_ERROR
    lines = [*(f"    {line}" for line in result.last_lines), f"logs: {folder.logs}"]
    print("\n".join(lines), file=sys.stderr, flush=True)
    if result.outcome is DriveOutcome.INTERRUPTED and stop.number is not None:
        return EXIT_SIGNAL + int(stop.number)
    return EXIT_RUN_FAILED


def _introduction(trip: Trip, domain: int) -> Text:
    without = trip.foreign
    purpose = f"waiting for your own {', '.join(sorted(without))}" if without else "to watch"
    watch = (f"\n{purpose}: export ROS_DOMAIN_ID={domain}", "dim")
    return Text.assemble((trip.title, "bold"), watch)
