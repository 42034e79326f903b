"""Safety monitor of the vehicle: worst-case reasoning from what is measured now, without any prediction.

The rule is the safe longitudinal distance of responsibility-sensitive safety (RSS): S. Shalev-Shwartz,
S. Shammah, A. Shashua, "On a formal model of safe and scalable self-driving cars", arXiv:1708.06374 (2017),
definition 1, with the assumptions that IEEE 2846-2022 names: the vehicle ahead may brake with its hardest
deceleration from now on; the ego vehicle continues at its present acceleration for the reaction time and
brakes then. UN R157 has the same form. Other than in definition 1 the brakes have a delay and build up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from iptm_core.parameters.model import BrakeParameters
from iptm_core.settings import SafetyMonitorSettings
from iptm_core.state import FloatArray, LeaderPreview, LeaderState

SHARE_TIME_CONSTANT_S = 0.3
"""Time constant of the estimated brake share, which settles within 1 s of braking."""
LEAST_SHARE = 0.1
JUDGED_FROM_M_S2 = 0.3
JUDGED_FROM_M_S = 0.5
"""Smallest requested deceleration and speed at which the brake share is estimated."""
_RESOLUTION_S = 1e-9
ANOTHER_LEAD_M = 3.0
"""Position jump, beyond the motion at its speeds, from which it is another vehicle."""
LARGEST_MEASURING_INTERVAL_S = 5.0
"""Longest interval between two measurements from which an acceleration is estimated."""
SILENT_S = 1.5
"""Age of the last measurement from which the vehicle ahead is assumed to brake."""
SILENT_DECELERATION_M_S2 = 3.0
"""Assumed deceleration of a vehicle that is not measured any more: harder than drivers brake in ordinary
traffic. The hardest deceleration instead would answer every dropout of the sensor with an emergency stop."""


@dataclass(frozen=True)
class MonitorMemory:
    """What monitor and brakes carry from one instant to the next.

    Attributes:
        braking: the monitor brakes.
        since_s: trip time of its request to brake; of the last one while it does not brake.
        reason: the numbers behind that request, empty before the first one.
        requested_m_s2: acceleration that is requested at present, after delay and build-up of the brakes.
        brake_share: share of the requested deceleration that the brakes deliver, as estimated.
        lead: latest measurement of the vehicle ahead; None for none.
        lead_acceleration_m_s2: its acceleration between the last two measurements.
    """

    braking: bool = False
    since_s: float = 0.0
    reason: str = ""
    requested_m_s2: float = 0.0
    brake_share: float = 1.0
    lead: LeaderState | None = None
    lead_acceleration_m_s2: float = 0.0


def stopping_distance_m(
    speed_m_s: float,
    acceleration_m_s2: float,
    wait_s: float,
    deceleration_m_s2: float,
    build_up_m_s3: float,
) -> float:
    """Return the distance to standstill of a vehicle that brakes after a while.

    Args:
        acceleration_m_s2: acceleration now, kept until the brakes act.
        wait_s: time until the brakes act.
        deceleration_m_s2: deceleration of the brakes, positive.
        build_up_m_s3: rate at which it builds up.
    """
    a, speed = acceleration_m_s2, speed_m_s
    if speed + a * wait_s <= 0.0:
        return speed * speed / (-2.0 * a) if a < 0.0 else 0.0
    distance = wait_s * (speed + 0.5 * a * wait_s)
    speed += a * wait_s
    if a > -deceleration_m_s2:
        rise_s = (a + deceleration_m_s2) / build_up_m_s3
        after = speed + rise_s * (a - 0.5 * build_up_m_s3 * rise_s)
        if after <= 0.0:
            rise_s = (a + math.sqrt(a * a + 2.0 * build_up_m_s3 * speed)) / build_up_m_s3
        distance += rise_s * (speed + rise_s * (0.5 * a - build_up_m_s3 * rise_s / 6.0))
        speed = max(after, 0.0)
    return distance + speed * speed / (2.0 * deceleration_m_s2)


class SafetyMonitor:
    """The rule with its parameters; pure, what changes is in `MonitorMemory`."""

    def __init__(self, settings: SafetyMonitorSettings, brakes: BrakeParameters) -> None:
        self.settings = settings
        self._brakes = brakes
        self._own_m_s2 = min(settings.monitor_own_deceleration_m_s2, brakes.max_deceleration_m_s2)

    def safe_distance_m(
        self,
        speed_m_s: float,
        acceleration_m_s2: float,
        lead_speed_m_s: float,
        brake_share: float = 1.0,
        further_reaction_s: float = 0.0,
    ) -> float:
        """Return the smallest gap from which a collision can be avoided whatever the vehicle ahead does.

        As the ego vehicle is not assumed to brake harder than the one ahead, the gap is smallest either now
        or when both stand.

        Returns:
            Distance in m. 0 for a vehicle that stands and does not accelerate.
        """
        settings = self.settings
        own_m = stopping_distance_m(
            speed_m_s,
            acceleration_m_s2,
            settings.monitor_reaction_s + further_reaction_s + self._brakes.delay_s,
            self._own_m_s2 * brake_share,
            self._brakes.build_up_m_s3 * brake_share,
        )
        if own_m <= 0.0:
            return 0.0
        lead_m = lead_speed_m_s * lead_speed_m_s / (2.0 * settings.monitor_lead_deceleration_m_s2)
        return max(own_m - lead_m, 0.0) + settings.monitor_margin_m

    def is_unsafe(
        self,
        gap_m: float,
        speed_m_s: float,
        acceleration_m_s2: float,
        lead_speed_m_s: float,
        brake_share: float,
    ) -> bool:
        """Return whether the vehicle has to brake now; arguments as for `safe_distance_m`."""
        needed = self.safe_distance_m(speed_m_s, acceleration_m_s2, lead_speed_m_s, brake_share)
        return gap_m < needed

    def judge(
        self,
        memory: MonitorMemory,
        time_s: float,
        ego: tuple[float, float, float],
        lead: LeaderState | None,
    ) -> MonitorMemory:
        """Decide at one instant whether to brake.

        Args:
            ego: position, speed and the acceleration that the vehicle has if the monitor does not brake.
            lead: the vehicle ahead now; None for a free road, on which brakes are released.
        """
        position_m, speed_m_s, acceleration_m_s2 = ego
        share = memory.brake_share
        held = time_s - memory.since_s >= self.settings.monitor_hold_s - 1e-9
        if lead is None:
            return replace(memory, braking=memory.braking and not held)
        gap_m = lead.position_m - position_m
        if memory.braking:
            enough_m = self.safe_distance_m(
                speed_m_s,
                max(acceleration_m_s2, 0.0),
                lead.speed_m_s,
                share,
                self.settings.monitor_release_reaction_s,
            )
            return replace(memory, braking=not held or gap_m < enough_m)
        if not self.is_unsafe(gap_m, speed_m_s, acceleration_m_s2, lead.speed_m_s, share):
            return memory
        safe_m = self.safe_distance_m(speed_m_s, acceleration_m_s2, lead.speed_m_s, share)
        reason = (
            f"gap {gap_m:.1f} m is below the safe distance of {safe_m:.1f} m at {speed_m_s:.1f} m/s behind "
            f"{lead.speed_m_s:.1f} m/s"
        )
        return replace(memory, braking=True, since_s=time_s, reason=reason)


def with_delivery(
    memory: MonitorMemory,
    requested_m_s2: float,
    delivered_m_s2: float,
    speed_m_s: float,
    duration_s: float,
) -> MonitorMemory:
    """Return a memory that has learned from what the brakes made of a request.

    Args:
        requested_m_s2: acceleration requested over an interval, delay and build-up of the brakes allowed for.
        speed_m_s: speed at the end of the interval; standing vehicles show nothing.
    """
    if requested_m_s2 > -JUDGED_FROM_M_S2 or speed_m_s < JUDGED_FROM_M_S:
        return memory
    seen = min(max(delivered_m_s2 / requested_m_s2, LEAST_SHARE), 1.0)
    gain = -math.expm1(-duration_s / SHARE_TIME_CONSTANT_S)
    return replace(memory, brake_share=memory.brake_share + gain * (seen - memory.brake_share))


class LeadMeasurements:
    """The vehicle ahead at any instant of an interval, from what the range sensor measured.

    At the instant of a measurement it is that; behind it, a motion that goes on with the measured
    deceleration, and from `SILENT_S` on with at least `SILENT_DECELERATION_M_S2`. A measured acceleration is
    not relied on.
    """

    def __init__(self, memory: MonitorMemory, samples: LeaderPreview | None) -> None:
        """Take the measurements of an interval.

        Args:
            memory: with the measurement before.
            samples: measurements of the interval in order; none at all for a free road. None if the sensor is
                silent.
        """
        self._memory = memory
        if samples is None:
            samples = _NOTHING if memory.lead is None else _single(memory.lead)
        self._samples = samples
        self._last = samples.times_s.size - 1

    def bounds(self) -> tuple[float, float] | None:
        """Return smallest position and speed measured; None unless it is measured several times."""
        if self._last < 1:
            return None
        return float(self._samples.positions_m.min()), float(self._samples.speeds_m_s.min())

    def at(self, time_s: float) -> tuple[LeaderState | None, bool]:
        """Return the vehicle ahead at an instant, and whether it is measured then; None for a free road."""
        if self._last < 0:
            return None, False
        index = int(np.searchsorted(self._samples.times_s, time_s + _RESOLUTION_S, "right")) - 1
        index = max(index, 0)
        known = self._state(index)
        ahead_s = time_s - known.time_s
        if abs(ahead_s) <= _RESOLUTION_S:
            return known, True
        deceleration = max(-self._acceleration_m_s2(index), 0.0)
        lead = _slowed(known, deceleration, min(ahead_s, SILENT_S))
        if ahead_s > SILENT_S:
            deceleration = max(deceleration, SILENT_DECELERATION_M_S2)
            lead = _slowed(lead, deceleration, ahead_s - SILENT_S)
        return replace(lead, time_s=time_s), False

    def measured_after(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return times and positions of the measurements after an instant, shape (n,) each."""
        first = int(np.searchsorted(self._samples.times_s, time_s + _RESOLUTION_S, "right"))
        return self._samples.times_s[first:], self._samples.positions_m[first:]

    def noted(self, memory: MonitorMemory) -> MonitorMemory:
        """Return a memory with the latest measurement."""
        if self._last < 0:
            return replace(memory, lead=None, lead_acceleration_m_s2=0.0)
        acceleration = self._acceleration_m_s2(self._last)
        return replace(memory, lead=self._state(self._last), lead_acceleration_m_s2=acceleration)

    def _state(self, index: int) -> LeaderState:
        samples = self._samples
        return LeaderState(
            float(samples.times_s[index]),
            float(samples.positions_m[index]),
            float(samples.speeds_m_s[index]),
        )

    def _acceleration_m_s2(self, index: int) -> float:
        """Return the acceleration from the measurement before to another one."""
        now = self._state(index)
        before = self._state(index - 1) if index > 0 else self._memory.lead
        if before is None:
            return 0.0
        interval_s = now.time_s - before.time_s
        if interval_s == 0.0:
            return self._memory.lead_acceleration_m_s2
        if not 0.0 < interval_s <= LARGEST_MEASURING_INTERVAL_S:
            return 0.0
        foreseen_m = 0.5 * (before.speed_m_s + now.speed_m_s) * interval_s
        if abs(now.position_m - before.position_m - foreseen_m) > ANOTHER_LEAD_M:
            return 0.0
        return (now.speed_m_s - before.speed_m_s) / interval_s


def _slowed(lead: LeaderState, deceleration_m_s2: float, duration_s: float) -> LeaderState:
    """Return a vehicle that has braked for a while, to standstill at most."""
    if deceleration_m_s2 > 0.0:
        duration_s = min(duration_s, lead.speed_m_s / deceleration_m_s2)
    moved_m = duration_s * (lead.speed_m_s - 0.5 * deceleration_m_s2 * duration_s)
    speed_m_s = max(lead.speed_m_s - deceleration_m_s2 * duration_s, 0.0)
    return LeaderState(lead.time_s + duration_s, lead.position_m + moved_m, speed_m_s)


def _single(lead: LeaderState) -> LeaderPreview:
    times, positions, speeds = (np.array([value]) for value in vars(lead).values())
    return LeaderPreview(times, positions, speeds)


_NOTHING = LeaderPreview.empty()
