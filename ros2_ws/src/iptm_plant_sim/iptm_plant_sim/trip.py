"""One trip of the simulated vehicle: its position, history and rest, and its time by the steady clock."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from enum import Enum

from iptm_core.errors import StateError
from iptm_core.frozen import replace
from iptm_core.physics.car_following import controlled_stop_command
from iptm_core.state import NS_PER_S, Command, CommandSource, VehicleState
from iptm_plant_sim.actuators import Clamp
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.service_braking import RangeSensor

RECENT_TICKS = 10
"""Ticks for which a limited command is reported."""


class TripPhase(Enum):
    """Where the trip stands; the value is what diagnostics show."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    FINISHED = "finished"


class PlantTrip:
    """Advances the plant tick by tick and keeps its records.

    Attributes:
        plant: that drives it.
        step: the latest observation, at trip time `stamp_ns`.
        clamps: how often each limit changed a command.
        limited_ticks: number of intervals in which any did.
        interventions: number of intervals in which the safety monitor began to brake.
        service_braking_s: how long it braked.
        last_reason: the latest correction in words, empty if there was none.
    """

    def __init__(
        self,
        plant: Plant,
        duration_s: float,
        period_s: float = 1.0,
        start: VehicleState | PlantStep | None = None,
        first_tick: int = 0,
    ) -> None:
        """Place the vehicle at the start.

        Args:
            duration_s: length of the trip, rounded up to whole periods.
            start: state at the start; by default the plant's initial state. An observation of another trip
                is taken as it is.

        Raises:
            StateError: the start state is not possible, or the trip is over before.
        """
        self.plant = plant
        self._duration_s = duration_s
        self._period_s = period_s
        self._start = start
        self._period_ns = round(period_s * NS_PER_S)
        self.parameters = plant.parameters
        self.ticks = max(1, -(-round(duration_s * NS_PER_S) // self._period_ns))
        self._first_tick = first_tick
        if not 0 <= first_tick < self.ticks:
            raise StateError(f"trip begins at tick {first_tick}; allowed: 0 to {self.ticks - 1}")
        self.tick = first_tick
        self.step: PlantStep = (
            start
            if isinstance(start, PlantStep)
            else plant.observe(plant.initial_state() if start is None else start)
        )
        plant.resume(self.step.memory)
        self.clamps: Counter[Clamp] = Counter()
        self.limited_ticks = 0
        self.interventions = 0
        self.service_braking_s = 0.0
        self.last_reason = ""
        self._last_limited_tick = -RECENT_TICKS

    @property
    def stamp_ns(self) -> int:
        """Trip time of the latest state in integer nanoseconds, free of accumulated rounding."""
        return self.tick * self._period_ns

    @property
    def is_over(self) -> bool:
        """Whether the last interval has been driven."""
        return self.tick >= self.ticks

    @property
    def is_limited(self) -> bool:
        """Whether a command was limited a short while ago."""
        return self.tick - self._last_limited_tick < RECENT_TICKS

    def watch(self, sensor: RangeSensor) -> None:
        """Let the safety monitor of the plant watch the vehicle ahead."""
        self.plant.watch(sensor, self.step.memory)

    def restarted(self) -> PlantTrip:
        """Return the same trip at its start, driven by the same plant."""
        return PlantTrip(
            self.plant, self._duration_s, self._period_s, self._start, self._first_tick
        )

    def warm_up(self) -> None:
        """Let the plant build its integrator now instead of in the first interval."""
        self.plant.advance(self.step.state, self.stop_command(), self._period_s)
        self.plant.resume(self.step.memory)

    def stop_command(self) -> Command:
        """Next command of the controlled stop from here."""
        return controlled_stop_command(self.step.state, self.parameters.limits, self._period_s)

    def advance(
        self, command: Command | None, source: CommandSource = CommandSource.ANSWER
    ) -> PlantStep:
        """Drive one interval, None as the controlled stop, and return the observation at its end."""
        driven = command or self.stop_command()
        step = self.plant.advance(self.step.state, driven, self._period_s)
        before = self.step.memory
        self.tick += 1
        exact_time = replace(step.state, time_s=self.stamp_ns / NS_PER_S)
        if command is None:
            source = CommandSource.STOP
        safety = step.safety
        if source is not CommandSource.ANSWER:
            safety = replace(safety, command_source=float(source))
        self.step = replace(step, state=exact_time, safety=safety)
        self.service_braking_s += step.safety.service_braking_s
        if (step.memory.since_s, step.memory.reason) != (before.since_s, before.reason):
            self.interventions += 1
        if step.report.clamps:
            self.clamps.update(step.report.clamps)
            self.limited_ticks += 1
            self.last_reason = step.report.reason
            self._last_limited_tick = self.tick
        return self.step


class CommandHold:
    """The newest command and its age in trip time, for a plant that does not wait.

    A command ages from the stamp of the state it answers, not from its arrival: a controller that repeats
    an old answer does not make it fresh.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_ns = round(timeout_s * NS_PER_S)
        self._stamp_ns = 0
        self._command: Command | None = None

    def offer(self, stamp_ns: int, command: Command, now_ns: int) -> bool:
        """Take a command if it is newer than the held one and not from the future.

        Args:
            stamp_ns: stamp of the state that the command answers.
        """
        newer = self._command is None or stamp_ns > self._stamp_ns
        if not newer or not 0 <= stamp_ns <= now_ns:
            return False
        self._stamp_ns, self._command = stamp_ns, command
        return True

    def answers(self, now_ns: int) -> bool:
        """Whether the held command answers the state of now."""
        return self._command is not None and self._stamp_ns == now_ns

    def age_s(self, now_ns: int) -> float:
        """Trip time since the state that the held command answers; since the start without one."""
        return (now_ns - self._stamp_ns) / NS_PER_S

    def is_lost(self, now_ns: int) -> bool:
        """Whether the age exceeds the timeout."""
        return now_ns - self._stamp_ns > self._timeout_ns

    def command_at(self, now_ns: int) -> tuple[Command | None, CommandSource]:
        """The command to carry out now, None if there is none or it is too old, and whether it was held."""
        source = CommandSource.ANSWER if self.answers(now_ns) else CommandSource.HELD
        return None if self.is_lost(now_ns) else self._command, source


class Slots:
    """Counts the missed slots of a periodic activity.

    Missed slots are skipped: after a delay the activity continues with the next slot, so that
    subscribers get no burst.

    Attributes:
        overruns: slots missed so far.
        worst_lateness_s: longest delay of a call behind its slot.
    """

    def __init__(
        self, period_s: float, steady_time_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Set up a schedule whose first slot lies one period ahead of now."""
        self._period_s = period_s
        self._steady_time_s = steady_time_s
        self._next_s = steady_time_s() + period_s
        self.overruns = 0
        self.worst_lateness_s = 0.0

    def begin_again(self) -> None:
        """Restart one period ahead of now, after an intended pause."""
        self._next_s = self._steady_time_s() + self._period_s

    def keep(self) -> None:
        """Note that the activity runs now."""
        lateness_s = self._steady_time_s() - self._next_s
        missed = max(0, int(lateness_s // self._period_s))
        self.overruns += missed
        self.worst_lateness_s = max(self.worst_lateness_s, lateness_s)
        self._next_s += (missed + 1) * self._period_s


class TimeBetweenTicks:
    """Trip time that has passed since the last tick, and never reaches the next one."""

    def __init__(
        self,
        period_s: float,
        rate_factor: float = 1.0,
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up a time that has not begun."""
        self._last_ns = round(period_s * NS_PER_S) - 1
        self._rate_factor = rate_factor
        self._steady_time_s = steady_time_s
        self._tick_ns = 0
        self._began_s = 0.0
        self._taken_ns = self._last_ns

    def begin(self, tick_ns: int) -> None:
        """Begin at a tick, which is being published now."""
        self._tick_ns, self._began_s, self._taken_ns = tick_ns, self._steady_time_s(), 0

    def end(self) -> None:
        """Give no more times before the next beginning."""
        self._taken_ns = self._last_ns

    def take_ns(self) -> int | None:
        """Return the present trip time; None where it is not later than the one before."""
        passed_ns = round((self._steady_time_s() - self._began_s) * self._rate_factor * NS_PER_S)
        passed_ns = min(passed_ns, self._last_ns)
        if passed_ns <= self._taken_ns:
            return None
        self._taken_ns = passed_ns
        return self._tick_ns + passed_ns
