"""A string of vehicles over ROS 2: a run for each, which records it, and a report of the string."""

from __future__ import annotations

import sys
from contextlib import ExitStack

from rich.console import Console
from rich.table import Table

from iptm.run import Run
from iptm.run_file import load
from iptm.runner.run_folder import LOGS, RunFolder
from iptm.runner.runner import EXIT_RUN_FAILED, RunOptions, check_over_ros
from iptm.runner.string_run import complaint, drive_string, results_in
from iptm.runner.supervisor import domain_of_run
from iptm.runner.viewer import live_view
from iptm.string_report import save_string_picture, string_parts
from iptm.trip import NO_COMPARISON, Trip
from iptm.vehicle_string import drive_string_in_memory, trips_in_string
from iptm_core.errors import ScenarioError
from iptm_core.markdown import cells_of
from iptm_core.program import EXIT_OK, EXIT_SIGNAL, EXIT_USER_ERROR, StopRequest, print_error

PROGRAM = "iptm run"
PICTURE = "string.png"


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
    if not trip.is_lock_step:
        raise ScenarioError("mode is real_time; allowed in a string: lock_step")
    if trip.foreign or not options.record:
        raise ScenarioError(
            "--without or --no-record is given for a string; allowed: with one vehicle"
        )
    check_over_ros(trip)
    stop = StopRequest()
    stop.install()
    trips = trips_in_string(trip, count)
    with ExitStack() as stack:
        asked, own = trip.conditions.domain, trip.full_namespace
        domain = stack.enter_context(domain_of_run(asked, own))
        output = RunFolder.of_run(options.output, "string").output
        heading = f"{count} vehicles; to watch: export ROS_DOMAIN_ID={domain.number}"
        console.print(heading, highlight=False)
        bags = {each.conditions.namespace: output / name for name, each in trips.items()}
        stay_open = None
        if options.view:
            view = live_view(trip, domain.number, output / LOGS, bags, console)
            stay_open = stack.enter_context(view)
        further = ["--no-picture", f"--compression={options.compression}"]
        ends = drive_string(trips, further, output, domain.number, stop, console)
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
                is_compared = options.against != NO_COMPARISON
                other = trip.against(options.against) if is_compared else None
                others = [] if other is None else list(drive_string_in_memory(other, count))
            save_string_picture(output / PICTURE, runs)
            _print(runs, others, trip.route.duration_s, wall_time_s, console)
            console.print(str(output), highlight=False, soft_wrap=True)
        else:
            code = EXIT_USER_ERROR if EXIT_USER_ERROR in {end.code for end in ends} else code
            print(f"logs: {output / LOGS}", file=sys.stderr)
        if stay_open is not None:
            stay_open(stop)
        return code


def _print(
    runs: list[Run], others: list[Run], duration_s: float, wall_time_s: float, console: Console
) -> None:
    for part in string_parts(runs, others):
        table = Table(*(head.removesuffix(":") for head in part.columns))
        for cells in cells_of(part.rows, part.columns):
            table.add_row(*cells)
        console.print(table)
    pace = f"{wall_time_s:.1f} s of wall time: {duration_s / wall_time_s:.1f} × real time"
    console.print(f"{len(runs)} vehicles, {duration_s:g} s, {pace}", highlight=False)
