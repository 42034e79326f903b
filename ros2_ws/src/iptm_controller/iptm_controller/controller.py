"""The controller without ROS: one call per tick, from measurements to a limited command.

``preview + state -> problem data -> solver -> result -> ladder -> limiter -> command``. Nothing in here
raises for bad measurements or failed solves: both are outcomes, reported in the decision.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from iptm_controller.forecast import LeaderForecast, LeaderForecaster
from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.ladder import FallbackLadder, LadderDecision, LadderOptions, Rung
from iptm_controller.limiter import CommandLimiter, LimitedCommand
from iptm_controller.ocp.data import ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.plan import (
    Plan,
    PlanShifter,
    plan_from_variables,
    sample_positions_m,
    variables_from_plan,
)
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend, SolverOptions
from iptm_controller.solvers.result import SolveResult
from iptm_controller.state_check import check_leader, check_slope, check_state
from iptm_controller.strategy import STRATEGIES, Strategy
from iptm_core.errors import StateError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import Command, LeaderPreview, LeaderState, SlopePreview, VehicleState


@dataclass(frozen=True)
class ControllerOptions:
    """What a user chooses about the controller.

    Attributes:
        strategy: cost terms and weights.
        horizon: prediction grid.
        solver: back end and its settings.
        ladder: lengths of the fallback rungs.
        max_preview_age_s: older previews are not used.
        tick_s: sampling time of the loop.
    """

    strategy: Strategy = STRATEGIES["aging"]
    horizon: Horizon = MULTI_HORIZON
    solver: SolverOptions = field(default_factory=SolverOptions)
    ladder: LadderOptions = field(default_factory=LadderOptions)
    max_preview_age_s: float = 10.0
    tick_s: float = 1.0


@dataclass(frozen=True)
class Measurements:
    """What the controller acts on at one tick, all of the same instant.

    Attributes:
        state: host and pack, None if not measured.
        leader: the preceding vehicle by range sensor, None if not measured.
        preview: newest received prediction, possibly empty.
        slope: road slope over position.
        fault: why something is not measured; empty if all is.
    """

    state: VehicleState | None
    leader: LeaderState | None
    preview: LeaderPreview
    slope: SlopePreview
    fault: str = ""


@dataclass(frozen=True)
class Decision:
    """One tick's outcome.

    Attributes:
        command: what to actuate, within all physical bounds.
        rung: where it comes from.
        reason: one sentence, empty when all is well.
        limited: what the last limiter did.
        plan: the plan behind an optimal command, None on any other rung.
        result: the solver's answer, None if no problem could be posed.
        forecast: the leader's motion used, None if it could not be formed.
    """

    command: Command
    rung: Rung
    reason: str
    limited: LimitedCommand
    plan: Plan | None
    result: SolveResult | None
    forecast: LeaderForecast | None


class Controller:
    """Multi-horizon model predictive control with fallback."""

    def __init__(
        self,
        parameters: ModelParameters,
        options: ControllerOptions,
        backend: SolverBackend | None = None,
    ) -> None:
        """Build the optimal control problem and its solver.

        Args:
            parameters: vehicle, pack, limits.
            options: strategy, horizon, solver.
            backend: a ready solver, to share one between controllers of equal horizon.

        Raises:
            SolverSetupError: the problem cannot be built or compiled.
        """
        horizon = options.horizon
        self.options = options
        self.backend = backend or build_solver(horizon, parameters, options.solver)
        self._grid = ProblemGrid(horizon)
        self._builder = ProblemDataBuilder(self._grid, options.strategy)
        self._shifter = PlanShifter(horizon)
        self._forecaster = LeaderForecaster(horizon.duration_s, options.max_preview_age_s)
        self._ladder = FallbackLadder(parameters, options.tick_s, options.ladder)
        self._limiter = CommandLimiter(parameters.limits, options.tick_s)
        self._last_trusted: VehicleState | None = None

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick."""
        if measured.state is None:
            return self._without_state(measured.fault or "no measurement of the state")
        try:
            check_state(measured.state)
        except StateError as error:
            return self._without_state(str(error))
        self._last_trusted = measured.state
        if measured.leader is None:
            reason = measured.fault or "no measurement of the leader"
            return self._fall_back(measured.state, None, reason)
        try:
            check_leader(measured.leader, measured.state)
        except StateError as error:
            return self._fall_back(measured.state, None, str(error))
        try:
            check_slope(measured.slope)
        except StateError as error:
            return self._fall_back(measured.state, measured.leader, str(error))
        return self._optimise(measured.state, measured.leader, measured)

    def _optimise(
        self, state: VehicleState, leader: LeaderState, measured: Measurements
    ) -> Decision:
        forecast = self._forecaster.forecast(leader, measured.preview)
        last = self._ladder.last_good_plan
        # Past its end a plan only repeats its last input, which leads to absurd speeds.
        guess = (
            self._shifter.shift(last, state)
            if last is not None and last.covers(state.time_s)
            else self._shifter.cold_start(state)
        )
        data = self._builder.build(
            state,
            forecast.motion,
            measured.slope,
            sample_positions_m(guess, self._grid.sample_times_s),
            forecast.known_s,
        )
        result = self.backend.solve(data, variables_from_plan(guess, self._grid, state))
        if not result.status.usable:
            return self._fall_back(state, leader, result.reason, result, forecast)
        plan = plan_from_variables(result.variables, self._grid, state)
        choice = self._ladder.accept(plan)
        return self._limited(choice, state, forecast.reason, plan, result, forecast)

    def _without_state(self, reason: str) -> Decision:
        choice = self._ladder.fall_back(None, None)
        # The limiter needs something to hold rates against: the last state that could be trusted.
        reference = self._last_trusted
        if reference is None:
            limited = LimitedCommand(Command(0.0, 0.0), ("no state was ever trusted",))
            return Decision(limited.command, choice.rung, reason, limited, None, None, None)
        decision = self._limited(choice, reference, reason, None, None, None)
        # The rates count from this command next time, or braking would never get beyond one step.
        self._last_trusted = replace(
            reference,
            acceleration_m_s2=decision.command.acceleration_m_s2,
            compressor_power_w=decision.command.compressor_power_w,
        )
        return decision

    def _fall_back(
        self,
        state: VehicleState,
        leader: LeaderState | None,
        reason: str,
        result: SolveResult | None = None,
        forecast: LeaderForecast | None = None,
    ) -> Decision:
        choice = self._ladder.fall_back(state, leader)
        return self._limited(choice, state, reason, None, result, forecast)

    def _limited(
        self,
        choice: LadderDecision,
        state: VehicleState,
        reason: str,
        plan: Plan | None,
        result: SolveResult | None,
        forecast: LeaderForecast | None,
    ) -> Decision:
        limited = self._limiter.limit(choice.command, state)
        return Decision(limited.command, choice.rung, reason, limited, plan, result, forecast)
