"""Response to commands: delay of the actuators, delivery of the brakes, and power of the pack.

Delay and share are inferred from the actuated values that are measured, so they hold for any actuator,
whether it reports or not. The state is predicted to the instant at which the next command acts.

Packs without limits of their own give any power; only where sensors of the pack have failed is that reduced.
The power leaves a part of the motion, for plan and command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_controller.measurements import slope_at_rad
from iptm_controller.ocp.data import UNBOUNDED_W
from iptm_core.frozen import replace
from iptm_core.parameters.model import LimitParameters, ModelParameters
from iptm_core.physics.pack_limits import UNLIMITED, PowerLimits, largest_within, power_limits
from iptm_core.physics.power_thermal import CellPair, electric_traction_power_w
from iptm_core.physics.powertrain import battery_power_w
from iptm_core.signal_residuals import unexplained_change
from iptm_core.state import Command, FloatArray, SlopePreview, VehicleState

LONGEST_DELAY_S = 2.0
FEWEST_DELAYS = 3
"""Delays of up to this many ticks, or this long, are looked for."""
FORGETTING = 0.5
"""Weight of the mismatches of a tick relative to the next one."""
EXPLAINED = 0.5
"""Another delay has to reduce the mismatch to this share, in two ticks in a row."""
EXPLAINED_IN_FULL, DISTINCT = 0.05, 0.25
"""A delay that reduces it to the first share needs only the second share of a noticeable mismatch to do so:
commands that change slowly, as at the onset of braking, look like weak brakes otherwise."""
_ROUND_OFF = 1e-9
BEYOND_M_S2, UNEXPLAINED_M_S = 0.1, 0.5
"""A deceleration that grows by more than the first value beyond the jerk limit, or a speed that changes by
more than the second beyond what accelerations explain: the safety monitor brakes, and answers no command."""
AS_WELL = 1.5
"""Weak brakes are reported where no delay explains the motion with a mismatch smaller by this factor."""
CREEP_SPEED_M_S = 0.5
"""Below this speed the brakes may hold the vehicle, whatever the command."""
BRAKING_M_S2 = -0.3
"""Decelerations from here on show how much the brakes deliver."""
SMALLEST_SHARE = 0.3
WEAK_SHARE = 0.9
"""Brakes that deliver a smaller share of the commanded deceleration are weak."""


@dataclass(frozen=True)
class IssuedCommand:
    """A command and the tick at which it was issued."""

    tick: int
    acceleration_m_s2: float
    compressor_power_w: float


@dataclass(frozen=True)
class ActuationMemory:
    """State carried from tick to tick.

    Attributes:
        issued: commands that may still be under way, oldest first.
        mismatches: weighted sums of squared mismatches for delays of 0, 1, ... ticks in (m/s^2)^2.
        delivered: weighted sum of commanded times measured decelerations, in (m/s^2)^2.
        commanded: weighted sum of squared commanded decelerations, in (m/s^2)^2.
        candidate: delay that explained the last tick better, None for none.
        seen: trip time, speed and acceleration that were observed last, None before the first.
        is_overridden: the safety monitor braked, and the acceleration has not come back to a command since.
    """

    issued: tuple[IssuedCommand, ...] = ()
    mismatches: tuple[float, ...] = ()
    delay_ticks: int = 0
    delivered: float = 0.0
    commanded: float = 0.0
    candidate: int | None = None
    seen: tuple[float, float, float] | None = None
    is_overridden: bool = False


class ActuationObserver:
    """Compares actuated accelerations with the commands of earlier ticks."""

    def __init__(self, limits: LimitParameters, tick_s: float) -> None:
        self._limits = limits
        self._tick_s = tick_s
        self._delays = range(max(FEWEST_DELAYS, round(LONGEST_DELAY_S / tick_s)) + 1)
        self._noticeable = (0.2 * limits.max_jerk_m_s3 * tick_s) ** 2
        self.memory = ActuationMemory()

    @property
    def delay_s(self) -> float:
        """Time by which commands act late."""
        return self.memory.delay_ticks * self._tick_s

    @property
    def last_command(self) -> Command | None:
        """The newest command, None before the first."""
        issued = self.memory.issued
        return (
            Command(issued[-1].acceleration_m_s2, issued[-1].compressor_power_w) if issued else None
        )

    @property
    def brake_share(self) -> float:
        """Share of a commanded deceleration that is delivered, from 0.3 to 1."""
        memory = self.memory
        if memory.commanded < BRAKING_M_S2**2:
            return 1.0
        return min(max(memory.delivered / memory.commanded, SMALLEST_SHARE), 1.0)

    @property
    def has_weak_brakes(self) -> bool:
        """Whether the brakes deliver noticeably less than commanded, and no delay explains that better."""
        if self.brake_share >= WEAK_SHARE:
            return False
        mismatches = self.memory.mismatches or (0.0,)
        prompt = mismatches[self.memory.delay_ticks] if len(mismatches) > 1 else 0.0
        return prompt <= AS_WELL * min(mismatches) + _ROUND_OFF

    @property
    def reason(self) -> str:
        """Fault of the actuators, empty for none."""
        parts = []
        if self.memory.delay_ticks:
            parts.append(f"commands act {self.memory.delay_ticks} ticks late")
        if self.has_weak_brakes:
            parts.append(f"brakes deliver {self.brake_share:.0%} of the commanded deceleration")
        return "; ".join(parts)

    def further_way_m(self, speed_m_s: float, hardest_m_s2: float) -> float:
        """Return by how much weak brakes lengthen a stop that would be as hard as stated."""
        return speed_m_s * speed_m_s / (2.0 * hardest_m_s2) * (1.0 / self.brake_share - 1.0)

    @property
    def found(self) -> tuple[str, float, float]:
        """Reason, delay, and share of the brakes, 1 where a delay explains what they seem to lack."""
        is_weak = self.has_weak_brakes or self.brake_share >= WEAK_SHARE
        return self.reason, self.delay_s, self.brake_share if is_weak else 1.0

    def issue(self, time_s: float, command: Command) -> None:
        """Note the command that answers the measurements of a trip time."""
        tick = round(time_s / self._tick_s)
        kept = [
            entry for entry in self.memory.issued if tick - len(self._delays) <= entry.tick < tick
        ]
        issued = IssuedCommand(tick, command.acceleration_m_s2, command.compressor_power_w)
        self.memory = replace(self.memory, issued=(*kept, issued))

    def observe(self, state: VehicleState) -> None:
        """Compare the acceleration of the tick that ended now with the commands of earlier ticks."""
        tick = round(state.time_s / self._tick_s)
        memory = self.memory
        if memory.issued and tick <= memory.issued[-1].tick:
            if tick < memory.issued[-1].tick:
                self.memory = ActuationMemory()
            return
        issued = {entry.tick: entry.acceleration_m_s2 for entry in memory.issued}
        answered = [issued.get(tick - 1 - delay) for delay in self._delays]
        measured = state.acceleration_m_s2
        prompt = answered[memory.delay_ticks]
        at_rest = state.speed_m_s < CREEP_SPEED_M_S
        memory = replace(
            memory,
            seen=(state.time_s, state.speed_m_s, measured),
            is_overridden=not at_rest and self._is_overridden(state),
        )
        if at_rest and any(memory.mismatches):
            memory = replace(memory, mismatches=(), candidate=None)
        self.memory = memory
        if prompt is None or at_rest or memory.is_overridden:
            return
        before = memory.mismatches or (0.0,) * len(answered)
        mismatches = tuple(
            [
                FORGETTING * mismatch + self._mismatch(measured, commanded)
                for mismatch, commanded in zip(before, answered, strict=True)
            ]
        )
        delay = memory.delay_ticks
        best = mismatches.index(min(mismatches))
        explains = mismatches[best] < EXPLAINED * mismatches[delay] - self._noticeable or (
            mismatches[best] < EXPLAINED_IN_FULL * mismatches[delay]
            and mismatches[delay] > DISTINCT * self._noticeable
        )
        candidate = best if explains else None
        delivered, asked = memory.delivered, memory.commanded
        if candidate is not None and candidate == memory.candidate:
            delay, candidate = best, None
            delivered = asked = 0.0  # they belong to commands that were not the ones answered
        commanded = answered[delay]
        # A command that is not followed at all shows nothing about the brakes.
        if commanded is not None and measured < SMALLEST_SHARE * min(commanded, 0.0) <= (
            SMALLEST_SHARE * BRAKING_M_S2
        ):
            delivered = FORGETTING * delivered + measured * commanded
            asked = FORGETTING * asked + commanded * commanded
        self.memory = replace(
            memory,
            mismatches=mismatches,
            delay_ticks=delay,
            delivered=delivered,
            commanded=asked,
            candidate=candidate,
        )

    def _is_overridden(self, state: VehicleState) -> bool:
        """Return whether the motion of a tick answers no command, as the safety monitor braked.

        From then on, until the acceleration changes by less than the jerk limit again: on the way back the
        vehicle limits every command.
        """
        lowest, measured_m_s2 = self._limits.min_acceleration_m_s2, state.acceleration_m_s2
        if measured_m_s2 < lowest - 0.05:
            return True
        if self.memory.seen is None:
            return False
        before_s, before_m_s, before_m_s2 = self.memory.seen
        if state.time_s - before_s > 1.5 * self._tick_s:
            return False
        changed_m_s = state.speed_m_s - before_m_s
        unexplained = unexplained_change(changed_m_s, before_m_s2, measured_m_s2, self._tick_s)
        if abs(unexplained) > UNEXPLAINED_M_S:
            return True
        most = self._limits.max_jerk_m_s3 * self._tick_s
        change = measured_m_s2 - max(before_m_s2, lowest)
        if self.memory.is_overridden:
            return abs(change) > most - _ROUND_OFF
        return change < -most - BEYOND_M_S2

    def predicted(self, state: VehicleState) -> VehicleState:
        """Return the state at the instant at which the next command acts; the state itself without delay.

        Motion follows the commands under way. Temperatures are held: over two seconds they change by less
        than 0.1 K. Its acceleration follows the last command, of which weak brakes deliver a share.
        """
        if not self.memory.delay_ticks:
            acceleration = state.acceleration_m_s2
            if acceleration >= 0.0 or not self.has_weak_brakes:
                return state
            return replace(state, acceleration_m_s2=acceleration / self.brake_share)
        tick = round(state.time_s / self._tick_s)
        first = tick - self.memory.delay_ticks
        for entry in self.memory.issued:
            if first <= entry.tick < tick:
                acceleration = entry.acceleration_m_s2
                delivered = acceleration if acceleration > 0.0 else acceleration * self.brake_share
                state = replace(
                    self._moved_on(state, delivered),
                    acceleration_m_s2=acceleration,
                    compressor_power_w=entry.compressor_power_w,
                )
        return state

    def _moved_on(self, state: VehicleState, acceleration_m_s2: float) -> VehicleState:
        """Return the state after a tick of constant acceleration, between standstill and top speed."""
        speed, tick_s = state.speed_m_s, self._tick_s
        end = speed + acceleration_m_s2 * tick_s
        within = min(max(end, 0.0), max(self._limits.max_speed_m_s, speed))
        moving_s = tick_s if within == end else (within - speed) / acceleration_m_s2
        moved_m = 0.5 * (speed + within) * moving_s + within * (tick_s - moving_s)
        return replace(
            state,
            time_s=state.time_s + tick_s,
            position_m=state.position_m + moved_m,
            speed_m_s=within,
        )

    def _mismatch(self, measured_m_s2: float, commanded_m_s2: float | None) -> float:
        """Return the squared mismatch of a measured acceleration and a command, weak brakes permitted."""
        if commanded_m_s2 is None:
            return self._limits.max_jerk_m_s3**2
        exact = (measured_m_s2 - commanded_m_s2) ** 2
        if commanded_m_s2 >= BRAKING_M_S2:
            return exact
        share = min(max(measured_m_s2 / commanded_m_s2, SMALLEST_SHARE), 1.0)
        weak = (measured_m_s2 - share * commanded_m_s2) ** 2 + self._noticeable
        return min(exact, weak)


REFERENCE_RATE_1_H = 2.0
"""Power over energy of a pack without limits, of which a failed sensor leaves a share."""
GENTLE_M_S2 = -0.5
"""A pack that gives less than the road asks for lets the car slow down, but does not brake it harder."""


class PowerAuthority:
    """Limits of the power of the pack at a tick.

    Args:
        parameters: of the vehicle, at any charge.
        tick_s: for which a command holds.
        times_s: ends of the steps of the motion in a plan, from its beginning.

    Attributes:
        limits: of the tick, `UNLIMITED` where nothing limits the pack.
        most_m_s2: acceleration that the last command was bounded by, infinite for none.
    """

    def __init__(
        self, parameters: ModelParameters, tick_s: float, times_s: FloatArray | None = None
    ) -> None:
        self._parameters = parameters
        self._is_limited = parameters.pack_limits.limited
        self._tick_s = tick_s
        self._times_s = np.empty(0) if times_s is None else times_s
        energy_wh = parameters.cell.nominal_capacity_ah * parameters.pack.parallel
        energy_wh *= parameters.pack.open_circuit_voltage_v
        self._reference_w = REFERENCE_RATE_1_H * energy_wh
        self._state: VehicleState | None = None
        self._slope: SlopePreview | None = None
        self.limits = UNLIMITED
        self.most_m_s2 = math.inf

    def update(self, state: VehicleState, slope: SlopePreview, share: float = 1.0) -> None:
        """Work out the limits of a tick.

        Args:
            share: what the sensors of the pack leave of its power.
        """
        self._state, self._slope = state, slope
        if self._is_limited:
            cells = CellPair(
                state.cell_1_temperature_k,
                state.cell_n_temperature_k,
                state.cell_1_capacity_loss,
                state.cell_n_capacity_loss,
            )
            known = power_limits(cells, state.state_of_charge, self._parameters, self._tick_s)
        else:
            known = PowerLimits(self._reference_w, self._reference_w) if share < 1.0 else UNLIMITED
        self.limits = known.reduced(share) if share < 1.0 else known

    @property
    def charge_w(self) -> float:
        """Largest charging power that plans count on, finite."""
        return min(self.limits.charge_w, UNBOUNDED_W)

    def within(self, command: Command) -> Command:
        """Return a command whose acceleration the pack can supply."""
        state, slope = self._state, self._slope
        self.most_m_s2 = math.inf
        if state is None or slope is None or math.isinf(self.limits.discharge_w):
            return command
        slope_rad = slope_at_rad(slope, state.position_m)
        self.most_m_s2 = self.largest_acceleration_m_s2(
            state.speed_m_s, slope_rad, command.compressor_power_w
        )
        slower = min(command.acceleration_m_s2, self.most_m_s2)
        return replace(command, acceleration_m_s2=slower)

    def slower(self, speeds_m_s: FloatArray | None) -> FloatArray | None:
        """Return the speed limits at the ends of the motion steps, lowered to what the car can reach."""
        state, slope = self._state, self._slope
        if state is None or slope is None or math.isinf(self.limits.discharge_w):
            return speeds_m_s
        reached = self._reachable_speeds_m_s(state, slope)
        if speeds_m_s is not None:
            return np.minimum(reached, speeds_m_s)
        return reached if (reached < self._parameters.limits.max_speed_m_s).any() else None

    def largest_acceleration_m_s2(
        self, speed_m_s: float, slope_rad: float, thermal_w: float = 0.0
    ) -> float:
        """Return the largest acceleration that the pack can supply, not below `GENTLE_M_S2`."""
        largest, most_w = self._parameters.limits.max_acceleration_m_s2, self.limits.discharge_w

        def excess_w(acceleration_m_s2: float) -> float:
            return self._drawn_w(speed_m_s, acceleration_m_s2, slope_rad, thermal_w) - most_w

        return largest_within(excess_w, GENTLE_M_S2, largest)

    def _reachable_speeds_m_s(self, state: VehicleState, slope: SlopePreview) -> FloatArray:
        """Return the speeds that the car cannot exceed at the ends of the motion steps."""
        speed, position, now_s = state.speed_m_s, state.position_m, 0.0
        top = self._parameters.limits.max_speed_m_s
        reached = []
        for end_s in self._times_s.tolist():
            while now_s < end_s - 1e-9:
                length_s = min(1.0, end_s - now_s)
                slope_rad = slope_at_rad(slope, position)
                by = self.largest_acceleration_m_s2(speed, slope_rad)
                after = min(max(speed + by * length_s, 0.0), top)
                position += 0.5 * (speed + after) * length_s
                speed, now_s = after, now_s + length_s
            reached.append(speed)
        speeds: FloatArray = np.array(reached)
        return speeds

    def _drawn_w(
        self, speed_m_s: float, acceleration_m_s2: float, slope_rad: float, thermal_w: float
    ) -> float:
        """Return the terminal power at the end of a tick, where it is largest."""
        values = self._parameters
        faster = max(speed_m_s + max(acceleration_m_s2, 0.0) * self._tick_s, 0.0)
        traction = electric_traction_power_w(faster, acceleration_m_s2, slope_rad, values)
        auxiliary_w = values.cooling.auxiliary_power_w
        return float(
            battery_power_w(traction, abs(thermal_w), auxiliary_w, values.pack, values.powertrain)
        )
