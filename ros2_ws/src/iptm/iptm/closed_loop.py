"""The closed loop without ROS: the pure parts of plant, bridge and controller, tick by tick.

Events are ordered as in the lock-step mode of the nodes, so both give the same numbers.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Protocol, TypeVar

from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_core.decision_record import DecisionRecord, DecisionSeries
from iptm_core.errors import PackEmptyError
from iptm_core.program import no_full_collections
from iptm_core.routes.route import Route
from iptm_core.settings import PreviewSettings
from iptm_core.state import (
    NS_PER_S,
    FloatArray,
    LeaderPreview,
    LeaderState,
    VehicleState,
)
from iptm_core.trajectory import Trajectory, trajectory_row
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import (
    CycleSource,
    PreviewSource,
    TickBridge,
    V2xBridge,
    sampling_times_s,
)

Finished = TypeVar("Finished")


class Disturbance(Protocol):
    """What faults make of a trip, see ``iptm.faults.injection``."""

    def disturb(self, measured: Measurements) -> tuple[LeaderState, Measurements]:
        """Return the leader that counts and the measurements of the controller, from the true values."""
        ...

    def sampled(self, own: LeaderPreview, ego_position_m: float) -> LeaderPreview | None:
        """Return what the sensor of the safety monitor measures between two ticks, None for nothing.

        ``own`` is the leader of the route at the instants, the ego vehicle is where it is at the first of
        them.
        """
        ...


class World(Protocol):
    """The surroundings of the ego vehicle: the leader as it is, and whatever else moves in an interval."""

    def pass_interval(self, before: VehicleState, after: VehicleState) -> None:
        """Let an interval pass in which the ego vehicle moves from one state to the other."""
        ...

    def leader_at(self, time_ns: int) -> LeaderState | None:
        """Return the leader at the present tick (integer nanoseconds of trip time), None without one."""
        ...

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return what a range sensor measures in the interval ahead; see `PreviewSource.sampled`."""
        ...


class LeaderOnly:
    """A world of one vehicle, which moves whatever the ego vehicle does: recorded, or driven before."""

    def __init__(self, leader: PreviewSource) -> None:
        self.leader_at, self.sampled = leader.leader_at, leader.sampled

    def pass_interval(self, before: VehicleState, after: VehicleState) -> None:
        """Do nothing."""


