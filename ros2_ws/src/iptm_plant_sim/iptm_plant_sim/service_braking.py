"""An interval of the vehicle under its safety monitor: checked at its instants, braked where that is needed.

Service braking overrides the command: after the delay of the brakes the deceleration builds up to what they
can, and the compressor goes on as commanded. Released, it falls at the same rate back into the comfort
limits, where the command acts again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.radio_lead import RadioLead
from iptm_core.state import Command, LeaderPreview, SafetyRecord, VehicleState
from iptm_plant_sim.actuators import (
    STANDSTILL_ACCELERATION_M_S2,
    STANDSTILL_SPEED_M_S,
    ActuatorReport,
)
from iptm_plant_sim.interval import PlantStep, joined
from iptm_plant_sim.lead_measurements import LeadMeasurements
from iptm_plant_sim.safety_monitor import (
    MonitorMemory,
    RoadBraking,
    SafetyMonitor,
    with_delivery,
)

RangeSensor = Callable[[VehicleState], "LeaderPreview | None"]
"""From the state at the start of an interval to the measurements of the vehicle ahead in it, in order; see
`LeadMeasurements`."""
DriveInterval = Callable[[VehicleState, ActuatorReport, float], PlantStep]
RAMP_STEP_S = 0.05
"""Step over which the acceleration is constant, at its mean, while brakes build up or are released."""
_RESOLUTION_S = 1e-9


@dataclass(frozen=True)
class ServiceBrakes:
    """The brakes of a vehicle as actuators.

    Attributes:
        strength: share of every requested deceleration that is delivered, above 0.
        most_m_s2: largest deceleration that brakes, tyres and slope permit, above 0.
    """

    parameters: ModelParameters
    strength: float
    most_m_s2: float = math.inf

    def delivered_m_s2(self, requested_m_s2: float) -> float:
        """Return the acceleration that follows from a requested one."""
        if requested_m_s2 >= 0.0:
            return requested_m_s2
        return max(requested_m_s2 * self.strength, -self.most_m_s2)

    def requested_m_s2(self, delivered_m_s2: float) -> float:
        """Return the request from which an acceleration followed."""
        return delivered_m_s2 / self.strength if delivered_m_s2 < 0.0 else delivered_m_s2

    def target_m_s2(
        self, memory: MonitorMemory, time_s: float, command_m_s2: float, gently_m_s2: float
    ) -> float:
        """Return the acceleration that is asked for at an instant.

        Args:
            gently_m_s2: deceleration of gentle braking, positive.
        """
        brakes = self.parameters.brakes
        if memory.braking and time_s >= memory.since_s + brakes.delay_s - _RESOLUTION_S:
            most_m_s2 = brakes.max_deceleration_m_s2
            asked_m_s2 = min(gently_m_s2, most_m_s2) if memory.gently else most_m_s2
            return min(-asked_m_s2, command_m_s2)
        return command_m_s2

    def ramp(self, start_m_s2: float, target_m_s2: float, duration_s: float) -> tuple[float, float]:
        """Return the mean and the last acceleration of a time in which the requested one nears its target.

        Within the comfort limits requests act at once.
        """
        comfort_m_s2 = self.parameters.limits.min_acceleration_m_s2
        if start_m_s2 >= comfort_m_s2 and target_m_s2 >= comfort_m_s2:
            return target_m_s2, target_m_s2
        rate = math.copysign(self.parameters.brakes.build_up_m_s3, target_m_s2 - start_m_s2)
        ramp_s = min((target_m_s2 - start_m_s2) / rate, duration_s)
        last = target_m_s2 if ramp_s < duration_s else start_m_s2 + rate * duration_s
        mean = (
            0.5 * (start_m_s2 + last) * ramp_s + target_m_s2 * (duration_s - ramp_s)
        ) / duration_s
        return mean, last


class MonitoredInterval:
    """One interval: `drive` is the way into it."""

    def __init__(
        self,
        monitor: SafetyMonitor,
        brakes: ServiceBrakes,
        drive_interval: DriveInterval,
        state: VehicleState,
        report: ActuatorReport,
        duration_s: float,
        slope_rad: float = 0.0,
        radio: RadioLead | None = None,
    ) -> None:
        """Set up an interval.

        Args:
            drive_interval: integrates a part of the interval at constant acceleration.
            report: the command after the limits of comfort; its acceleration is the requested one.
            slope_rad: slope at its start, positive uphill.
            radio: where messages place the vehicle ahead; None where they do not count.
        """
        self._monitor, self._brakes, self._drive_interval = monitor, brakes, drive_interval
        self._state, self._report, self._duration_s = state, report, duration_s
        self._slope_rad, self._radio = slope_rad, radio
        self._requested_m_s2 = report.actuated.acceleration_m_s2
        self._delivered_m_s2 = brakes.delivered_m_s2(self._requested_m_s2)
        self._stands = (
            state.speed_m_s < STANDSTILL_SPEED_M_S
            and self._delivered_m_s2 < STANDSTILL_ACCELERATION_M_S2
        )

    @cached_property
    def _instants_s(self) -> list[float]:
        """Instants at which the monitor looks, from the start of the interval on."""
        period_s = self._monitor.settings.monitor_period_s
        count = max(1, math.ceil((self._duration_s - _RESOLUTION_S) / period_s))
        return [index * period_s for index in range(count)]

    def drive(self, memory: MonitorMemory, samples: LeaderPreview | None) -> PlantStep:
        """Drive the interval.

        Args:
            samples: measurements of the vehicle ahead; see `LeadMeasurements`.
        """
        radio = self._radio
        if radio is not None and (samples is None or radio.agrees_with(samples)):
            radio = None
        given = memory.lead, samples, self._motion_at, self._state.time_s
        leads = LeadMeasurements(*given, radio)
        calm = not memory.braking and self._is_comfort(memory.requested_m_s2)
        if not calm or self._may_be_unsafe(memory, leads):
            return self._drive_in_pieces(replace(memory, lead=leads.track), leads)
        gap_m = leads.smallest_gap_m(self._state.time_s)
        step = self._piece(self._state, self._requested_m_s2, self._duration_s)
        memory = replace(
            self._learned(memory, self._requested_m_s2, step, self._duration_s),
            requested_m_s2=self._requested_m_s2,
            lead=leads.track,
        )
        record = SafetyRecord(0.0, gap_m, memory.brake_share, self._report.source)
        return replace(step, memory=memory, safety=record)

    def _is_comfort(self, acceleration_m_s2: float) -> bool:
        return acceleration_m_s2 >= self._brakes.parameters.limits.min_acceleration_m_s2

    def _piece(self, state: VehicleState, requested_m_s2: float, duration_s: float) -> PlantStep:
        actuated = self._report.actuated
        delivered = self._brakes.delivered_m_s2(requested_m_s2)
        if delivered == actuated.acceleration_m_s2:
            return self._drive_interval(state, self._report, duration_s)
        actuated = Command(delivered, actuated.compressor_power_w)
        return self._drive_interval(state, replace(self._report, actuated=actuated), duration_s)

    @staticmethod
    def _learned(
        memory: MonitorMemory, requested_m_s2: float, step: PlantStep, duration_s: float
    ) -> MonitorMemory:
        end = step.state
        return with_delivery(
            memory, requested_m_s2, end.acceleration_m_s2, end.speed_m_s, duration_s
        )

    # --- an interval without braking, in closed form

    def _motion_at(self, after_s: float) -> tuple[float, float]:
        """Return position and speed if the command is carried out; the top speed is not looked at."""
        state, a = self._state, self._delivered_m_s2
        if self._stands:
            return state.position_m, 0.0
        speed = state.speed_m_s
        if a < 0.0:
            after_s = min(after_s, speed / -a)
        position_m = state.position_m + after_s * (speed + 0.5 * a * after_s)
        return position_m, max(speed + a * after_s, 0.0)

    def _may_be_unsafe(self, memory: MonitorMemory, leads: LeadMeasurements) -> bool:
        """Return whether the monitor has to look at every instant."""
        road = self._monitor.road_braking(self._slope_rad, memory.road_m_s2)
        if leads.brakes_harder_than(road.better_grip_m_s2):
            return True
        if self._is_safe_throughout(memory, leads, road):
            return False
        start_s = self._state.time_s
        for after_s in self._instants_s:
            position_m, speed_m_s = self._motion_at(after_s)
            lead, unseen_s, _ = leads.at(start_s + after_s, road.full.lead_m_s2)
            if lead is not None and self._monitor.is_unsafe(
                lead.position_m - position_m,
                speed_m_s,
                self._requested_m_s2,
                lead.speed_m_s,
                memory.brake_share,
                road,
                unseen_s,
            ):
                return True
        return False

    def _is_safe_throughout(
        self, memory: MonitorMemory, leads: LeadMeasurements, road: RoadBraking
    ) -> bool:
        """Return whether even the worst values of all instants together are safe.

        The safe distance grows with the own speed and falls with the speed of the vehicle ahead.
        """
        bounds = leads.bounds()
        if bounds is None:
            return False
        position_m, speed_m_s = self._motion_at(self._duration_s)
        return not self._monitor.is_unsafe(
            bounds[0] - position_m,
            max(speed_m_s, self._state.speed_m_s),
            self._requested_m_s2,
            bounds[1],
            memory.brake_share,
            road,
        )

    # --- an interval with braking, piece by piece

    def _drive_in_pieces(self, memory: MonitorMemory, leads: LeadMeasurements) -> PlantStep:
        start_s, command_m_s2 = self._state.time_s, self._requested_m_s2
        pieces: list[tuple[PlantStep, float]] = []
        state, braking_s, smallest_m = self._state, 0.0, math.nan
        requested = memory.requested_m_s2
        for begin_s, end_s in zip(
            self._instants_s, [*self._instants_s[1:], self._duration_s], strict=True
        ):
            road = self._monitor.road_braking(self._slope_rad, memory.road_m_s2)
            lead, unseen_s, measured = leads.at(start_s + begin_s, road.full.lead_m_s2)
            if lead is not None and measured and begin_s > 0.0:
                gap_m = lead.position_m - state.position_m
                smallest_m = gap_m if math.isnan(smallest_m) else min(smallest_m, gap_m)
            road = road.behind(leads.shown_deceleration_m_s2(start_s + begin_s))
            ego = (state.position_m, state.speed_m_s, command_m_s2)
            memory = self._monitor.judge(memory, start_s + begin_s, ego, lead, road, unseen_s)
            for length_s, target in self._parts(memory, begin_s, end_s):
                if memory.braking or not self._is_comfort(requested):
                    braking_s += length_s
                mean, requested = self._brakes.ramp(requested, target, length_s)
                step = self._piece(state, mean, length_s)
                memory = self._learned(memory, mean, step, length_s)
                pieces.append((step, length_s))
                state = step.state
        memory = replace(memory, requested_m_s2=requested)
        record = SafetyRecord(braking_s, smallest_m, memory.brake_share, self._report.source)
        step = joined(pieces, self._report, start_s + self._duration_s)
        return replace(step, memory=memory, safety=record)

    def _parts(
        self, memory: MonitorMemory, begin_s: float, end_s: float
    ) -> list[tuple[float, float]]:
        """Return lengths and targets of the parts of the time between two instants."""
        cuts = [begin_s, end_s]
        acts_s = memory.since_s + self._brakes.parameters.brakes.delay_s - self._state.time_s
        if memory.braking and begin_s + _RESOLUTION_S < acts_s < end_s - _RESOLUTION_S:
            cuts.insert(1, acts_s)
        parts = []
        for start, stop in pairwise(cuts):
            target = self._brakes.target_m_s2(
                memory,
                self._state.time_s + start,
                self._requested_m_s2,
                self._monitor.gentle_deceleration_m_s2,
            )
            count = max(1, math.ceil((stop - start) / RAMP_STEP_S - 1e-6))
            parts += [((stop - start) / count, target)] * count
        return parts
