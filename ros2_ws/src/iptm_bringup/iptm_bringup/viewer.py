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

from iptm_bringup.composition import Listeners, node_parameters, run_information
from iptm_bringup.scenario import PreparedScenario
from iptm_bringup.supervisor import Supervisor
from iptm_interfaces.process import StopRequest

VIEW = "view"
MODULE = "iptm_bringup.view"
_START_TIMEOUT_S = 20.0
_POLL_S = 0.05
_ADDRESS = re.compile(r"http://\S+")


@contextmanager
def live_view(
    logs: Path,
    environment: Mapping[str, str],
    prepared: PreparedScenario,
    namespaces: Sequence[str],
    bags: Sequence[Path],
    against: str,
    console: Console,
    errors: Console,
) -> Iterator[Callable[[StopRequest], None]]:
    """Show a run in the browser until the context ends.

    Args:
        logs: folder for its log and the information about the run.
        environment: of the processes of the run.
        prepared: what is driven.
        namespaces: of the vehicles, "" for none.
        bags: of the vehicles, read when they are complete; empty if nothing is recorded.
        against: strategy of the reference car, "none" for no such car.
        console: for the address.
        errors: for the reason if the view fails; the run continues without it.

    Yields:
        To be called at the end of the run: on a terminal it keeps the view open until Ctrl-C.
    """
    supervisor = Supervisor(environment, lambda name: logs / f"{name}.log")
    known = run_information(prepared, node_parameters(prepared, Listeners()))
    file = logs / "view_information.yaml"
    file.write_text(yaml.safe_dump(known, sort_keys=False), encoding="utf-8")
    command = [sys.executable, "-m", MODULE, "--against", against, "--run-information", str(file)]
    command += [f"--namespace={name}" for name in namespaces]
    command += [f"--afterwards={bag}" for bag in bags]
    supervisor.start(VIEW, command)
    try:
        address = _address(supervisor)
        if address:
            console.print(f"live view: {address}", style="bold", highlight=False, soft_wrap=True)
        else:
            reason = (supervisor.log_text(VIEW).strip().splitlines() or ["no reason given"])[-1]
            errors.print(f"no live view: {reason}", markup=False, highlight=False, soft_wrap=True)
        yield lambda stop: _stay_open(supervisor, stop, address, bags, console)
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
    again = f"; to see it again: scripts/view {shlex.quote(str(bags[0]))}" if bags else ""
    # Only on a terminal: a script that drives runs must come to its end.
    is_terminal = sys.stdin.isatty() and console.is_terminal
    text = f"stays at {address} until Ctrl-C" if is_terminal else "ends with the run (no terminal)"
    console.print(f"the live view {text}{again}", style="dim", highlight=False, soft_wrap=True)
    while is_terminal and supervisor.is_running(VIEW) and not stop.is_set:
        time.sleep(_POLL_S)
