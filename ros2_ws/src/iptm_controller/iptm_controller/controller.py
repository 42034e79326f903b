"""The controller without ROS: one call per tick, from measurements to a limited command.

It uses the model of the plant, with kinks smoothed, at the state of charge at which a trip begins.

``MpcController._steps`` is the list of what happens in a tick. Nothing in here
raises for bad measurements or failed solves: both are outcomes, reported in the decision.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from iptm_controller.actuation import ActuationMemory, ActuationObserver, PowerAuthority
from iptm_controller.arrival import ArrivalValuation, aging_power_w
from iptm_controller.decision import NOTHING, ControllerMemory, Decision, Tick
from iptm_controller.estimator import Estimator
from iptm_controller.forecast import LeaderForecast, LeaderForecaster
from iptm_controller.ladder import FallbackLadder, safe_following
from iptm_controller.lead_check import LeadCheck, SenderClock, unpredicted_s
from iptm_controller.measurements import Measurements, slope_at_rad, trusted_measurements
from iptm_controller.ocp.data import UNBOUNDED_W, ProblemData, ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.options import ControllerOptions
from iptm_controller.pack_model import CELLS, cyclic_parameters, valuation_of
from iptm_controller.pack_observer import PackObserverInC
from iptm_controller.plan_data import plan_data
from iptm_controller.production import ProductionLikeController
from iptm_controller.road_envelope import LOOK_AHEAD_S, RoadEnvelope
from iptm_controller.safeguards import EMERGENCY, CollisionGuard, CommandLimiter
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend, SolveResult, Stopwatch, broken
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import Strategy
from iptm_controller.temperature_value import TemperatureValuation
from iptm_controller.tick_library import tick_library
from iptm_controller.traction_forecast import TractionForecaster
from iptm_core.aging_laws.parking import ParkedAging
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import nominal_charge_parameters
from iptm_core.physics.pack_limits import UNLIMITED
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import Command, FloatArray, LeaderPreview, LeaderState, VehicleState

_USABLE = tuple(status for status in SolveStatus if status.usable)


class MpcController:
    """Multi-horizon model predictive control with fallback.

    Attributes:
        grid: order of the flat vectors of its problems.
        model: the parameters that they are posed with.
        lead: compares the sources of the vehicle ahead; its friction may change from tick to tick.
        plan_data: poses them.
        valuation: prices the temperatures.
    """

    def __init__(
        self,
        parameters: ModelParameters,
        options: ControllerOptions,
        backend: SolverBackend | None = None,
    ) -> None:
        """Build the optimal control problem and its solver; a `SolverSetupError` if that is impossible.

        Args:
            backend: a ready solver, to share one between controllers of equal horizon.
        """
        horizon = options.horizon
        self._vehicle = parameters
        parameters = nominal_charge_parameters(parameters)
        law = options.law
        self._parked: ParkedAging | None = None
        if law is not None:
            ambient_k = parameters.environment.ambient_temperature_k
            self._parked = ParkedAging(law, options.aging, ambient_k)
            parameters = replace(parameters, aging=cyclic_parameters(self._parked, parameters))
        self.options = options
        self.backend = backend or build_solver(horizon, parameters, options.solver)
        self.grid = ProblemGrid(horizon)
        self.model = parameters
        self._pose(options.strategy)
        library = tick_library()
        seen_s = horizon.motion_duration_s, options.max_preview_age_s, options.tick_s
        self._forecaster = LeaderForecaster(library, *seen_s, *unpredicted_s(parameters.gap))
        self._traction = (
            TractionForecaster(parameters, self.grid)
            if horizon.motion_steps < horizon.steps
            else None
        )
        self._ladder = FallbackLadder(
            parameters, options.tick_s, options.shifted_plan_ticks, options.safe_law_ticks
        )
        self._guard = CollisionGuard(
            parameters.limits, options.tick_s, options.shifted_plan_ticks, library
        )
        self._limiter = CommandLimiter(parameters.limits, options.tick_s)
        self._estimator = Estimator(options.noise, parameters.limits, options.tick_s)
        self._actuation = ActuationObserver(parameters.limits, options.tick_s)
        followed = parameters.limits, parameters.gap, options.radio, parameters.brakes
        self.lead = LeadCheck(options.accuracy, options.road, *followed)
        self._clock = SenderClock()
        self._pack = PackObserverInC(parameters, library)
        ends_s = horizon.node_times_s[1 : horizon.motion_steps + 1]
        self.power = PowerAuthority(self._vehicle, options.tick_s, ends_s)
        self._road = RoadEnvelope(parameters, options.tick_s)
        self._last_trusted: VehicleState | None = None

    def _pose(self, strategy: Strategy) -> None:
        """Set up what depends on the cost terms and their weights, which are numbers of a problem."""
        strategy, price_1_j, self.valuation = valuation_of(
            strategy, self.options, self._parked, self.model
        )
        self._is_rule_based = strategy.is_rule_based
        driven = self.options.production, self.options.tick_s, strategy.rules
        self._production = ProductionLikeController(self.model, *driven)
        builder = ProblemDataBuilder(self.grid, strategy, self.model, self.options.tick_s)
        self.plan_data = plan_data(self.grid, builder)
        self._arrival: ArrivalValuation | None = None
        if self.options.arrival is not None and not strategy.is_rule_based:
            costs = self.options.arrival, self.options.aging.electricity_eur_kwh, self._vehicle
            energy_1_j = strategy.energy_weight_1_j, CELLS * strategy.aging_weight * price_1_j
            # In one currency, thermal energy has its price as part of the battery's energy.
            if strategy.in_currency:
                energy_1_j = strategy.spent_energy_weight_1_j, 0.0
            times_s = self.options.horizon.duration_s, self.options.trip_duration_s
            aging_w = None
            if self._parked is not None:
                aging_w = partial(aging_power_w, self._parked, self.options.aging, self._vehicle)
            self._arrival = ArrivalValuation(*costs, *energy_1_j, *times_s, aging_w)

    def use_costs(self, options: ControllerOptions) -> None:
        """Go on with cost terms, weights and prices of other options; memory and solver stay."""
        memory = self.memory
        self.options = replace(
            self.options,
            strategy=options.strategy,
            aging=options.aging,
            arrival=options.arrival,
            trip_duration_s=options.trip_duration_s,
        )
        self._pose(options.strategy)
        self.memory = memory

    @property
    def memory(self) -> ControllerMemory:
        """State carried from tick to tick; defaults for parts that this strategy or solver does not need."""
        return self.kept_memory()()

    @memory.setter
    def memory(self, memory: ControllerMemory) -> None:
        self._last_trusted, guard = memory.last_trusted, self._guard
        self._ladder.last_plan, self._ladder.failures = memory.last_plan, memory.failures
        guard.leader, guard.lost_ticks = memory.leader, memory.lost_ticks
        guard.deceleration_m_s2 = memory.leader_deceleration_m_s2
        self.lead.memory, self._clock.memory = memory.lead, memory.sender_clock
        self._forecaster.memory = memory.forecast
        self._actuation.memory, self._estimator.memory = memory.actuation, memory.estimator
        self._pack.memory, self._road.pace = memory.pack, memory.pace
        self._production.is_cooling = memory.is_cooling
        if isinstance(trip := self.valuation, TemperatureValuation):
            trip.start, trip.foreseen_1_s = memory.trip_start, memory.foreseen_1_s
        if (past := self._traction) is not None:
            past.powers_w, past.speeds_m_s = memory.powers_w, memory.speeds_m_s
            past.until_s = memory.powers_until_s
        if isinstance(self.backend, SwitchingCheck):
            self.backend.since_second = memory.solves_since_second

    def kept_memory(self) -> Callable[[], ControllerMemory]:
        """Return what builds the memory of now, whenever it is called: nearly all of its time is building."""
        forecast, pack = self._forecaster.kept_memory(), self._pack.kept_memory()
        parts: dict[str, object] = {
            "last_trusted": self._last_trusted,
            "last_plan": self._ladder.last_plan,
            "failures": self._ladder.failures,
            "leader": self._guard.leader,
            "leader_deceleration_m_s2": self._guard.deceleration_m_s2,
            "lost_ticks": self._guard.lost_ticks,
            "lead": self.lead.memory,
            "sender_clock": self._clock.memory,
            "actuation": self._actuation.memory,
            "estimator": self._estimator.memory,
            "is_cooling": self._production.is_cooling,
            "pace": self._road.pace,
        }
        if isinstance(trip := self.valuation, TemperatureValuation):
            parts |= {"trip_start": trip.start, "foreseen_1_s": trip.foreseen_1_s}
        if (past := self._traction) is not None:
            parts |= {"powers_w": past.powers_w, "speeds_m_s": past.speeds_m_s}
            parts["powers_until_s"] = past.until_s
        if isinstance(self.backend, SwitchingCheck):
            parts["solves_since_second"] = self.backend.since_second
        return partial(ControllerMemory.built, forecast, pack, parts)

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick: every step adds to its `Tick`."""
        tick = Tick(measured, self._pack.observe(measured, self._actuation.last_command))
        for step in self._steps:
            step(tick)
        return self._decision(tick)

    @property
    def _steps(self) -> tuple[Callable[[Tick], None], ...]:
        """The steps of a decision, in their order."""
        return (
            self._trust,
            self._check_leader,
            self._filter,
            self._predict,
            self._choose,
            self._fall_back,
            self._limit_command,
            self._brake_in_emergency,
            self._issue,
        )

    @staticmethod
    def _trust(tick: Tick) -> None:
        """Keep the plausible measurements."""
        tick.measured = measured = tick.measured.with_state(tick.pack.state)
        tick.trusted, tick.leader, tick.fault = trusted_measurements(measured)
        tick.state, tick.is_free = tick.trusted, measured.is_free

    def _check_leader(self, tick: Tick) -> None:
        """Compare range sensor and radio."""
        if (state := tick.state) is None:
            return
        preview = self._clock.by_own_clock(tick.measured.preview, state.time_s)
        if preview is not tick.measured.preview:
            tick.measured = replace(tick.measured, preview=preview)
        tick.leader, tick.doubt = self.lead.checked(
            state, tick.leader, preview, is_free=tick.is_free
        )
        if not (tick.fault or tick.leader or tick.is_free):
            tick.fault = tick.doubt

    def _filter(self, tick: Tick) -> None:
        """Filter state and leader, and allow for the errors of the sensor."""
        if tick.state is None:
            return
        state, leader = self._estimator.update(tick.state, tick.leader)
        slope_rad = 0.0 if tick.fault else slope_at_rad(tick.measured.slope, state.position_m)
        tick.leader = leader and self.lead.cautious(leader, state.speed_m_s, slope_rad)
        tick.state = state

    def _predict(self, tick: Tick) -> None:
        """Predict the state to when the command acts, and what the pack then gives."""
        if tick.state is None:
            return
        if not tick.measured.is_followed:
            self._actuation.memory = ActuationMemory()
        self._actuation.observe(tick.state)
        tick.state = self._limiter.within_comfort(self._actuation.predicted(tick.state))
        self.power.update(tick.state, tick.measured.slope, tick.pack.power_share)

    def _choose(self, tick: Tick) -> None:
        """Drive by the plan of a problem or by rules, where enough is known."""
        state, leader = tick.state, tick.leader
        if state is None or tick.fault or (leader is None and not tick.is_free):
            tick.planned = Decision(reason=tick.fault)
        elif self._is_rule_based:
            tick.planned = self._by_rules(state, leader, tick.measured)
        else:
            tick.planned = self._plan(state, leader, tick.measured)
        tick.rung, tick.command = tick.planned.rung, tick.planned.command

    def _fall_back(self, tick: Tick) -> None:
        """Replace the command of a tick without a usable plan."""
        if tick.rung is not Rung.OPTIMAL:
            tick.rung, tick.command = self._fallback(tick.state, tick.leader, tick.measured)

    def _limit_command(self, tick: Tick) -> None:
        """Limit the command to what actuators and pack take."""
        tick.command = self.power.within(tick.command)
        tick.limited, tick.limits = self._limit(tick.command, tick.state)
        tick.actuation, tick.delay_s, tick.brake_share = self._actuation.found

    def _brake_in_emergency(self, tick: Tick) -> None:
        """Brake as hard as allowed where a collision threatens."""
        if tick.state is None:
            return
        self._guard.observe(tick.leader, is_free=tick.is_free)
        share = min(tick.brake_share, self.lead.braking_share)
        asked_m_s2 = tick.limited.acceleration_m_s2
        if self._guard.collision_threatens(asked_m_s2, tick.state, tick.planned.forecast, share):
            tick.rung = Rung.EMERGENCY_BRAKING
            hardest_m_s2 = self.model.limits.min_acceleration_m_s2
            hardest = Command(hardest_m_s2, tick.command.compressor_power_w)
            tick.limited, tick.limits = self._limit(hardest, tick.state)

    def _issue(self, tick: Tick) -> None:
        """Remember the command, for what comes of it."""
        if tick.trusted is not None:
            self._actuation.issue(tick.trusted.time_s, tick.limited)

    def _decision(self, tick: Tick) -> Decision:
        """Return the outcome of a tick, with the reasons of all steps."""
        planned = tick.planned
        reasons = (
            EMERGENCY if tick.rung is Rung.EMERGENCY_BRAKING else "",
            tick.doubt if tick.doubt != planned.reason else "",
            planned.reason,
            tick.actuation,
            tick.pack.reason,
        )
        return replace(
            planned,
            command=tick.limited,
            rung=tick.rung,
            reason="; ".join(filter(None, reasons)),
            limits=tick.limits,
            command_delay_s=tick.delay_s,
            brake_share=tick.brake_share,
            noise=", ".join(filter(None, (self._estimator.noise, self._forecaster.noise))),
            pack=tick.pack,
        )

    def _by_rules(
        self, state: VehicleState, leader: LeaderState | None, measured: Measurements
    ) -> Decision:
        """Drive and cool by the rules of the strategy."""
        lawful = self._road.command_m_s2(state, measured.rules)
        forecast = None
        if leader is not None and self._production.uses_preview:
            forecast = self._forecaster.forecast(leader, measured.preview)
        command = self._production.command(state, leader, lawful, forecast)
        return Decision(self._ladder.accept_command(command), Rung.OPTIMAL, forecast=forecast)

    def _fallback(
        self, state: VehicleState | None, leader: LeaderState | None, measured: Measurements
    ) -> tuple[Rung, Command]:
        """Return rung and command of a tick without a usable plan."""
        if state is None:
            return self._ladder.fall_back(state, None, self._last_trusted)
        ahead = self._forecaster.leader_at(state.time_s, leader)
        # A lead vehicle that is lost may be nearer than the rules: it is not driven towards.
        if measured.rules is not None and (leader is not None or measured.is_free):
            ahead = self._road.nearest(state, measured.rules, ahead)
        rung, command = self._ladder.fall_back(state, ahead, self._last_trusted)
        lawful = self._road.command_m_s2(state, measured.rules)
        slower = min(command.acceleration_m_s2, lawful)
        lost = None if leader is not None else self.lead.lost_leader(state.time_s)
        if lost is not None and not measured.is_free:
            law = safe_following(state, lost, self.model, self.options.tick_s)
            slower = min(slower, law.acceleration_m_s2)
        return rung, replace(command, acceleration_m_s2=slower)

    def _plan(
        self, state: VehicleState, leader: LeaderState | None, measured: Measurements
    ) -> Decision:
        """Pose and solve the problem of a tick; without a lead vehicle there are rules of the road.

        The decision is optimal, or leaves the command to the fallback.
        """
        rules, last = measured.rules, self._ladder.plan_at(state.time_s)
        forecast = None if leader is None else self._forecaster.forecast(leader, measured.preview)
        motion, limiting, follows = self._ahead(state, rules, forecast)
        known_s = LOOK_AHEAD_S
        if forecast is not None and leader is not None:
            known_s = forecast.known_s - (state.time_s - leader.time_s)
        if self._actuation.has_weak_brakes:
            known_s = 0.0
            hardest_m_s2 = self.model.brakes.max_deceleration_m_s2
            further_m = self._actuation.further_way_m(state.speed_m_s, hardest_m_s2)
            motion, limiting = motion.nearer_by(further_m), limiting.nearer_by(further_m)
        value = self.valuation.value(state, motion)
        if self._arrival is not None:
            value = self._arrival.added_to(value, state)
        thermal = None
        if self._traction is not None:
            self._traction.remember(state, measured.slope)
            thermal = self._traction.samples(state, motion, known_s, measured.slope)
        limits_m_s, charge_w = None, UNBOUNDED_W
        if rules is not None:
            expected = self.plan_data.expected(last, state).motion
            limits_m_s = self._road.speed_limits_m_s(rules, expected)
        if self.power.limits is not UNLIMITED:
            limits_m_s, charge_w = self.power.slower(limits_m_s), self.power.charge_w
        known = state, last, motion, limiting, measured.slope, known_s, value, thermal, limits_m_s
        data, start = self.plan_data.problem(*known, charge_w, follows=follows)
        result = self._solve(data, start)
        if result.status not in _USABLE:
            return Decision(reason=result.reason, result=result, forecast=forecast, value=value)
        plan = self.plan_data.plan(result.variables, state)
        return Decision(
            self._ladder.accept(plan),
            Rung.OPTIMAL,
            "" if forecast is None else forecast.reason,
            plan=plan,
            result=result,
            forecast=forecast,
            value=value,
        )

    def _ahead(
        self, state: VehicleState, rules: RoadAhead | None, forecast: LeaderForecast | None
    ) -> tuple[LeaderPreview, LeaderPreview, bool]:
        """Return the motion ahead, the one that limits hold for, and whether a vehicle moves like that."""
        if rules is not None:
            motion, limiting = self._road.lead(state, rules, forecast)
            return motion, limiting, self._road.follows(state.time_s, motion, forecast)
        if forecast is None:
            raise AssertionError("a plan needs a lead vehicle or rules of the road")
        return forecast.motion, forecast.limiting, True

    def _solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve a problem; a back end that raises, against its promise, has broken off."""
        try:
            return self.backend.solve(data, guess)
        except Exception as error:  # noqa: BLE001  whatever it is, the car must be driven on
            return broken(guess, Stopwatch(), f"{type(error).__name__}: {error}")

    def _limit(
        self, command: Command, state: VehicleState | None
    ) -> tuple[Command, tuple[str, ...]]:
        """Limit a command relative to the state, or to the last one that could be trusted."""
        if state is not None:
            self._last_trusted = state
            return self._limiter.limit(command, state)
        reference = self._last_trusted
        if reference is None:
            return NOTHING, ("no state was ever trusted",)
        limited, limits = self._limiter.limit(command, reference)
        # The rates count from this command next time, or braking would never get beyond one step.
        self._last_trusted = replace(
            reference,
            acceleration_m_s2=limited.acceleration_m_s2,
            compressor_power_w=limited.compressor_power_w,
        )
        return limited, limits
