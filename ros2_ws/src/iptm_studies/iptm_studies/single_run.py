"""Performs one run: what a worker does.

Nothing is shared between runs: a solver may carry multipliers or counters from solve to solve, and a run
must give the same numbers whatever its process did before. With a warm compiler cache the set-up takes a
fraction of a second.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import Horizon
from iptm_controller.solvers.factory import SolverOptions
from iptm_core.decision_record import DecisionSeries, SolveStatus
from iptm_core.errors import ScenarioError
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_studies.fingerprint import code_fingerprint
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind, RunSpec, SolverSpec
from iptm_studies.whole_trip import WholeTripOptions, WholeTripRun, solve_whole_trip


@dataclass(frozen=True)
class WholeTripSolve:
    """One solve of a whole trip, for the record; None stands for a figure that does not exist."""

    status: str
    iterations: int
    time_s: float
    objective: float | None
    infeasibility: float | None
    moved_m: float | None


@dataclass(frozen=True)
class WholeTripRecord:
    """How a whole trip was solved.

    Attributes:
        settled: the last solve is usable.
        solves: every solve, in order.
        gap_slack_m: largest violation of a gap limit in the plan.
        speed_slack_m_s: largest violation of a speed limit in the plan.
        temperature_slack_k: largest violation of a temperature limit in the plan.
    """

    settled: bool
    solves: tuple[WholeTripSolve, ...]
    gap_slack_m: float
    speed_slack_m_s: float
    temperature_slack_k: float


@dataclass(frozen=True)
class WallTimes:
    """Where the time of a run went.

    Attributes:
        setup_s: building and, where the cache is cold, compiling the problem.
        run_s: the run itself.
    """

    setup_s: float
    run_s: float

    @property
    def total_s(self) -> float:
        """Both together."""
        return self.setup_s + self.run_s


@dataclass(frozen=True)
class FinishedRun:
    """What a worker hands back.

    Attributes:
        trajectory: what happened.
        decisions: how the decisions came about; None for a whole trip.
        whole_trip: how a whole trip was solved; None for a closed loop.
        wall: wall times.
        compiled: the problem ran as machine code.
    """

    trajectory: Trajectory
    decisions: DecisionSeries | None
    whole_trip: WholeTripRecord | None
    wall: WallTimes
    compiled: bool


def _nothing() -> None:
    """Nobody wants to know."""


def perform_run(inputs: RunInputs, alive: Callable[[], None] = _nothing) -> FinishedRun:
    """Perform a run.

    Args:
        inputs: the run.
        alive: called after every tick of a closed loop and every solve of a whole trip.

    Raises:
        ScenarioError: this process runs other code than the one the run is meant for.
        IptmError: the run cannot be set up or leads nowhere.
    """
    here = code_fingerprint(inputs.spec.kind)
    if here != inputs.fingerprint:
        raise ScenarioError(
            f"the worker runs other code (fingerprint {here[:12]}) than the study was started with "
            f"({inputs.fingerprint[:12]}); allowed is the same version on all machines"
        )
    finished = _closed_loop(inputs, alive)
    if inputs.spec.kind is RunKind.CLOSED_LOOP:
        return finished
    return _whole_trip(inputs, finished, alive)


def controller_options(spec: RunSpec) -> ControllerOptions:
    """Options of the controller of a run."""
    return ControllerOptions(
        strategy=spec.strategy,
        horizon=Horizon.parse(spec.horizon),
        solver=solver_options(spec.solver),
        tick_s=spec.tick_s,
    )


def solver_options(spec: SolverSpec) -> SolverOptions:
    """Options of the solver of a run; what is not specified is the controller's default."""
    return SolverOptions(
        name=spec.name, max_iterations=spec.max_iterations, tolerance=spec.tolerance
    )


def _closed_loop(inputs: RunInputs, alive: Callable[[], None]) -> FinishedRun:
    spec = inputs.spec
    began = time.perf_counter()
    plant = Plant(inputs.parameters, inputs.route.slope.slope_at, spec.plant_step_s)
    controller = Controller(inputs.parameters, controller_options(spec))
    ready = time.perf_counter()
    run = run_closed_loop(
        inputs.route, plant, controller, spec.bridge_settings(), on_tick=lambda *_: alive()
    )
    done = time.perf_counter()
    return FinishedRun(
        trajectory=run.trajectory,
        decisions=run.decisions,
        whole_trip=None,
        wall=WallTimes(ready - began, done - ready),
        compiled=controller.backend.compiled,
    )


def _whole_trip(inputs: RunInputs, start: FinishedRun, alive: Callable[[], None]) -> FinishedRun:
    """Optimise the trip from a closed-loop run of the same strategy."""
    spec = inputs.spec
    began = time.perf_counter()
    plant = Plant(inputs.parameters, inputs.route.slope.slope_at, spec.plant_step_s)
    run = solve_whole_trip(
        inputs.route,
        inputs.parameters,
        plant,
        spec.strategy,
        start.trajectory,
        WholeTripOptions(tick_s=spec.tick_s),
        on_expansion=lambda _: alive(),
    )
    elapsed = time.perf_counter() - began
    return FinishedRun(
        trajectory=run.trajectory,
        decisions=None,
        whole_trip=_record(run),
        wall=WallTimes(start.wall.setup_s + start.wall.run_s, elapsed),
        compiled=start.compiled,
    )


def _record(run: WholeTripRun) -> WholeTripRecord:
    return WholeTripRecord(
        settled=run.settled,
        solves=tuple(
            WholeTripSolve(
                status=SolveStatus(expansion.result.status).name.lower(),
                iterations=expansion.result.iterations,
                time_s=expansion.result.time_s,
                objective=_finite(expansion.result.objective),
                infeasibility=_finite(expansion.result.infeasibility),
                moved_m=_finite(expansion.moved_m),
            )
            for expansion in run.expansions
        ),
        gap_slack_m=run.slacks.gap_m,
        speed_slack_m_s=run.slacks.speed_m_s,
        temperature_slack_k=run.slacks.temperature_k,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
