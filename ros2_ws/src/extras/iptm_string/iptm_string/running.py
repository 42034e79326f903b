"""A string of vehicles over ROS 2: their nodes in as many processes as there are cores, and a report."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

from rich.console import Console
from rich.table import Table

from iptm.run import Run
from iptm.runner.drive import DriveOutcome, NodeDrive
from iptm.runner.progress import PROGRAM, ConsoleProgress
from iptm.runner.run_folder import RunFolder
from iptm.runner.runner import (
    EXIT_RUN_FAILED,
    RunOptions,
    check_over_ros,
    drive_processes,
    evaluated,
    report_failure,
)
from iptm.runner.supervisor import domain_of_run
from iptm.runner.viewer import live_view
from iptm.trip import NO_COMPARISON, Trip
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.markdown import cells_of
from iptm_core.program import EXIT_OK, StopRequest, print_error
from iptm_core.settings import LeaderSource
from iptm_string.order import vehicles_in_string

PICTURE = "string.png"


def trips_in_string(trip: Trip, count: int) -> dict[str, Trip]:
    """Return the trips of a string by the names of the vehicles, the first one first.

    Each but the first has the vehicle ahead as its leader; all have the length ``leader_length_m``.
    """
    gap_m, length_m = trip.parameters.gap.initial_gap_m, trip.leader.leader_length_m
    trips = {}
    for vehicle in vehicles_in_string(count, gap_m, length_m, trip.conditions.namespace):
        follows = {"leader_source": LeaderSource.VEHICLE} if vehicle.vehicle_ahead else {}
        trips[vehicle.name] = trip.changed(
            name=vehicle.name,
            namespace=vehicle.namespace,
            start_position_m=vehicle.start_position_m,
            vehicle_ahead=vehicle.vehicle_ahead,
            vehicle_behind=vehicle.vehicle_behind,
            **follows,
        )
    return trips


def run_string(
    trip: Trip,
    count: int,
    options: RunOptions,
    console: Console,
) -> int:
    """Drive, record and report a string.

    Args:
        trip: of the first vehicle; the others follow it on the same road.
        count: vehicles.
        options: output, compression, comparison and view of the string.

    Returns:
        0 when all trips were finished, no hard limit was broken and all bags are complete; 1 when not; 2 for
        a mistake of the user; 128 + n after signal n.
    """
    if trip.foreign or trip.conditions.faults or options.processes or not options.record:
        raise ScenarioError(
            "--without, --processes, --no-record or a fault is given for a string; allowed: with one vehicle"
        )
    check_over_ros(trip)
    stop = StopRequest()
    stop.install()
    with ExitStack() as stack:
        asked, own = trip.conditions.domain, trip.full_namespace
        domain = stack.enter_context(domain_of_run(asked, own))
        folder = RunFolder.of_run(options.output, "string")
        heading = f"{count} vehicles; to watch: export ROS_DOMAIN_ID={domain.number}"
        console.print(heading, highlight=False)
        trips = {
            RunFolder(folder.given / name): each
            for name, each in trips_in_string(trip, count).items()
        }
        stay_open = None
        if options.view:
            bags = {each.conditions.namespace: bag.output for bag, each in trips.items()}
            view = live_view(trip, domain.number, folder.logs, bags, console)
            stay_open = stack.enter_context(view)
        progress = ConsoleProgress(console, trip.route.duration_s)
        result, drive = drive_processes(folder, trips, options, domain, progress, stop, forks=True)
        if result.outcome is DriveOutcome.FINISHED:
            code = _report(folder, trips, options, (drive, result.wall_time_s), console)
        else:
            code = report_failure(result, folder, stop)
        if stay_open is not None and result.outcome is not DriveOutcome.REFUSED:
            stay_open(stop)
        return code


def _report(
    folder: RunFolder,
    trips: Mapping[RunFolder, Trip],
    options: RunOptions,
    driven: tuple[NodeDrive, float],
    console: Console,
) -> int:
    """Evaluate a string that was driven, write its files and print its tables."""
    # Half a second of imports, and the threads that they start would keep the runner from forking.
    from iptm.runner.evaluation import results_json  # noqa: PLC0415
    from iptm_string.headless import drive_string_in_memory  # noqa: PLC0415
    from iptm_string.report import save_string_picture  # noqa: PLC0415

    drive, wall_time_s = driven
    first, code, runs = next(iter(trips.values())), EXIT_OK, []
    for place, (bag, trip) in enumerate(trips.items()):
        try:
            run = evaluated(bag, trip, drive, wall_time_s, place)
        except IptmError as error:
            print_error(PROGRAM, f"{trip.name}: {error}")
            return EXIT_RUN_FAILED
        bag.results.write_text(results_json(run, trip), encoding="utf-8")
        runs.append(run)
        if run.problems:
            print_error(PROGRAM, f"{trip.name}: {'; '.join(run.problems)}")
            code = EXIT_RUN_FAILED
    with console.status("driving the strings to compare with ..."):
        is_compared = options.against != NO_COMPARISON
        other = first.against(options.against) if is_compared else None
        others = [] if other is None else list(drive_string_in_memory(other, len(trips)))
    save_string_picture(folder.output / PICTURE, runs)
    _print(runs, others, first.route.duration_s, wall_time_s, console)
    console.print(str(folder.output), highlight=False, soft_wrap=True)
    return code


def _print(
    runs: list[Run], others: list[Run], duration_s: float, wall_time_s: float, console: Console
) -> None:
    from iptm_string.report import string_parts  # noqa: PLC0415  see above

    for part in string_parts(runs, others):
        table = Table(*(head.removesuffix(":") for head in part.columns))
        for cells in cells_of(part.rows, part.columns):
            table.add_row(*cells)
        console.print(table)
    pace = f"{wall_time_s:.1f} s of wall time: {duration_s / wall_time_s:.1f} × real time"
    console.print(f"{len(runs)} vehicles, {duration_s:g} s, {pace}", highlight=False)