class TickController(Protocol):
    """What decides tick by tick: the controller of the suite, or another one.

    Attributes:
        options: of which the loop uses the sampling time.
    """

    options: ControllerOptions

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick."""
        ...


@dataclass(frozen=True)
class ClosedLoopRun:
    """A finished trip.

    Attributes:
        last: the simulated vehicle at the end.
        ended: why it ended before its time, empty if it did not.
    """

    trajectory: Trajectory
    decisions: DecisionSeries
    last: PlantStep
    ended: str = ""


@no_full_collections()
def run_closed_loop(
    route: Route,
    plant: Plant,
    controller: TickController,
    bridge_settings: PreviewSettings | None = None,
    on_tick: Callable[[int, Measurements, Decision], None] | None = None,
    faults: Disturbance | None = None,
    bridge: TickBridge | None = None,
    leader: PreviewSource | None = None,
    start_position_m: float = 0.0,
    on_step: Callable[[PlantStep, LeaderState | None], None] | None = None,
    world: World | None = None,
    start: VehicleState | None = None,
) -> ClosedLoopRun:
    """Drive a route, to its end or until the pack is empty.

    Args:
        route: leader, slope and length of the trip.
        plant: the simulated vehicle, with the same slope.
        controller: a fresh controller.
        bridge_settings: preview length and imperfections.
        on_tick: called after every decision with the tick, its measurements and its decision.
        faults: None for none; with them, the trajectory has the leader that counts and the true state.
        bridge: a fresh bridge whose source of the leader is not the route itself; it has settings
            of its own.
        leader: who drives ahead, where it is not the leader of the route.
        start_position_m: where the ego vehicle starts, along the road.
        on_step: called with vehicle and leader, if there is one, at every instant, the last one included.
        world: surroundings of the ego vehicle; None for a leader only, from ``leader`` or the route.
        start: state of the vehicle at the beginning; None for standstill at ``start_position_m``.
    """
    source = CycleSource(route) if leader is None else leader
    loop = closed_loop(
        route,
        plant,
        controller.options.tick_s,
        bridge or V2xBridge(source, bridge_settings),
        world or LeaderOnly(source),
        start or plant.initial_state(start_position_m),
        on_tick,
        faults,
        on_step,
    )
    return decided(loop, controller)


def decided(
    loop: Generator[Measurements, Decision, Finished], controller: TickController
) -> Finished:
    """Answer what a loop measures with the decisions of a controller; returns what the loop returns."""
    try:
        measured = next(loop)
        while True:
            measured = loop.send(controller.decide(measured))
    except StopIteration as end:
        finished: Finished = end.value
        return finished


def closed_loop(
    route: Route,
    plant: Plant,
    tick_s: float,
    bridge: TickBridge,
    world: World,
    start: VehicleState,
    on_tick: Callable[[int, Measurements, Decision], None] | None = None,
    faults: Disturbance | None = None,
    on_step: Callable[[PlantStep, LeaderState | None], None] | None = None,
) -> Generator[Measurements, Decision, ClosedLoopRun]:
    """Drive tick by tick, as `run_closed_loop`, with decisions from outside.

    Args:
        start: state of the vehicle at the beginning.

    Yields:
        Measurements of a tick; the decision on them is to be sent.
    """
    ticks = round(route.duration_s / tick_s)
    slope = CycleSource(route).slope_ahead()
    step = plant.observe(start)

    def measure(step: PlantStep, tick: int) -> tuple[LeaderState | None, Measurements]:
        state = step.state
        time_ns = round(tick * tick_s * NS_PER_S)
        answer = bridge.answer(time_ns, state.position_m, state.speed_m_s)
        measured = Measurements(
            state, answer.leader, answer.preview, slope, road=answer.road, pack=step.pack_reading
        )
        # The trajectory holds the true leader, not the estimated one.
        return faults.disturb(measured) if faults else (world.leader_at(time_ns), measured)

    leader_now, measured = measure(step, 0)
    tick = 0

    def range_sensor(state: VehicleState) -> LeaderPreview | None:
        """Measure the leader that counts."""
        now_ns = round(tick * tick_s * NS_PER_S)
        own = world.sampled(sampling_times_s(now_ns, tick_s, period_s))
        return faults.sampled(own, state.position_m) if faults else own

    plant.watch(range_sensor)
    period_s = plant.monitor.settings.monitor_period_s
    rows = array("d")

    def observe(step: PlantStep, leader_now: LeaderState | None) -> None:
        rows.extend(trajectory_row(step, leader_now))
        if on_step is not None:
            on_step(step, leader_now)

    records: list[DecisionRecord] = []
    ended = ""
    for tick in range(ticks):
        observe(step, leader_now)
        decision = yield measured
        records.append(decision.record)
        if on_tick is not None:
            on_tick(tick, measured, decision)
        before = step.state
        plant.hear(measured.preview)
        try:
            step = plant.advance(before, decision.command, tick_s)
        except PackEmptyError as error:
            if not tick:
                raise
            ended = f"at {before.time_s:g} s: {error}"
            records.pop()
            break
        world.pass_interval(before, step.state)
        leader_now, measured = measure(step, tick + 1)
    else:
        observe(step, leader_now)
    plant.watch(None)  # its sensor belongs to this trip
    trajectory = Trajectory.from_rows(rows)
    return ClosedLoopRun(
        trajectory,
        DecisionSeries.from_records(trajectory.time_s[:-1].tolist(), records),
        step,
        ended,
    )
