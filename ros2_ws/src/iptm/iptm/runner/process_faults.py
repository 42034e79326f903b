"""Process faults by trip time: killed, restarted, frozen, duplicated, disk full.

Trip time may stand still while a process is away, so what follows is timed by the wall clock. The time of a
double runs from when it takes part: how long a process takes to start is the machine's affair.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.runner.composition import RECORDER
from iptm.runner.supervisor import Supervisor
from iptm_core.state import NS_PER_S


@dataclass
class ProcessFaultRecord:
    """What was done.

    Attributes:
        fault: the fault.
        began_ns: trip time of its beginning.
        ended_ns: trip time at which it was undone; None if it was not.
        began_clocks: clocks received before its start; identifies the trip where there are several.
        ended_clocks: clocks received before it was undone.
    """

    fault: Fault
    began_ns: int
    ended_ns: int | None = None
    began_clocks: int = 0
    ended_clocks: int = 0


class ProcessFaults:
    """Injects the process faults of a run; call `act` periodically.

    Attributes:
        records: faults that have begun, in order.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        faults: Iterable[Fault],
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up the faults of a run."""
        self._supervisor = supervisor
        self._steady_time_s = steady_time_s
        self._pending = [
            fault for fault in at_places(faults, FaultPlace.PROCESS) if fault.happens()
        ]
        self._later: list[tuple[float, ProcessFaultRecord, Callable[[], None]]] = []
        self._starting: list[tuple[ProcessFaultRecord, Callable[[], None]]] = []
        self._commands: dict[str, list[str]] = {}
        self._now_called: dict[str, str] = {}
        self._excused: set[str] = set()
        self.records: list[ProcessFaultRecord] = []

    def note(self, commands: Mapping[str, list[str]]) -> None:
        """Learn the commands of processes that have been started."""
        self._commands.update(commands)

    def current(self, name: str) -> str:
        """Return what the process of a name is called now: one that was started again has another name."""
        return self._now_called.get(name, name)

    def is_excused(self, name: str) -> bool:
        """Return whether a process may have ended, as a fault hit it."""
        return name in self._excused

    def act(
        self,
        time_ns: int | None,
        clocks: int = 0,
        is_doubled: Callable[[str], bool] = lambda _: True,
    ) -> None:
        """Do the actions that are due.

        Args:
            time_ns: newest trip time, None before the first tick.
            clocks: clocks received so far.
            is_doubled: whether two nodes of a name take part in the graph.
        """
        now_s = self._steady_time_s()
        for record, undo in list(self._starting):
            if is_doubled(record.fault.target):
                self._starting.remove((record, undo))
                self._later.append((now_s + record.fault.magnitude, record, undo))
        due = [entry for entry in self._later if entry[0] <= now_s]
        self._later = [entry for entry in self._later if entry[0] > now_s]
        for _, record, undo in due:
            undo()
            record.ended_ns, record.ended_clocks = time_ns, clocks
        if time_ns is None:
            return
        begun = [fault for fault in self._pending if fault.start_s * NS_PER_S <= time_ns]
        for fault in begun:
            self._pending.remove(fault)
            record = ProcessFaultRecord(fault, time_ns, began_clocks=clocks)
            self.records.append(record)
            undo_later = self._begin(fault)
            if undo_later is None:
                continue
            if fault.kind is FaultKind.PROCESS_DOUBLED:
                self._starting.append((record, undo_later))
            else:
                self._later.append((now_s + fault.magnitude, record, undo_later))

    def _begin(self, fault: Fault) -> Callable[[], None] | None:
        """Do it; return how it is undone, None if it is not."""
        name, supervisor = self.current(fault.target), self._supervisor
        if not supervisor.is_running(name):
            return None
        if fault.kind is FaultKind.PROCESS_FROZEN:
            supervisor.send(name, signal.SIGSTOP)
            return lambda: supervisor.send(name, signal.SIGCONT)
        if fault.kind is FaultKind.PROCESS_DOUBLED:
            copy = self._start_again(fault.target, "copy")
            # One that is killed stays on the graph of the middleware for 20 s; a trip may be over by then.
            return lambda: self._kill(copy, signal.SIGTERM)
        if fault.kind is FaultKind.DISK_FULL:
            _fill_disk(supervisor.pid(name))
            return None
        self._kill(name)
        restarts = fault.kind is FaultKind.PROCESS_RESTARTED
        return (lambda: self._restart(fault.target)) if restarts else None

    def _kill(self, name: str, how: signal.Signals = signal.SIGKILL) -> None:
        self._excused.add(name)
        self._supervisor.send(name, how)

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


def unclean_ends(supervisor: Supervisor, process_faults: ProcessFaults) -> list[str]:
    """Return a sentence for every process that failed although trip and faults do not explain it.

    A recorder killed by a fault does not end the run, but its bag lacks the rest of the trip.
    """
    sentences = []
    for ending in supervisor.endings():
        if ending.code == 0:
            continue
        if not process_faults.is_excused(ending.name):
            sentences.append(f"{ending.name} {ending.how} when it was stopped")
        elif ending.name == RECORDER:
            sentences.append(f"the bag is incomplete: {ending.name} {ending.how}, by a fault")
    return sentences
