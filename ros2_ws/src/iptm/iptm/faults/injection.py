"""Faults in the loop without ROS: measured values, a solver that fails on demand, and an impaired vehicle.

The vehicle acts on commands late, has weak brakes, slips, or does not cool.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.faults.signals import (
    Delay,
    PreviewFaults,
    RangeSensorFaults,
    StateFaults,
    Traffic,
    faulty_slope,
)
from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.interface import (
    STATUS_TEXT,
    SolverBackend,
    SolveResult,
    Stopwatch,
    broken,
)
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.settings import ThermalModel
from iptm_core.state import (
    NS_PER_S,
    Command,
    FloatArray,
    LeaderPreview,
    LeaderState,
    SlopePreview,
    VehicleState,
)
from iptm_plant_sim.integrator import PackIntegration
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

NO_LEADER = "no measurement of the leader received"


def check_headless(faults: Iterable[Fault]) -> None:
    """Refuse faults that cannot happen without ROS."""
    for fault in faults:
        if not fault.spec.headless:
            allowed = ", ".join(kind for kind in FaultKind if kind.spec.headless)
            raise ScenarioError(f"fault is {fault.kind}; allowed without ROS: {allowed}")


class FaultInjection:
    """Changes traffic and measurements of a closed loop; ticks in increasing order of time.

    The controller is given what its node would give it: missing inputs are left out, with the reason.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = tuple(faults)
        check_headless(self._faults)
        self._traffic = Traffic(self._faults)
        self._previews = PreviewFaults(self._faults)
        self._sensor = RangeSensorFaults(self._faults)
        self._states = StateFaults(self._faults)
        self._road = at_places(self._faults, FaultPlace.ROAD)
        self._slope: tuple[tuple[bool, ...], SlopePreview] | None = None
        # The controller acts on measurements of one stamp, so all are as late.
        self._delay: Delay[Measurements] = Delay(self._faults, FaultKind.STATE_DELAYED)

    def disturb(self, measured: Measurements) -> tuple[LeaderState, Measurements]:
        """Return the effective leader, and the measurements that the controller receives.

        Args:
            measured: state, leader, preview and slope as they are; all but the preview are there.
        """
        state, own = measured.state, measured.leader
        if state is None or own is None:
            raise ScenarioError(
                "measurements lack state or leader; allowed: complete outputs of plant and bridge"
            )
        now_ns = round(state.time_s * NS_PER_S)
        leader = self._traffic.leader(own, state.position_m)
        faulty = self._sensor.leader(now_ns, leader, state.position_m)
        preview = self._previews.apply(now_ns, self._traffic.preview(measured.preview))
        seen = replace(
            measured,
            state=self._states.apply(now_ns, state),
            leader=faulty,
            preview=LeaderPreview.empty() if preview is None else preview,
            slope=self._faulty_slope(now_ns, measured.slope),
            fault="" if faulty is not None else NO_LEADER,
        )
        return leader, self._delay.delayed(now_ns, seen)

    def sampled(self, own: LeaderPreview, ego_position_m: float) -> LeaderPreview | None:
        """Return the measurements of a range sensor in an interval.

        Args:
            own: the leader of the route at the instants of the interval, the first of which is a tick.
            ego_position_m: where the ego vehicle is at the first of them.

        Returns:
            The measurements that arrive, None for none.
        """
        true = own if self._traffic.is_quiet else self._traffic.sampled(own, ego_position_m)
        return self._sensor.samples(true, ego_position_m)

    def _faulty_slope(self, now_ns: int, slope: SlopePreview) -> SlopePreview:
        if not self._road:
            return slope
        hit = tuple(fault.hits(now_ns) for fault in self._road)
        if self._slope is None or self._slope[0] != hit:
            self._slope = (hit, faulty_slope(self._road, now_ns, slope))
        return self._slope[1]


_STATUS = {
    FaultKind.SOLVER_TIMEOUT: SolveStatus.DEADLINE,
    FaultKind.SOLVER_NOT_CONVERGED: SolveStatus.ITERATION_LIMIT,
}


