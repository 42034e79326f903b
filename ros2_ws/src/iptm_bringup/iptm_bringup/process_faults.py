"""Faults of processes: killed, started again, frozen, doubled, without room on the disk; by trip time.

Trip time may stand still while a process is away, so what follows is timed by the wall clock.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from iptm_bringup.supervisor import Supervisor
from iptm_core.trip_time import NS_PER_S
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultKind, FaultPlace


class ProcessFaults:
    """Does to the processes of a run what its faults say; call `act` again and again.

    Attributes:
        hit: faults that have begun, in order, with the steady time of their beginning.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        faults: Iterable[Fault],
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up the faults of a run.

        Args:
            supervisor: owns the processes.
            faults: those of other places are left alone.
            steady_time_s: clock in seconds, replaceable in tests.
        """
        self._supervisor = supervisor
        self._steady_time_s = steady_time_s
        self._pending = [
            fault for fault in at_places(faults, FaultPlace.PROCESS) if fault.happens()
        ]
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._commands: dict[str, list[str]] = {}
        self._now_called: dict[str, str] = {}
        self._excused: set[str] = set()
        self.hit: list[tuple[float, Fault]] = []

    def note(self, commands: Mapping[str, list[str]]) -> None:
        """Learn the commands of processes that have been started."""
        self._commands.update(commands)

    def current(self, name: str) -> str:
        """Return what the process of a name is called now: one that was started again has another name."""
        return self._now_called.get(name, name)

    def is_excused(self, name: str) -> bool:
        """Return whether a process may have ended, as a fault hit it."""
        return name in self._excused

    @property
    def is_busy(self) -> bool:
        """Whether something is still to follow."""
        return bool(self._later)

    def act(self, time_ns: int | None) -> None:
        """Do what is due.

        Args:
            time_ns: newest trip time, None before the first tick.
        """
        now_s = self._steady_time_s()
        due = [action for at_s, action in self._later if at_s <= now_s]
        self._later = [(at_s, action) for at_s, action in self._later if at_s > now_s]
        for action in due:
            action()
        if time_ns is None:
            return
        begun = [fault for fault in self._pending if fault.start_s * NS_PER_S <= time_ns]
        for fault in begun:
            self._pending.remove(fault)
            self.hit.append((now_s, fault))
            self._begin(fault, now_s)

    def _begin(self, fault: Fault, now_s: float) -> None:
        name, supervisor = self.current(fault.target), self._supervisor
        if not supervisor.is_running(name):
            return
        if fault.kind is FaultKind.PROCESS_FROZEN:
            supervisor.send(name, signal.SIGSTOP)
            self._after(now_s, fault, lambda: supervisor.send(name, signal.SIGCONT))
        elif fault.kind is FaultKind.PROCESS_DOUBLED:
            copy = self._start_again(fault.target, "copy")
            self._after(now_s, fault, lambda: self._kill(copy))
        elif fault.kind is FaultKind.DISK_FULL:
            _fill_disk(supervisor.pid(name))
            self._excused.add(name)
        else:
            self._kill(name)
            if fault.kind is FaultKind.PROCESS_RESTARTED:
                self._after(now_s, fault, lambda: self._restart(fault.target))

    def _after(self, now_s: float, fault: Fault, action: Callable[[], None]) -> None:
        self._later.append((now_s + fault.magnitude, action))

    def _kill(self, name: str) -> None:
        self._excused.add(name)
        self._supervisor.send(name, signal.SIGKILL)

    def _restart(self, target: str) -> None:
        self._now_called[target] = self._start_again(target, "again")

    def _start_again(self, target: str, how: str) -> str:
        number = len(self._supervisor.names)
        name = f"{target}_{how}_{number}"
        self._supervisor.start(name, self._commands[target])
        return name


def _fill_disk(pid: int) -> None:
    """Let no file of a process grow beyond what its largest one, the bag, has now."""
    largest = max(map(_file_size, Path(f"/proc/{pid}/fd").iterdir()))
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (largest, largest))


def _file_size(descriptor: Path) -> int:
    try:
        return descriptor.stat().st_size if descriptor.is_file() else 0
    except OSError:  # closed meanwhile
        return 0
