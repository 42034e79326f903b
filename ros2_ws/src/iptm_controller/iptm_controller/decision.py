"""One tick's outcome (command, source, findings), and what a controller carries to the next tick.

The memory is one value: taken, given to another controller, stored. A controller that is given the memory of
another one with the same options decides on as that one would.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from iptm_controller.actuation import ActuationMemory
from iptm_controller.estimator import EstimatorMemory
from iptm_controller.forecast import ForecastMemory, LeaderForecast
from iptm_controller.lead_check import ClockMemory, LeadMemory
from iptm_controller.measurements import Measurements
from iptm_controller.pack_observer import PackMemory, PackReport
from iptm_controller.plan import SLACKS, Plan
from iptm_controller.preview_trust import FusionMemory, TrustMemory
from iptm_controller.solvers.interface import SolveResult
from iptm_controller.temperature_value import NO_VALUE, TemperatureValue
from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.state import Command, LeaderState, VehicleState

NOTHING = Command(0.0, 0.0)


@dataclass(frozen=True)
class Decision:
    """One tick's outcome; the default stands for a tick without a problem to solve.

    Attributes:
        rung: where the command comes from.
        reason: one sentence, empty when all is well.
        limits: bounds of the last limiter that changed the command, empty for none.
        plan: the plan behind an optimal command, None on any other rung.
        result: the solver's answer, None if no problem could be posed.
        forecast: the leader's motion used, None if it could not be formed.
        command_delay_s: time by which commands act late, as observed.
        brake_share: share of a commanded deceleration that is delivered, as observed.
        pack: findings on sensors and cooling of the pack; None where they were not checked.
        noise: which measurements and previews are noisy and filtered, empty if none is.
    """

    command: Command = NOTHING
    rung: Rung = Rung.STOP
    reason: str = ""
    limits: tuple[str, ...] = ()
    plan: Plan | None = None
    result: SolveResult | None = None
    forecast: LeaderForecast | None = None
    value: TemperatureValue = NO_VALUE
    command_delay_s: float = 0.0
    brake_share: float = 1.0
    noise: str = ""
    pack: PackReport | None = None

    @property
    def record(self) -> DecisionRecord:
        """How the decision came about, as published and stored."""
        result, forecast = self.result, self.forecast
        slacks = dict.fromkeys(SLACKS, math.nan) if self.plan is None else self.plan.slacks
        return DecisionRecord(
            status=SolveStatus.NOT_POSED if result is None else result.status,
            solve_time_s=math.nan if result is None else result.time_s,
            iterations=0 if result is None else result.iterations,
            **slacks,
            objective=math.nan if result is None else result.objective,
            rung=self.rung,
            limiter_active=bool(self.limits),
            preview_age_s=math.nan if forecast is None else forecast.age_s,
            trusted_preview_s=0.0 if forecast is None else forecast.known_s,
            command_delay_s=self.command_delay_s,
            brake_share=self.brake_share,
            solve_wall_time_s=math.nan if result is None else result.wall_time_s,
            cell_1_marginal_cost_1_k=self.value.cell_1_marginal_cost_1_k,
            cell_n_marginal_cost_1_k=self.value.cell_n_marginal_cost_1_k,
            aging_rate_1_s=self.value.aging_rate_1_s,
            aging_sensitivity_1_k=self.value.aging_sensitivity_1_k,
            temperature_decay_time_s=self.value.temperature_decay_time_s,
        )


@dataclass
class Tick:
    """State of a tick so far; each step of `MpcController.decide` reads it and adds to it.

    Attributes:
        measured: as received, then corrected by the findings on pack and preview.
        pack: findings on sensors and cooling of the pack.
        trusted: measured state if it is plausible.
        state: filtered, and predicted to when the command acts; None where none can be trusted.
        leader: as compared and filtered, None for none.
        is_free: no vehicle is ahead, and the rules of the road apply.
        fault: why no problem can be posed, empty if one can.
        doubt: why the leader is not as measured, empty if it is.
        planned: outcome of plan or rules.
        rung: where the command comes from.
        command: before the limiter.
        limited: behind it.
        limits: bounds that changed it.
        actuation: how commands are carried out otherwise than asked, empty if they are.
        delay_s: time by which commands act late.
        brake_share: share of a commanded deceleration that is delivered.
    """

    measured: Measurements
    pack: PackReport
    trusted: VehicleState | None = None
    state: VehicleState | None = None
    leader: LeaderState | None = None
    is_free: bool = False
    fault: str = ""
    doubt: str = ""
    planned: Decision = field(default_factory=Decision)
    rung: Rung = Rung.STOP
    command: Command = NOTHING
    limited: Command = NOTHING
    limits: tuple[str, ...] = ()
    actuation: str = ""
    delay_s: float = 0.0
    brake_share: float = 1.0


@dataclass(frozen=True)
class PaceMemory:
    """Of the road ahead: a driver at its limits at the last tick; ``is_held``: a lead vehicle was nearer."""

    time_s: float
    position_m: float
    speed_m_s: float
    is_held: bool


@dataclass(frozen=True)
class ControllerMemory:
    """Of a controller; the default is a controller that has not decided anything.

    Attributes:
        last_trusted: state that commands are limited against where none can be trusted.
        last_plan: newest usable plan.
        failures: ticks in a row without a usable plan.
        leader: lead vehicle that the collision guard measured last.
        leader_deceleration_m_s2: how hard it braked, not negative.
        lost_ticks: ticks without it since.
        trip_start: first state of the trip, from which the aging rate is averaged.
        foreseen_1_s: aging rate that was expected there.
        powers_w: traction powers of the trip so far.
        speeds_m_s: speeds at which they were measured.
        powers_until_s: when the newest one was measured.
        lead: lead vehicle by range sensor and by radio, see `iptm_controller.lead_check`.
        sender_clock: offset of the clock of who sends previews.
        leader_past: leader measured in the last seconds, oldest first.
        pace: of the road ahead, None where no rule has bound the vehicle.
        solves_since_second: of the check for better switching; None for one that has not solved anything.
    """

    last_trusted: VehicleState | None = None
    last_plan: Plan | None = None
    failures: int = 0
    leader: LeaderState | None = None
    leader_deceleration_m_s2: float = 0.0
    lost_ticks: int = 0
    trip_start: VehicleState | None = None
    foreseen_1_s: float = 0.0
    powers_w: tuple[float, ...] = ()
    speeds_m_s: tuple[float, ...] = ()
    powers_until_s: float = -math.inf
    lead: LeadMemory = field(default_factory=LeadMemory)
    sender_clock: ClockMemory = field(default_factory=ClockMemory)
    leader_past: tuple[LeaderState, ...] = ()
    fusion: FusionMemory = field(default_factory=FusionMemory)
    trust: TrustMemory = field(default_factory=TrustMemory)
    actuation: ActuationMemory = field(default_factory=ActuationMemory)
    pack: PackMemory = field(default_factory=PackMemory)
    estimator: EstimatorMemory = field(default_factory=EstimatorMemory)
    is_cooling: bool = False
    pace: PaceMemory | None = None
    solves_since_second: int | None = None

    @classmethod
    def built(
        cls,
        forecast: Callable[[], ForecastMemory],
        pack: Callable[[], PackMemory],
        parts: Mapping[str, Any],
    ) -> ControllerMemory:
        """Return the memory with its other parts, by their names."""
        names = "leader_past", "fusion", "trust"
        forecasts: dict[str, Any] = dict(zip(names, forecast(), strict=True))
        return cls(**parts, **forecasts, pack=pack())

    @property
    def forecast(self) -> ForecastMemory:
        """The part of the leader's forecast."""
        return self.leader_past, self.fusion, self.trust
