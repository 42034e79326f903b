"""Starts processes, notices when one ends, and ends them all in order.

The processes of a run have their own ROS domain on this machine only, and one thread each. A runner that
is a program of its own forks them before it loads ROS, which saves each of them 0.2 s of imports.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from iptm.runner.composition import PYTHON
from iptm.runner.fork import Fork, end_with_parent, has_one_thread
from iptm.trip_settings import AUTOMATIC_DOMAIN, MAX_DOMAIN
from iptm_core.errors import ScenarioError
from iptm_ros.discovery import check_nodes_can_meet, lock_run, middleware_settings, reserve_domain

INTERRUPT_PATIENCE_S = 5.0
TERMINATE_PATIENCE_S = 2.0
KILL_PATIENCE_S = 2.0
LAST_LINES = 8
_POLL_S = 0.01


@dataclass(frozen=True)
class ProcessEnd:
    """How a process ended.

    Attributes:
        name: of the process.
        code: exit code, negative for a signal as in `subprocess`.
        last_lines: its last output.
    """

    name: str
    code: int
    last_lines: tuple[str, ...]

    @property
    def how(self) -> str:
        """The end in words, such as ``ended with exit code 1``."""
        if self.code >= 0:
            return f"ended with exit code {self.code}"
        try:
            return f"was killed by signal {-self.code} ({signal.Signals(-self.code).name})"
        except ValueError:
            return f"was killed by signal {-self.code}"


class _Process(Protocol):
    """What `subprocess.Popen` and `Fork` have in common."""

    @property
    def pid(self) -> int: ...
    def poll(self) -> int | None: ...
    def send_signal(self, sig: int, /) -> None: ...


class Supervisor:
    """Owns the processes of a run.

    Each process leads a session of its own, so that Ctrl-C reaches only the runner, which then ends
    them in an order that loses nothing. Should the runner itself be killed, they end as well.

    Args:
        environment: of the processes.
        log_path: returns the log file of a process by its name.
        interrupt_patience_s: time for an end after SIGINT.
        forks: whether a program of the suite may be a copy of this process, while it has one thread.
    """

    def __init__(
        self,
        environment: Mapping[str, str],
        log_path: Callable[[str], Path],
        interrupt_patience_s: float = INTERRUPT_PATIENCE_S,
        *,
        forks: bool = False,
    ) -> None:
        self._interrupt_patience_s = interrupt_patience_s
        self._forks = forks
        self._environment = dict(environment)
        self._log_path = log_path
        self._processes: dict[str, _Process] = {}

    def start(self, name: str, command: Sequence[str]) -> None:
        """Start a process with its output in its log file."""
        is_of_suite = tuple(command[: len(PYTHON)]) == PYTHON
        log = self._log_path(name)
        if self._forks and is_of_suite and has_one_thread():
            self._processes[name] = Fork(name, command[len(PYTHON) :], log, self._environment)
        else:
            self._processes[name] = _started(command, log, self._environment)

    @property
    def names(self) -> tuple[str, ...]:
        """Processes started so far, in the order of their start."""
        return tuple(self._processes)

    def is_running(self, name: str) -> bool:
        """Whether a process was started and still runs."""
        process = self._processes.get(name)
        return process is not None and process.poll() is None

    def pid(self, name: str) -> int:
        """Return the process id of a process that was started."""
        return self._processes[name].pid

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a process that still runs."""
        self._processes[name].send_signal(number)

    def endings(self) -> tuple[ProcessEnd, ...]:
        """Return the processes that have ended so far, in the order of their start."""
        return tuple(
            ProcessEnd(name, code, self._last_lines(name))
            for name, process in self._processes.items()
            if (code := process.poll()) is not None
        )

    def log_text(self, name: str) -> str:
        """Return the output of a process so far."""
        try:
            return self._log_path(name).read_text(errors="replace")
        except OSError:
            return ""

    @property
    def has_lost_one(self) -> bool:
        """Whether a process was killed, to which the others may still try to send."""
        return any((process.poll() or 0) < 0 for process in self._processes.values())

    def stop(
        self, names: Iterable[str] | None = None, interrupt_patience_s: float | None = None
    ) -> None:
        """End processes with SIGINT, SIGTERM and SIGKILL in turn, each with a timeout.

        Args:
            names: of the processes, None for all.
            interrupt_patience_s: the first of the timeouts, None for the usual one.
        """
        chosen = [self._processes[name] for name in (self._processes if names is None else names)]
        for number, patience_s in (
            (signal.SIGINT, interrupt_patience_s or self._interrupt_patience_s),
            (signal.SIGTERM, TERMINATE_PATIENCE_S),
            (signal.SIGKILL, KILL_PATIENCE_S),
        ):
            running = [process for process in chosen if process.poll() is None]
            if not running:
                return
            for process in running:
                process.send_signal(number)
                process.send_signal(signal.SIGCONT)  # a stopped process could not end
            deadline_s = time.monotonic() + patience_s
            while any(process.poll() is None for process in running):
                if time.monotonic() > deadline_s:
                    break
                time.sleep(_POLL_S)

    def _last_lines(self, name: str) -> tuple[str, ...]:
        lines = [line.rstrip() for line in self.log_text(name).splitlines() if line.strip()]
        return tuple(lines[-LAST_LINES:])


