"""A run from the first process to the last: start, watch and shut down without losing messages."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

from iptm.runner.composition import RECORDER
from iptm.runner.process_faults import ProcessFaults
from iptm.runner.progress import Progress
from iptm.runner.supervisor import INTERRUPT_PATIENCE_S, ProcessEnd, Supervisor
from iptm.trip import Trip
from iptm_core.program import EXIT_USER_ERROR, StopRequest
from iptm_ros.discovery import SERVER_VARIABLE
from iptm_ros.topics import PLANT, Topic

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from iptm.runner.monitor import RunMonitor, Snapshot

START_TIMEOUT_S = 660.0
"""Time for two compilations at a first start, each of which is aborted after 300 s."""
_SERVER_TIMEOUT_S = 5.0
"""From then on a server of discovery that may be silent is named."""
_NO_PLANT_TIMEOUT_S = 60.0
"""The plant compiles nothing: one that is not found by then is not found through that server."""
SILENCE_TIMEOUT_S = 30.0
"""Silence after which the plant counts as hung; it reports once a second even while it waits."""
AFTER_KILL_S = 10.0
"""Time for which a run continues after a fault has killed its plant."""
IMPOSSIBLE_GAP_M = -1000.0
"""Gap below which messages of different runs must have mixed; the simulation goes on after a collision."""
_LAST_ANSWER_TIMEOUT_S = 2.0
_REST_S = 0.05
_SPIN_S = 0.001
_SHOW_PERIOD_S = 0.2
_QUIET_SPINS = 2
_TIME_TOLERANCE_S = 1e-6
_LAST_ANSWERS = (Topic.SOLVE, Topic.COMMAND, Topic.LEADER)


class DriveOutcome(Enum):
    """How a run ended."""

    FINISHED = "finished"
    FAILED = "failed"
    REFUSED = "refused"
    """A process found a mistake of the user before anything was driven."""
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class DriveResult:
    """End of a run.

    Attributes:
        outcome: how it ended.
        message: what happened, empty if it finished as it should.
        last_lines: last output of the process that caused the end.
        wall_time_s: from the beginning of the trip to its last clock.
    """

    outcome: DriveOutcome
    message: str = ""
    last_lines: tuple[str, ...] = ()
    wall_time_s: float = 0.0


@dataclass(frozen=True, eq=False)
class NodeDrive(AbstractContextManager["NodeDrive"]):
    """Runs the processes of one trip, or of a string; as a context manager it ends them all.

    Attributes:
        supervisor: starts and ends the processes.
        monitors: listen to the vehicles, the first one first.
        executor: runs the monitors.
        progress: shows how far it is.
        stop: set when the user requests a stop.
        process_faults: faults of the processes.
        trip: what the first vehicle drives.
        plants: names of the processes with plants.
    """

    supervisor: Supervisor
    monitors: Sequence[RunMonitor]
    executor: Executor
    progress: Progress
    stop: StopRequest
    process_faults: ProcessFaults
    trip: Trip
    plants: Collection[str] = (PLANT,)

    def __exit__(self, *error: object) -> None:
        """End the recorder last, so that the final messages of the other nodes are in the bag.

        Where a process was killed, the others do not get the time that they may need for it: the middleware
        reports it 20 s later.
        """
        self.progress.close()
        started = self.supervisor.names
        patience_s = INTERRUPT_PATIENCE_S if self.supervisor.has_lost_one else None
        self.supervisor.stop((name for name in started if name != RECORDER), patience_s)
        try:
            self._hear()
        finally:
            self.supervisor.stop(started)

    def start(self, commands: Mapping[str, list[str]]) -> None:
        """Start processes, those that have not been started yet."""
        for name, command in commands.items():
            if name not in self.supervisor.names:
                self.supervisor.start(name, command)
        self.process_faults.note(commands)
        self.expect(commands)

    def expect(self, nodes: Collection[str]) -> None:
        """Take what nodes of these names publish as part of the run."""
        for monitor in self.monitors:
            monitor.expect(nodes)

    def look_around(self, duration_s: float) -> DriveResult:
        """Let the middleware discover others; FINISHED unless a process ended or another run was found."""
        until_s = time.monotonic() + duration_s

        def show() -> DriveResult | None:
            self.progress.waiting("looking for listeners")
            return self._intruded()

        return self._spin_until(lambda: time.monotonic() >= until_s, show)

    def run(self, begun: Callable[[], None] = lambda: None) -> DriveResult:
        """Wait for the trip to begin and to end; all processes must have been started."""
        result = self._wait_for_start()
        if result.outcome is DriveOutcome.FINISHED:
            begun()
            result = self._wait_for_end()
        return replace(result, wall_time_s=self._wall_time_s())

    def _wait_for_start(self) -> DriveResult:
        """Spin until the first clock; the result is FINISHED when it came."""
        began_s = time.monotonic()
        deadline_s = began_s + START_TIMEOUT_S

        def begun() -> bool:
            monitors = self.monitors
            # All at once: in real time, a vehicle that begins early waits for the one behind it.
            if not self._is_held and all(map(_may_begin, monitors)):
                for monitor in monitors:
                    monitor.start_signal.give(PLANT)
            return all(each.began_s is not None for each in monitors) or self._has_ended()

        def show() -> DriveResult | None:
            awaited, waited_s = self._slowest.awaited_nodes, time.monotonic() - began_s
            server = os.environ.get(SERVER_VARIABLE, "") if awaited else ""
            named = f"{SERVER_VARIABLE} {server}" if server and waited_s > _SERVER_TIMEOUT_S else ""
            self.progress.waiting(self._awaited() + (f" at {named}" if named else ""))
            if named and PLANT in awaited and waited_s > _NO_PLANT_TIMEOUT_S:
                return DriveResult(
                    DriveOutcome.FAILED,
                    f"{named}: the plant was not found within {_NO_PLANT_TIMEOUT_S:g} s; allowed: a running "
                    "server, or no such variable",
                )
            if time.monotonic() > deadline_s:
                return DriveResult(
                    DriveOutcome.FAILED,
                    f"the trip did not start within {START_TIMEOUT_S:g} s: {self._awaited()}",
                )
            return self._intruded()

        return self._spin_until(begun, show)

    @property
    def _is_held(self) -> bool:
        """Whether the user begins the trip with `plant/resume`."""
        return self.trip.conditions.start_paused

    def _intruded(self) -> DriveResult | None:
        crowded = self._crowded
        if not crowded:
            return None
        return DriveResult(
            DriveOutcome.REFUSED,
            f"another run takes place in this ROS domain, it publishes {', '.join(crowded)}; "
            "allowed: one run per domain (see --domain)",
        )

    @property
    def _crowded(self) -> tuple[str, ...]:
        topics = (topic for monitor in self.monitors for topic in monitor.crowded_topics)
        return tuple(dict.fromkeys(topics))

    @property
    def _slowest(self) -> RunMonitor:
        """The monitor of the first vehicle that has not begun, else of the one that is furthest behind."""
        return min(self.monitors, key=lambda monitor: monitor.time_ns or -1)

    def _awaited(self) -> str:
        monitor = self._slowest
        meeting = monitor.start_signal.meeting
        absent = [name.rpartition("/")[2] for name in meeting.absent]
        nodes = tuple(dict.fromkeys([*monitor.awaited_nodes, *absent]))
        awaited = nodes or meeting.missing[:1] or monitor.deaf_nodes
        if awaited:
            return f"waiting for {', '.join(awaited)}" + self._of(monitor)
        return (monitor.plant_reason or "waiting for the plant") + self._of(monitor)

    def _of(self, monitor: RunMonitor) -> str:
        """Return which vehicle of a string a monitor listens to, in words."""
        return f" of {monitor.get_namespace()}" if len(self.monitors) > 1 else ""

    def _wait_for_end(self) -> DriveResult:
        """Spin until the plant has ended by itself; resume one that a fault has started again."""

        def show() -> DriveResult | None:
            monitor = self._slowest
            snapshot = monitor.snapshot()
            now_s = time.monotonic()
            if snapshot is not None and monitor.began_s is not None:
                contradiction = self._contradiction(snapshot)
                if contradiction:
                    return DriveResult(DriveOutcome.FAILED, contradiction)
                self.progress.running(snapshot, now_s - monitor.began_s)
            if now_s - monitor.last_sign_s > SILENCE_TIMEOUT_S:
                return DriveResult(
                    DriveOutcome.FAILED,
                    f"no message from the plant{self._of(monitor)} for {SILENCE_TIMEOUT_S:g} s{self._at()}",
                )
            return None

        def over() -> bool:
            if PLANT in self.trip.foreign:
                (monitor,) = self.monitors
                now_ns = monitor.time_ns or 0
                return (
                    now_ns * 1e-9 >= self.trip.route.duration_s - _TIME_TOLERANCE_S
                    or PLANT in monitor.awaited_nodes
                )
            plants = self._current_plants
            self._resume(*plants)
            running = any(map(self.supervisor.is_running, plants))
            if running and self._is_all_answered:
                self.supervisor.stop(plants)  # they wait for late listeners
                running = False
            # Reports of the other nodes about a plant killed by a fault are still recorded.
            silent_s = time.monotonic() - self._slowest.last_sign_s
            killed = any(map(self.process_faults.is_excused, plants))
            return not running and not (killed and silent_s < AFTER_KILL_S)

        result = self._spin_until(over, show)
        killed = [
            ending
            for ending in self.supervisor.endings()
            if ending.name in self._current_plants and ending.code != 0
        ]
        if result.outcome is DriveOutcome.FINISHED and killed:
            return DriveResult(
                DriveOutcome.FAILED, self._what_ended(killed[0]), killed[0].last_lines
            )
        if result.outcome is DriveOutcome.FINISHED:
            self._await_last_answers()
        return result

    @property
    def _is_all_answered(self) -> bool:
        """Whether the last state of the trip, and every answer to it, has arrived, of this run alone."""
        for monitor in self.monitors:
            last_ns = monitor.time_ns or 0
            is_over = last_ns * 1e-9 >= self.trip.route.duration_s - _TIME_TOLERANCE_S
            topics = Topic.PLANT_STATE, *_LAST_ANSWERS
            if not (is_over and all(monitor.newest_stamp_ns(each) == last_ns for each in topics)):
                return False
        return not self._crowded

    @property
    def _current_plants(self) -> tuple[str, ...]:
        """Processes with plants by their present names."""
        return tuple(map(self.process_faults.current, self.plants))

    def _resume(self, plant: str, *others: str) -> None:
        if not (self._is_held or others):  # only a plant of its own is started again by a fault
            self.monitors[0].start_signal.give(plant)

    def _contradiction(self, snapshot: Snapshot) -> str:
        """Return evidence that messages of another run are mixed in, empty if there is none."""
        duration_s = self.trip.route.duration_s
        if snapshot.time_s > duration_s + _TIME_TOLERANCE_S:
            found = f"the clock is at {snapshot.time_s:g} s of a trip of {duration_s:g} s"
        elif snapshot.gap_m < IMPOSSIBLE_GAP_M and not self.trip.conditions.faults:
            # A fault may show another leader than the one that is followed.
            found = f"the gap is {snapshot.gap_m:.0f} m at {snapshot.time_s:g} s"
        else:
            return ""
        crowded = ", ".join(self._crowded)
        others = f", which publish {crowded} as well" if crowded else ""
        return f"{found}: nodes of another run take part in this ROS domain{others}"

    def _spin_until(
        self, condition: Callable[[], bool], show: Callable[[], DriveResult | None]
    ) -> DriveResult:
        """Spin, look after the processes and show progress until a condition is true."""
        next_show_s = time.monotonic()
        while True:
            self._hear()
            first = self.monitors[0]
            self.process_faults.act(first.time_ns, first.clocks, first.is_doubled)
            now_s = time.monotonic()
            if self.stop.number is not None:
                return DriveResult(DriveOutcome.INTERRUPTED, f"stopped by {self.stop.number.name}")
            failure = self._failure()
            if failure is not None:
                return failure
            if condition():
                return DriveResult(DriveOutcome.FINISHED)
            if now_s >= next_show_s:
                next_show_s = now_s + _SHOW_PERIOD_S
                ended = show()
                if ended is not None:
                    return ended

    def _failure(self) -> DriveResult | None:
        """Return what went wrong, if a process ended that should not have."""
        for ending in self.supervisor.endings():
            started = self._slowest.time_ns is not None
            if self.process_faults.is_excused(ending.name):
                continue
            if ending.name in self._current_plants and ending.code == 0 and self._is_witnessed:
                continue
            if ending.code == EXIT_USER_ERROR and not started:
                reason = ending.last_lines[-1] if ending.last_lines else ""
                return DriveResult(DriveOutcome.REFUSED, reason or f"{ending.name} {ending.how}")
            return DriveResult(DriveOutcome.FAILED, self._what_ended(ending), ending.last_lines)
        return None

    def _has_ended(self) -> bool:
        """Return whether the plant ended as it does after a trip.

        The runner may have received nothing of a recorded trip: the bag decides.
        """
        plants = self._current_plants
        return self._is_witnessed and any(
            ending.name in plants and ending.code == 0 for ending in self.supervisor.endings()
        )

    @property
    def _is_witnessed(self) -> bool:
        return self._slowest.time_ns is not None or RECORDER in self.supervisor.names

    def _what_ended(self, ending: ProcessEnd) -> str:
        is_plant = ending.name == PLANT and ending.code
        reason = f" ({self._slowest.plant_reason})" if is_plant else ""
        return f"{ending.name} {ending.how}{reason}{self._at()}; the other processes of this run were stopped"

    def _at(self) -> str:
        now_ns = self._slowest.time_ns
        return (
            " before the trip began" if now_ns is None else f" at {now_ns * 1e-9:g} s of the trip"
        )

    def _await_last_answers(self) -> None:
        """Give bridge and controller time to answer the last state, so that every run ends alike."""
        deadline_s = time.monotonic() + _LAST_ANSWER_TIMEOUT_S
        while time.monotonic() < deadline_s:
            if all(map(_has_last_answers, self.monitors)):
                return
            self._hear()

    def _hear(self) -> None:
        """Rest briefly, then take all messages that have arrived.

        Waking at every message would double the CPU time of the runner at the cost of the nodes.
        """
        time.sleep(_REST_S)
        quiet, before = 0, self._message_count
        while quiet < _QUIET_SPINS:
            self.executor.spin_once(timeout_sec=_SPIN_S)
            heard = self._message_count
            quiet, before = (quiet + 1 if heard == before else 0), heard

    @property
    def _message_count(self) -> int:
        return sum(monitor.message_count for monitor in self.monitors)

    def _wall_time_s(self) -> float:
        began = [each.began_s for each in self.monitors if each.began_s is not None]
        last = [each.last_clock_s for each in self.monitors if each.last_clock_s is not None]
        return max(last) - min(began) if began and last else 0.0


def _may_begin(monitor: RunMonitor) -> bool:
    is_met = monitor.start_signal.meeting.is_complete
    return is_met and not (monitor.awaited_nodes or monitor.deaf_nodes)


def _has_last_answers(monitor: RunMonitor) -> bool:
    newest = {topic: monitor.newest_stamp_ns(topic) for topic in _LAST_ANSWERS}
    if newest[Topic.LEADER] is None:
        del newest[Topic.LEADER]  # an empty road
    return all(stamp_ns == monitor.time_ns for stamp_ns in newest.values())
