"""One tick's outcome: the command, where it comes from, and what was found on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_controller.forecast import LeaderForecast
from iptm_controller.pack_observer import PackReport
from iptm_controller.plan import SLACKS, Plan
from iptm_controller.solvers.interface import SolveResult
from iptm_controller.temperature_value import NO_VALUE, TemperatureValue
from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.state import Command

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
        pack: what was found of sensors and cooling of the pack; None where they were not checked.
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
