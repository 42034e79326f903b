"""The fallback ladder: commands without a usable solution.

Rung by rung: the solved plan; the last good plan, shifted, for a few ticks; the safe car-following law
with a thermostat for a limited time; a controlled stop. No plan of an earlier tick brakes less than the safe
law. A usable solution leads back to the top at once.
"""

from __future__ import annotations

from iptm_controller.ocp.layout import InputIndex
from iptm_controller.plan import Plan
from iptm_core.decision_record import Rung
from iptm_core.frozen import replace
from iptm_core.parameters.model import LimitParameters, ModelParameters
from iptm_core.physics.car_following import (
    controlled_stop_command,
    halting_distance_m,
    minimum_gap_m,
    stopping_distance_m,
)
from iptm_core.state import Command, LeaderState, VehicleState

THERMOSTAT_ON_K = 305.15  # full cooling is asked for 6 K above
THERMOSTAT_SPAN_K = 6.0
THERMOSTAT_POWER_W = 1500.0
FREE_FLOW_EXPONENT = 4
LEAST_GAP_M, LEAST_BRAKING_M_S2 = 0.1, 1e-9
"""Keep quotients finite; others would do as well."""
BISECTIONS = 30
BLIND_BRAKING_M_S2 = -1.0
"""Nothing is known about the vehicle: brake gently, the limiter keeps the jerk."""


class FallbackLadder:
    """Counts failures in a row and chooses the rung.

    Attributes:
        last_plan: newest usable plan.
        failures: ticks in a row without a usable plan.
    """

    def __init__(
        self,
        parameters: ModelParameters,
        tick_s: float,
        shifted_plan_ticks: int,
        safe_law_ticks: int,
    ) -> None:
        """Set up a ladder that has not met any plan.

        Args:
            shifted_plan_ticks: ticks for which the last plan may be driven on.
            safe_law_ticks: ticks of the safe law after that.
        """
        self._parameters = parameters
        self._tick_s = tick_s
        self._shifted_plan_ticks = shifted_plan_ticks
        self._last_safe_tick = shifted_plan_ticks + safe_law_ticks
        self.last_plan: Plan | None = None
        self.failures = 0

    def plan_at(self, time_s: float) -> Plan | None:
        """Return the newest usable plan if it covers a trip time.

        Past its end a plan only repeats its last input, which leads to absurd speeds.
        """
        plan = self.last_plan
        if plan is None or not 0.0 <= time_s - plan.start_s < plan.node_times_s.item(-1):
            return None
        return plan

    def accept(self, plan: Plan) -> Command:
        """Go back to the top, as a usable plan was found; returns its first command."""
        self.last_plan, self.failures = plan, 0
        row = plan.inputs[0].tolist()
        return Command(row[InputIndex.ACCELERATION], row[InputIndex.COMPRESSOR_POWER])

    def accept_command(self, command: Command) -> Command:
        """Go back to the top: a strategy that optimises nothing has decided, and leaves no plan."""
        self.last_plan, self.failures = None, 0
        return command

    def fall_back(
        self,
        state: VehicleState | None,
        leader: LeaderState | None,
        last: VehicleState | None = None,
    ) -> tuple[Rung, Command]:
        """Choose the rung of a tick without a usable plan.

        Args:
            last: state last trusted or commanded, for a tick without a state; brakes that are applied
                harder than a blind vehicle would stay so, and the cells are cooled as they last needed it.
        """
        self.failures += 1
        if state is None:
            return Rung.STOP, self._blind(last)
        plan = self.plan_at(state.time_s)
        if self.failures <= self._shifted_plan_ticks and plan is not None:
            return Rung.SHIFTED_PLAN, self._safer(plan.command_at(state.time_s), state, leader)
        if leader is not None and self.failures <= self._last_safe_tick:
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


