"""The live view of a run: a separate process on which the run neither waits nor depends."""

from __future__ import annotations

import re
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import yaml
from rich.console import Console

from iptm.runner.composition import node_parameters, run_information
from iptm.runner.supervisor import Supervisor, environment_of_run
from iptm.trip import NO_COMPARISON, Trip
from iptm_core.program import StopRequest

VIEW = "view"
"""The command that shows it, of an extra, and the name of its process."""
_START_TIMEOUT_S = 20.0
_POLL_S = 0.05
_ADDRESS = re.compile(r"http://\S+")


@contextmanager
def live_view(
    trip: Trip,
    domain: int,
    logs: Path,
    bags: Mapping[str, Path | None],
    console: Console,
    against: str = NO_COMPARISON,
) -> Iterator[Callable[[StopRequest], None]]:
    """Show a run in the browser until the context ends; it continues where the view fails.

    Args:
        trip: the trip to drive.
        domain: ROS domain of the run.
        logs: folder for its log and the information about the run.
        bags: of each vehicle by namespace, "" for none; read when complete, None if nothing is recorded.
        console: for the address.
        against: strategy of the reference car, `NO_COMPARISON` for no such car.

    Yields:
        To be called at the end of the run: on a terminal it keeps the view open until Ctrl-C.
    """
    supervisor = Supervisor(
        environment_of_run(domain, logs / "ros"), lambda name: logs / f"{name}.log"
    )
    known = run_information(trip, node_parameters(trip))
    file = logs / "view_information.yaml"
    file.write_text(yaml.safe_dump(known, sort_keys=False), encoding="utf-8")
    recorded = [bag for bag in bags.values() if bag is not None]
    command = [sys.executable, "-m", "iptm", VIEW, "--against", against]
    command += [f"--run-information={file}"]
    command += [f"--namespace={name}" for name in bags]
    command += [f"--afterwards={bag}" for bag in recorded]
    supervisor.start(VIEW, command)
    try:
        address = _address(supervisor)
        if address:
            console.print(f"live view: {address}", style="bold", highlight=False, soft_wrap=True)
        else:
            reason = (supervisor.log_text(VIEW).strip().splitlines() or ["no reason given"])[-1]
            print(f"no live view: {reason}", file=sys.stderr, flush=True)
        yield lambda stop: _stay_open(supervisor, stop, address, recorded, console)
    finally:
        supervisor.stop()


def _address(supervisor: Supervisor) -> str:
    """Return where the page is served, "" if it is not."""
    deadline_s = time.monotonic() + _START_TIMEOUT_S
    while supervisor.is_running(VIEW) and time.monotonic() < deadline_s:
        found = _ADDRESS.search(supervisor.log_text(VIEW))
        if found:
            return found.group(0)
        time.sleep(_POLL_S)
    return ""


def _stay_open(
    supervisor: Supervisor,
    stop: StopRequest,
    address: str,
    bags: Sequence[Path],
    console: Console,
) -> None:
    if not supervisor.is_running(VIEW) or stop.is_set:
        return
    again = f"; to see it again: scripts/iptm view {shlex.quote(str(bags[0]))}" if bags else ""
    # Only on a terminal: a script that drives runs must come to its end.
    is_terminal = sys.stdin.isatty() and console.is_terminal
    text = f"stays at {address} until Ctrl-C" if is_terminal else "ends with the run (no terminal)"
    console.print(f"the live view {text}{again}", style="dim", highlight=False, soft_wrap=True)
    while is_terminal and supervisor.is_running(VIEW) and not stop.is_set:
        time.sleep(_POLL_S)
