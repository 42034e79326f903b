"""One run: performed here, by whichever process, and kept as it is by the store.

Nothing is shared between runs: a solver may carry multipliers or counters from solve to solve, and a run
must give the same numbers whatever its process did before. With a warm compiler cache the set-up takes a
fraction of a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import cached_property

from iptm.channel_record import ChannelRecord, channel_record
from iptm.closed_loop import TickController, run_closed_loop
from iptm.driving import vehicle_reports
from iptm.faults.injection import FaultInjection
from iptm.faults.solver import FaultyController
from iptm.faults.vehicle import FaultyPlant
from iptm.run import Report, Reporter
from iptm.studies.run_spec import RunKind, RunSpec
from iptm.studies.study import Case
from iptm.whole_trip import WholeTripRecord, solve_whole_trip
from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.factory import SolverOptions
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.decision_record import DecisionSeries
from iptm_core.declaration import given_settings
from iptm_core.metrics import RunMetrics, compute_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.provenance import git_revision, versions
from iptm_core.road_friction import RoadFrictionSettings
from iptm_core.settings import SafetyMonitorSettings, SensorAccuracySettings, ThermalModel
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import PreviewSource
from iptm_v2x_bridge.rules_of_the_road import road_bridge

_REPORTED_LIBRARIES = ("casadi", "numpy", "pyarrow")


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run.

    Attributes:
        key: of everything that its numbers depend on.
        decisions: how the decisions came about; None for a whole trip.
        whole_trip: how a whole trip was solved; None for a closed loop.
        channel: what all cells of a coolant channel went through; None where the plant has but two, and
            for a whole trip.
        reports: what was reported during a closed loop, on every change.
        wall_time_s: of set-up and run.
        compiled: the problem ran as machine code.
        finished_at_utc: ISO 8601.
        git_revision: commit of the source, with ``-dirty`` if it was changed.
        versions: of interpreter, platform and libraries by name.
        fingerprint: of code and libraries.
    """

    key: str
    spec: RunSpec
    parameters: ModelParameters
    trajectory: Trajectory
    decisions: DecisionSeries | None
    whole_trip: WholeTripRecord | None
    wall_time_s: float
    compiled: bool
    finished_at_utc: str
    git_revision: str
    versions: Mapping[str, str]
    fingerprint: str
    channel: ChannelRecord | None = None
    reports: tuple[Report, ...] = ()

    @property
    def ticks(self) -> int:
        """Number of intervals that were driven."""
        return len(self.trajectory) - 1

    @cached_property
    def metrics(self) -> RunMetrics:
        """What the run achieved, worked out from its trajectory with today's metrics."""
        return compute_metrics(self.trajectory, self.parameters, self.decisions)


def perform_run(
    inputs: Case,
    on_progress: Callable[[], None] | None = None,
    own_controller: TickController | None = None,
    leader: PreviewSource | None = None,
    own_law: AgingLaw | None = None,
    on_tick: Callable[[int, Measurements, Decision], None] | None = None,
) -> Run:
    """Perform a run.

    Args:
        inputs: the run.
        on_progress: called after every tick of a closed loop and every solve of a whole trip.
        own_controller: drives instead of the specified one; such a run cannot be stored.
        leader: motion and predictions of the leader, where they are not those of the route.
        own_law: ageing law of the controller instead of the specified one; such a run cannot be stored.
        on_tick: called after every decision with the tick, what was measured and what was decided.

    Raises:
        IptmError: the run cannot be set up or leads nowhere.
    """
    reports: list[Report] = []

    def progress(*_: object) -> None:
        if on_progress is not None:
            on_progress()

    def note(tick: int, measured: Measurements, decision: Decision) -> None:
        if on_tick is not None:
            on_tick(tick, measured, decision)
        if decision.reason != (reports[-1].text if reports else ""):
            reports.append(Report(tick * spec.tick_s, Reporter.CONTROLLER, decision.reason))
        progress()

    spec, route = inputs.spec, inputs.route
    began = time.perf_counter()
    vehicle = (
        inputs.parameters,
        route.slope.slope_at,
        spec.plant_step_s,
        spec.thermal_model,
        given_settings(SafetyMonitorSettings, vars(spec)),
    )
    plant = Plant(*vehicle)
    controller, compiled = (
        _controller(inputs, own_law) if own_controller is None else (own_controller, False)
    )
    faults = None
    if spec.faults:
        plant = FaultyPlant(spec.faults, *vehicle)
        faults = FaultInjection(spec.faults)
    source, bridge = road_bridge(
        spec.road, route, inputs.parameters, spec.bridge_settings(), leader
    )
    loop = run_closed_loop(
        route,
        plant,
        controller,
        on_tick=note,
        faults=faults,
        bridge=bridge,
        leader=source,
    )
    trajectory: Trajectory = loop.trajectory
    decisions: DecisionSeries | None = loop.decisions
    channel: ChannelRecord | None = None
    whole_trip: WholeTripRecord | None = None
    if spec.kind is RunKind.WHOLE_TRIP:
        # What the closed loop of the same strategy drove is the first guess.
        trajectory, whole_trip = solve_whole_trip(
            route, plant, spec.strategy, trajectory, spec.tick_s, on_solve=progress
        )
        decisions = None
    elif spec.thermal_model is ThermalModel.FULL_CHANNEL:
        two_cells = Plant(inputs.parameters, route.slope.slope_at, spec.plant_step_s)
        channel = channel_record(loop.steps, two_cells, spec.tick_s)
    return Run(
        key=inputs.key,
        spec=spec,
        parameters=inputs.parameters,
        trajectory=trajectory,
        decisions=decisions,
        whole_trip=whole_trip,
        channel=channel,
        reports=(*reports, *vehicle_reports(loop.steps)),
        wall_time_s=time.perf_counter() - began,
        compiled=compiled,
        finished_at_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        git_revision=git_revision(),
        versions=versions(_REPORTED_LIBRARIES),
        fingerprint=inputs.fingerprint,
    )


def _controller(inputs: Case, own_law: AgingLaw | None) -> tuple[TickController, bool]:
    """Return the specified controller, and whether its problem runs as machine code."""
    spec = inputs.spec
    model = inputs.controller_parameters or inputs.parameters
    options = controller_options(spec, inputs.route.duration_s)
    controller = Controller(model, replace(options, own_law=own_law))
    compiled = controller.backend.compiled
    if not spec.faults:
        return controller, compiled
    return FaultyController(model, controller, spec.faults, lambda _: None), compiled


def controller_options(spec: RunSpec, trip_duration_s: float) -> ControllerOptions:
    """Return the options of the controller of a run; with the end of the trip, as from navigation.

    What is not specified of the solver is the controller's default.
    """
    return ControllerOptions(
        strategy=spec.strategy,
        horizon=Horizon.parse(spec.horizon),
        solver=SolverOptions(**spec.solver_settings),
        tick_s=spec.tick_s,
        trip_duration_s=trip_duration_s,
        accuracy=SensorAccuracySettings.of(spec),
        road=RoadFrictionSettings.of(spec),
        aging=AgingSettings.of(spec),
        charging_stop=ChargingStopSettings.of(spec),
    )