def safe_following(
    state: VehicleState, leader: LeaderState, parameters: ModelParameters, tick_s: float = 1.0
) -> Command:
    """Follow the leader by the intelligent driver model, able to stop at any time, with the thermostat.

    ``a_max (1 - (v / v_max)^4 - (s* / s)^2)`` with the desired gap ``s*`` of the paper's spacing policy,
    never less than the standstill gap. The model takes braking to be there at once; so the acceleration is
    cut to what still permits a stop within the jerk limit. Needs the measured gap and leader speed only.

    Args:
        state: ego vehicle; its acceleration is the one last actuated.
    """
    limits, policy = parameters.limits, parameters.gap
    gap_m = max(leader.position_m - state.position_m, LEAST_GAP_M)
    desired = minimum_gap_m(state.speed_m_s, leader.speed_m_s, policy, limits)
    desired = max(float(desired), policy.standstill_gap_m)
    free_flow = (state.speed_m_s / limits.max_speed_m_s) ** FREE_FLOW_EXPONENT
    interaction = (desired / gap_m) ** 2
    acceleration = limits.max_acceleration_m_s2 * (1.0 - free_flow - interaction)
    acceleration = max(acceleration, limits.min_acceleration_m_s2)
    room_m = gap_m - policy.standstill_gap_m + float(halting_distance_m(leader.speed_m_s, limits))
    acceleration = min(acceleration, _stoppable_acceleration(state, room_m, limits, tick_s))
    return Command(acceleration, thermostat_power_w(state, parameters))


def _stoppable_acceleration(
    state: VehicleState, room_m: float, limits: LimitParameters, tick_s: float
) -> float:
    """Return the largest acceleration for a tick after which the ego can still stop within a distance.

    The hardest braking if there is none within the reach of one tick's jerk.
    """
    jerk_step = limits.max_jerk_m_s3 * tick_s
    low = max(state.acceleration_m_s2 - jerk_step, limits.min_acceleration_m_s2)
    high = min(state.acceleration_m_s2 + jerk_step, limits.max_acceleration_m_s2)
    if _distance_to_stop_m(state.speed_m_s, high, limits, tick_s) <= room_m:
        return limits.max_acceleration_m_s2
    if _distance_to_stop_m(state.speed_m_s, low, limits, tick_s) > room_m:
        return limits.min_acceleration_m_s2
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _distance_to_stop_m(state.speed_m_s, middle, limits, tick_s) <= room_m:
            low = middle
        else:
            high = middle
    return low


def _distance_to_stop_m(
    speed_m_s: float, acceleration_m_s2: float, limits: LimitParameters, tick_s: float
) -> float:
    """Return the distance to standstill where an acceleration is held for a tick and brakes build up then."""
    after_m_s = speed_m_s + acceleration_m_s2 * tick_s
    if after_m_s <= 0.0:
        return 0.5 * speed_m_s * speed_m_s / max(-acceleration_m_s2, LEAST_BRAKING_M_S2)
    held_m = 0.5 * (speed_m_s + after_m_s) * tick_s
    return held_m + float(stopping_distance_m(after_m_s, acceleration_m_s2, limits))


def thermostat_power_w(state: VehicleState, parameters: ModelParameters) -> float:
    """Return compressor power in proportion to the excess of the warmer cell over 32 degC, up to 1500 W."""
    warmest = max(state.cell_1_temperature_k, state.cell_n_temperature_k)
    demand = (warmest - THERMOSTAT_ON_K) / THERMOSTAT_SPAN_K
    power = THERMOSTAT_POWER_W * min(max(demand, 0.0), 1.0)
    return min(power, parameters.limits.max_compressor_power_w)


def controlled_stop(state: VehicleState, parameters: ModelParameters, tick_s: float) -> Command:
    """Brake comfortably to standstill without a jolt, the thermostat still cooling."""
    braking = controlled_stop_command(state, parameters.limits, tick_s)
    return replace(braking, compressor_power_w=thermostat_power_w(state, parameters))
