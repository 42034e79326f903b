"""The fallback ladder: commands without a usable solution.

Rung by rung: the solved plan; the last good plan, shifted, for a few ticks; the safe car-following law
with a thermostat for a limited time; a controlled stop. No plan of an earlier tick brakes less than the safe
law. A usable solution leads back to the top at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from iptm_controller.memory import LadderMemory
from iptm_controller.plan import Plan
from iptm_controller.safe_driving import controlled_stop, safe_following, thermostat_power_w
from iptm_core.decision_record import Rung
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import Command, LeaderState, VehicleState

BLIND_BRAKING_M_S2 = -1.0
"""Nothing is known about the vehicle: brake gently, the limiter keeps the jerk."""


@dataclass(frozen=True)
class LadderOptions:
    """How long each rung may hold, in ticks."""

    shifted_plan_ticks: int = 3
    safe_law_ticks: int = 120


class FallbackLadder:
    """Counts failures in a row and chooses the rung."""

    def __init__(self, parameters: ModelParameters, tick_s: float, options: LadderOptions) -> None:
        self._parameters = parameters
        self._tick_s = tick_s
        self._options = options
        self.memory = LadderMemory()

    def plan_at(self, time_s: float) -> Plan | None:
        """Return the newest usable plan if it covers a trip time.

        Past its end a plan only repeats its last input, which leads to absurd speeds.
        """
        plan = self.memory.last_good
        return plan if plan is not None and plan.covers(time_s) else None

    def accept(self, plan: Plan) -> tuple[Rung, Command]:
        """Go back to the top: a usable plan was found."""
        self.memory = LadderMemory(plan)
        return Rung.OPTIMAL, plan.command_at(plan.start_s)

    def accept_command(self, command: Command) -> tuple[Rung, Command]:
        """Go back to the top: a strategy that optimises nothing has decided, and leaves no plan."""
        self.memory = LadderMemory()
        return Rung.OPTIMAL, command

    def fall_back(
        self,
        state: VehicleState | None,
        leader: LeaderState | None,
        last: VehicleState | None = None,
    ) -> tuple[Rung, Command]:
        """Choose the rung of a tick without a usable plan.

        Args:
            last: what was last trusted or commanded, for a tick without a state; brakes that are applied
                harder than a blind vehicle would stay so, and the cells are cooled as they last needed it.
        """
        failures = self.memory.failures + 1
        self.memory = replace(self.memory, failures=failures)
        options = self._options
        if state is None:
            return Rung.STOP, self._blind(last)
        plan = self.plan_at(state.time_s)
        if failures <= options.shifted_plan_ticks and plan is not None:
            return Rung.SHIFTED_PLAN, self._safer(plan.command_at(state.time_s), state, leader)
        last_safe_tick = options.shifted_plan_ticks + options.safe_law_ticks
        if leader is not None and failures <= last_safe_tick:
            command = safe_following(state, leader, self._parameters, self._tick_s)
            return Rung.SAFE_LAW, command
        return Rung.STOP, controlled_stop(state, self._parameters, self._tick_s)

    def _safer(self, planned: Command, state: VehicleState, leader: LeaderState | None) -> Command:
        """Return the planned command, braking at least as hard as the safe law where a leader is measured."""
        if leader is None:
            return planned
        law = safe_following(state, leader, self._parameters, self._tick_s)
        return replace(
            planned, acceleration_m_s2=min(planned.acceleration_m_s2, law.acceleration_m_s2)
        )

    def _blind(self, last: VehicleState | None) -> Command:
        if last is None:
            return Command(BLIND_BRAKING_M_S2, 0.0)
        return Command(
            min(BLIND_BRAKING_M_S2, last.acceleration_m_s2),
            thermostat_power_w(last, self._parameters),
        )
