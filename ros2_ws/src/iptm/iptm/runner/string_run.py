"""A string of vehicles over ROS 2: one run per vehicle, all in one ROS domain and in step, and a report."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from iptm.run import Run
from iptm.run_file import load
from iptm.runner.progress import read_progress
from iptm.runner.run_folder import LOGS, RESULTS, RunFolder
from iptm.runner.runner import EXIT_RUN_FAILED, PROGRAM, RunOptions, check_over_ros
from iptm.runner.supervisor import ProcessEnd, Supervisor, domain_of_run, environment_of_run
from iptm.runner.viewer import live_view
from iptm.string_report import save_string_picture, string_parts
from iptm.trip import NO_COMPARISON, Trip
from iptm.trip_files import trip_text
from iptm.vehicle_string import drive_string_in_memory, trips_in_string
from iptm_core.errors import ScenarioError
from iptm_core.markdown import cells_of
from iptm_core.program import EXIT_OK, EXIT_SIGNAL, EXIT_USER_ERROR, StopRequest, print_error

STOP_PATIENCE_S = 30.0
"""For as long the run of a vehicle may take to end its own processes."""
BEGIN_PATIENCE_S = 10.0
"""After the failure of a vehicle, time for the trips of the others to have begun."""
_POLL_S = 0.2
_SHOW_PERIOD_S = 5.0
_RUN = "iptm.commands.run"


def drive_string(
    trips: Mapping[str, Trip],
    options: Sequence[str],
    output: Path,
    domain: int,
    stop: StopRequest,
    console: Console,
) -> tuple[ProcessEnd, ...]:
    """Start the run of every vehicle, wait until all have ended, and return how they did.

    The failure of a vehicle is printed at once. The others go on without it once their trips have begun.

    Args:
        trips: of the vehicles by name, the first one first.
        options: further options of `iptm run`, the same for all.
        output: folder that exists, with one for logs in it; the bag of each vehicle is made in it.
        domain: ROS domain of the string.
        stop: set when the user requests a stop.
        console: shows the progress.
    """
    logs = output / LOGS
    environment = environment_of_run(domain, logs / "ros")
    supervisor = Supervisor(environment, lambda name: logs / f"{name}.log", STOP_PATIENCE_S)
    places = {name: logs / f"{name}.progress" for name in trips}
    try:
        for name, trip in trips.items():
            file = logs / f"{name}.yaml"
            file.write_text(trip_text(trip), encoding="utf-8")
            own = [str(file), "--output", str(output / name), f"--domain={domain}"]
            command = [sys.executable, "-m", _RUN, *own, *options]
            supervisor.start(name, [*command, "--progress", str(places[name])])
        duration_s = max(trip.route.duration_s for trip in trips.values())
        _watch(supervisor, places, duration_s, stop, console)
    finally:
        supervisor.stop()
    return supervisor.endings()


def _watch(
    supervisor: Supervisor,
    places: Mapping[str, Path],
    duration_s: float,
    stop: StopRequest,
    console: Console,
) -> None:
    reported: set[str] = set()
    shown_s = began_s = time.monotonic()
    failed_s = math.inf
    while stop.number is None:
        ends = supervisor.endings()
        if len(ends) == len(supervisor.names):
            return
        now_s = time.monotonic()
        for end in ends:
            if end.code != 0 and end.name not in reported:
                reported.add(end.name)
                failed_s = min(failed_s, now_s)
                text = f"{end.name}: {_reason(end)}"
                console.print(text, markup=False, highlight=False, soft_wrap=True)
        driving = sorted(set(supervisor.names) - {end.name for end in ends})
        found = {name: read_progress(places[name]) for name in driving}
        waiting = [name for name, time_s in found.items() if time_s is None]
        if waiting and now_s - failed_s > BEGIN_PATIENCE_S:
            return  # a vehicle that waits for one that has failed waits for ever
        if now_s - shown_s >= _SHOW_PERIOD_S:
            shown_s = now_s
            text = f"starting: {', '.join(waiting)}"
            if not waiting:
                at_s = min(time_s for time_s in found.values() if time_s is not None)
                share, wall_s = at_s / duration_s, now_s - began_s
                text = f"{at_s:.0f} of {duration_s:.0f} s ({share:.0%}), {wall_s:.0f} s since the start"
            console.print(text, highlight=False, soft_wrap=True)
        time.sleep(_POLL_S)


def complaint(end: ProcessEnd, results: Mapping[str, Any]) -> str:
    """Return what was wrong with the trip of a vehicle, empty if nothing."""
    return "" if end.code == 0 else "; ".join(results.get("problems", ())) or _reason(end)


def _reason(end: ProcessEnd) -> str:
    """Return why the run of a vehicle failed, in its own words if there are any."""
    begin = f"{PROGRAM}: "
    reasons = [line.removeprefix(begin) for line in end.last_lines if line.startswith(begin)]
    return reasons[-1] if reasons else end.how


def results_in(folder: Path) -> dict[str, Any]:
    """Return the content of the results.json of a run, empty where there is none."""
    try:
        content: dict[str, Any] = json.loads((folder / RESULTS).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise ScenarioError(f"cannot read {folder / RESULTS}: {error}") from None
    return content


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