def _started(
    command: Sequence[str], log: Path, environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    with log.open("wb") as output:
        return subprocess.Popen(  # noqa: S603  commands of this package
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
            preexec_fn=partial(end_with_parent, os.getpid()),  # noqa: PLW1509
        )


DOMAIN_VARIABLE = "ROS_DOMAIN_ID"


@dataclass(frozen=True)
class RunDomain:
    """ROS domain of a run.

    Attributes:
        number: domain id.
        is_private: whether it was reserved for this run alone; in a domain that the user chose,
            viewers may be there already.
    """

    number: int
    is_private: bool


@contextmanager
def domain_of_run(
    requested: int, namespace: str = "/", environment: Mapping[str, str] = os.environ
) -> Iterator[RunDomain]:
    """Provide the ROS domain of a run, which no other run has in the same namespace until the context ends.

    Args:
        requested: domain of the scenario, `AUTOMATIC_DOMAIN` for the user's or a free one.
        namespace: full namespace of the run, `/` for none.
        environment: where ``ROS_DOMAIN_ID`` may be set.

    Raises:
        ScenarioError: ``ROS_DOMAIN_ID`` is invalid, another run uses the domain, none is free, or nodes
            cannot find each other in this environment.
    """
    given = environment.get(DOMAIN_VARIABLE, "").strip() if requested == AUTOMATIC_DOMAIN else ""
    if given and not (given.isascii() and given.isdigit() and int(given) <= MAX_DOMAIN):
        raise ScenarioError(f"{DOMAIN_VARIABLE} is {given!r}; allowed: 0 to {MAX_DOMAIN}")
    check_nodes_can_meet(environment)
    is_private = requested == AUTOMATIC_DOMAIN and not given
    with ExitStack() as stack:
        number = int(given) if given else requested
        if is_private:
            number = stack.enter_context(reserve_domain())
        stack.enter_context(lock_run(number, namespace))
        yield RunDomain(number, is_private)


def environment_of_run(
    domain: int, log_folder: Path, base: Mapping[str, str] = os.environ
) -> dict[str, str]:
    """Return the environment for every process of a run; what the user has set is kept."""
    defaults = {
        # ROS from wheels does not set its install prefix.
        "AMENT_PREFIX_PATH": sys.prefix,
        # Four processes already share the cores.
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    chosen = {name: value for name, value in defaults.items() if not base.get(name)}
    return {
        **base,
        **chosen,
        # Keep the run on this machine: it must not reach a plant elsewhere on the network.
        **middleware_settings(base),
        DOMAIN_VARIABLE: str(domain),
        "ROS_LOG_DIR": str(log_folder),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }


@contextmanager
def process_environment(environment: Mapping[str, str]) -> Iterator[None]:
    """Give this process an environment until the context ends.

    A process that takes part in the graph itself needs it: ROS and Fast DDS read their settings from
    the environment of the process when a node is built.
    """
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