class FaultySolver:
    """A back end that does not answer as it should while a fault hits.

    Attributes:
        now_ns: trip time of the problem that is solved next.
    """

    def __init__(
        self,
        inner: SolverBackend,
        faults: Iterable[Fault],
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._inner = inner
        self._faults = at_places(faults, FaultPlace.SOLVER)
        self._sleep = sleep
        self.now_ns = 0

    @property
    def name(self) -> str:
        """Name of the wrapped back end."""
        return self._inner.name

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem, or fail to; see ``SolverBackend``.

        Raises:
            RuntimeError: a fault of the kind ``solver_exception`` hits.
        """
        for fault in self._faults:
            if not fault.hits(self.now_ns):
                continue
            if fault.kind is FaultKind.SOLVER_EXCEPTION:
                raise RuntimeError("exception of the solver, asked for by a fault")
            spent_s = fault.magnitude if fault.kind is FaultKind.SOLVER_TIMEOUT else 0.0
            self._sleep(spent_s)
            status = _STATUS[fault.kind]
            failed = broken(guess, Stopwatch(), "asked for by a fault")
            return replace(
                failed,
                status=status,
                reason=STATUS_TEXT[status],
                time_s=spent_s,
                wall_time_s=spent_s,
            )
        return self._inner.solve(data, guess, most_iterations=most_iterations)


class FaultyController(MpcController):
    """The controller, with a solver that fails on demand."""

    def __init__(
        self,
        parameters: ModelParameters,
        sound: MpcController,
        faults: Iterable[Fault],
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._solver = FaultySolver(sound.backend, faults, sleep)
        super().__init__(parameters, sound.options, self._solver)

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick."""
        if measured.state is not None:
            self._solver.now_ns = round(measured.state.time_s * NS_PER_S)
        return super().decide(measured)


STANDING_FLOW = 1e-6
"""Share of the heat transfer that is left where the coolant stands; above 0, as the loop is solved for it."""


def faulty(kind: type[Plant]) -> type[FaultyPlant]:
    """Return a kind of plant with faults of its actuators."""
    if kind is Plant:
        return FaultyPlant
    return type(f"Faulty{kind.__name__}", (FaultyPlant, kind), {})


class FaultyPlant(Plant):
    """The simulated vehicle with faults of its actuators, its cooling and the road under it.

    Unlike the base class it stores the commands of a trip; a state earlier than the last starts a new trip.
    """

    def __init__(self, faults: Iterable[Fault], *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        own = at_places(faults, FaultPlace.VEHICLE)
        self._delay: Delay[Command] = Delay(own, FaultKind.COMMAND_DELAYED)
        self._own = own
        self._steeper_rad = 0.0
        self._with_flow = self._without_flow = self._pack
        if any(fault.kind is FaultKind.PUMP_OFF for fault in own):
            values, all_cells = self.parameters, self._has_all_cells
            h_w_k = STANDING_FLOW * values.cooling.convective_coefficient_w_k
            # The heater warms coolant that stands, not the cells.
            cooling = replace(
                values.cooling, convective_coefficient_w_k=h_w_k, heater_performance=0.0
            )
            model = ThermalModel.FULL_CHANNEL if all_cells else ThermalModel.TWO_CELL
            self._without_flow = PackIntegration(replace(values, cooling=cooling), model)
        on_map = self._slope_at
        self._slope_at = lambda positions_m: on_map(positions_m) + self._steeper_rad

    def advance(self, state: VehicleState, command: Command, duration_s: float = 1.0) -> PlantStep:
        """Carry out a command for one interval; see ``Plant``."""
        now_ns = round(state.time_s * NS_PER_S)
        command = self._delay.delayed(now_ns, command)
        self.brake_strength = min(self._sizes(FaultKind.BRAKES_WEAK, now_ns), default=1.0)
        self.road_friction = min(self._sizes(FaultKind.ROAD_SLIPPERY, now_ns), default=0.0)
        self._steeper_rad = sum(self._sizes(FaultKind.ROAD_STEEPER, now_ns))
        if self._hits(FaultKind.COMPRESSOR_DEAD, now_ns):
            state = replace(state, compressor_power_w=0.0)
            command = replace(command, compressor_power_w=0.0)
        stands = self._hits(FaultKind.PUMP_OFF, now_ns)
        self._pack = self._without_flow if stands else self._with_flow
        step = super().advance(state, command, duration_s)
        if not stands:
            return step
        mean_k = 0.5 * (step.state.cell_1_temperature_k + step.state.cell_n_temperature_k)
        return replace(
            step, coolant_inlet_temperature_k=mean_k, coolant_outlet_temperature_k=mean_k
        )

    def _hits(self, kind: FaultKind, time_ns: int) -> bool:
        return any(one.kind is kind and one.hits(time_ns) for one in self._own)

    def _sizes(self, kind: FaultKind, time_ns: int) -> list[float]:
        return [one.magnitude for one in self._own if one.kind is kind and one.hits(time_ns)]
