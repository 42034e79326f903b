"""Starts processes, notices when one ends, and ends them all in order."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

INTERRUPT_PATIENCE_S = 5.0
TERMINATE_PATIENCE_S = 2.0
KILL_PATIENCE_S = 2.0
LAST_LINES = 8
_POLL_S = 0.01
_SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
# Looked up now: between fork and exec only the plainest things are safe.
_C_LIBRARY = ctypes.CDLL(None) if sys.platform == "linux" else None


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


class Supervisor:
    """Owns the processes of a run.

    Each process leads a session of its own, so that Ctrl-C reaches only the runner, which then ends
    them in an order that loses nothing. Should the runner itself be killed, they end as well.
    """

    def __init__(
        self,
        environment: Mapping[str, str],
        log_path: Callable[[str], Path],
        interrupt_patience_s: float = INTERRUPT_PATIENCE_S,
    ) -> None:
        """Set up a supervisor."""
        self._interrupt_patience_s = interrupt_patience_s
        self._environment = dict(environment)
        self._log_path = log_path
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, command: Sequence[str]) -> None:
        """Start a process with its output in its log file."""
        with self._log_path(name).open("wb") as log:
            self._processes[name] = subprocess.Popen(  # noqa: S603  commands of `composition`
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,
                preexec_fn=partial(_end_with_parent, os.getpid()),  # noqa: PLW1509
            )

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
            ProcessEnd(name, process.returncode, self._last_lines(name))
            for name, process in self._processes.items()
            if process.poll() is not None
        )

    def log_text(self, name: str) -> str:
        """Return the output of a process so far."""
        try:
            return self._log_path(name).read_text(errors="replace")
        except OSError:
            return ""

    def stop(self, names: Iterable[str] | None = None) -> None:
        """End processes with SIGINT, SIGTERM and SIGKILL in turn, each with a timeout."""
        chosen = [self._processes[name] for name in (self._processes if names is None else names)]
        for number, patience_s in (
            (signal.SIGINT, self._interrupt_patience_s),
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


def _end_with_parent(parent: int) -> None:
    """Run in the child before the program: have Linux interrupt it when the runner dies."""
    # Programs started in the background of a shell ignore SIGINT, and so would their children.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if _C_LIBRARY is None:
        return
    _C_LIBRARY.prctl(_SET_PARENT_DEATH_SIGNAL, int(signal.SIGINT))
    if os.getppid() != parent:  # the runner died in between
        os._exit(1)
