"""Drives a string of vehicles: one run per vehicle, all in one ROS domain, in step with each other."""

from __future__ import annotations

import json
import math
import re
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from iptm.runner.environment import environment_of_run
from iptm.runner.run_folder import LOGS, RESULTS
from iptm.runner.runner import PROGRAM
from iptm.runner.supervisor import ProcessEnd, Supervisor
from iptm_core.errors import ScenarioError
from iptm_core.settings import LeaderSource
from iptm_core.vehicle_string import VehicleInString
from iptm_ros.process import StopRequest
from iptm_ros.topics import BRIDGE, PLANT

STOP_PATIENCE_S = 30.0
"""For as long the run of a vehicle may take to end its own processes."""
BEGIN_PATIENCE_S = 10.0
"""After the failure of a vehicle, time for the trips of the others to have begun."""
_POLL_S = 0.2
_SHOW_PERIOD_S = 5.0
_WHERE = re.compile(r"^(\d+) of (\d+) s ", re.MULTILINE)
_RUN = "iptm.runner.run_closed_loop"


def _vehicle_options(vehicle: VehicleInString, length_m: float) -> list[str]:
    """Return the options that make a run of one vehicle that of a vehicle in a string."""
    settings: dict[str, object] = {
        f"{PLANT}.start_position_m": vehicle.start_position_m,
        f"{PLANT}.vehicle_ahead": vehicle.vehicle_ahead,
        f"{PLANT}.vehicle_behind": vehicle.vehicle_behind,
    }
    if vehicle.vehicle_ahead:
        settings |= {
            f"{BRIDGE}.leader_source": LeaderSource.VEHICLE,
            f"{BRIDGE}.vehicle_ahead": vehicle.vehicle_ahead,
            f"{BRIDGE}.leader_length_m": length_m,
        }
    given = [f"--set={name}={value}" for name, value in settings.items() if value != ""]
    return [f"--namespace={vehicle.namespace}", *given]


def drive_string(
    vehicles: Sequence[VehicleInString],
    arguments: Sequence[str],
    length_m: float,
    output: Path,
    domain: int,
    stop: StopRequest,
    console: Console,
) -> tuple[ProcessEnd, ...]:
    """Start the run of every vehicle, wait until all have ended, and return how they did.

    The failure of a vehicle is printed at once. The others go on without it once their trips have begun.

    Args:
        vehicles: the first one first.
        arguments: of `run_closed_loop`, the same for all.
        length_m: of every vehicle.
        output: folder that exists, with one for logs in it; that of each vehicle becomes a bag in it.
        domain: ROS domain of the string.
        stop: set when the user requests a stop.
        console: shows the progress.
    """
    logs = output / LOGS
    environment = environment_of_run(domain, logs / "ros")
    supervisor = Supervisor(environment, lambda name: logs / f"{name}.log", STOP_PATIENCE_S)
    try:
        for vehicle in vehicles:
            own = [*_vehicle_options(vehicle, length_m), "--output", str(output / vehicle.name)]
            command = [sys.executable, "-m", _RUN, *arguments, *own]
            supervisor.start(vehicle.name, [*command, f"--domain={domain}"])
        _watch(supervisor, stop, console)
    finally:
        supervisor.stop()
    return supervisor.endings()


def _watch(supervisor: Supervisor, stop: StopRequest, console: Console) -> None:
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
        places = {name: _WHERE.findall(supervisor.log_text(name)) for name in driving}
        waiting = [name for name, found in places.items() if not found]
        if waiting and now_s - failed_s > BEGIN_PATIENCE_S:
            return  # a vehicle that waits for one that has failed waits for ever
        if now_s - shown_s >= _SHOW_PERIOD_S:
            shown_s = now_s
            text = f"starting: {', '.join(waiting)}"
            if not waiting:
                at_s, of_s = min((int(at), int(of)) for at, of in (f[-1] for f in places.values()))
                share, wall_s = at_s / max(of_s, 1), now_s - began_s
                text = f"{at_s} of {of_s} s ({share:.0%}), {wall_s:.0f} s since the start"
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
