"""The road ahead in the optimal control problem: a motion that stands for its rules, and speed limits.

The cost has no term for progress, and with ageing alone it would rather stand: what makes the ego vehicle
drive is the largest gap. So the rules of the road enter as a lead motion that exists in the controller only.
It is a pace ahead by the largest gap: a driver at the limits, who halts at closed lines and stays
ahead of the ego vehicle. In front of a closed line it stands behind the line. The ego vehicle has the
same room behind it as behind a vehicle, within which the cost decides. Its own speed is limited at every
node as well. Of a lead vehicle and the rules the nearer one counts at every instant.
"""

from __future__ import annotations

import math

import numpy as np

from iptm_controller.decision import PaceMemory
from iptm_controller.forecast import LeaderForecast
from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import maximum_gap_m
from iptm_core.road_ahead import BRAKING_M_S2, RoadAhead, SpeedLimits, lawful_drive
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, VehicleState

LAG_M, LAG_S = 3.0, 2.5
"""The ego vehicle may be behind the pace by this distance and time, to smooth what the limits make of it."""
ROOM_S = 0.5
"""The lead motion is ahead of the pace by this headway at least, beyond the spacing policy."""
LOOK_AHEAD_S = 60.0
_STEP_S = 0.5


class RoadEnvelope:
    """Turns the road ahead into what the problem takes.

    Attributes:
        pace: where the pace was at the last tick; what is lost behind it is made up for.
    """

    def __init__(self, parameters: ModelParameters, tick_s: float) -> None:
        self._gap, self._limits, self._tick_s = parameters.gap, parameters.limits, tick_s
        self.pace: PaceMemory | None = None

    def lead(
        self, state: VehicleState, road: RoadAhead, forecast: LeaderForecast | None
    ) -> tuple[LeaderPreview, LeaderPreview]:
        """Return the lead motion: at every instant the nearer one of lead vehicle and rules.

        Args:
            road: rules, with limits.
            forecast: of the lead vehicle, None without one. Where the rules are nowhere nearer, its motion is
                returned as it is.

        Returns:
            The expected motion, past and future, and the one that the gap limits hold for.
        """
        rules = self._of_rules(state, road)
        if forecast is None:
            return rules, rules
        if forecast.motion.at(rules.times_s[:1])[0][0] <= rules.positions_m[0]:
            self._hold()
        motion = limiting = self._nearer(rules, forecast.motion)
        if forecast.limiting is not forecast.motion:
            limiting = self._nearer(rules, forecast.limiting)
        return motion, limiting

    @staticmethod
    def follows(time_s: float, motion: LeaderPreview, forecast: LeaderForecast | None) -> bool:
        """Return whether the nearest ahead at an instant, ``motion``, is the lead vehicle and not a rule."""
        if forecast is None:
            return False
        if motion is forecast.motion:
            return True
        now = np.array([time_s])
        return bool(motion.at(now)[0][0] >= forecast.motion.at(now)[0][0])

    def _nearer(self, rules: LeaderPreview, leader: LeaderPreview) -> LeaderPreview:
        times = rules.times_s
        positions, speeds = leader.at(times)
        nearer = rules.positions_m < positions
        if not nearer.any():
            return leader
        # The vehicle beyond may brake to a halt at any node, and then halts nearer than the rules would.
        hardest_m_s2 = -self._limits.min_acceleration_m_s2
        room_m = np.maximum(positions - rules.positions_m, 0.0)
        halting = np.sqrt(2.0 * hardest_m_s2 * room_m + speeds**2)
        nearest = np.maximum.accumulate(np.where(nearer, rules.positions_m, positions))
        speeds = np.where(nearer, np.minimum(rules.speeds_m_s, halting), speeds)
        return LeaderPreview(times, nearest, speeds)

    def _of_rules(self, state: VehicleState, road: RoadAhead) -> LeaderPreview:
        if road.limits is None:
            raise AssertionError("rules without limits bind to nothing")
        steps = round(LOOK_AHEAD_S / _STEP_S)
        gap = self._gap
        largest_m = float(maximum_gap_m(state.speed_m_s, gap))
        start = self._paced(state, road, road.limits, largest_m)
        pace = lawful_drive(road.limits, road.stops, start, steps, _STEP_S)
        speeds = pace.speeds_m_s
        spacing_m = gap.standstill_gap_m + (gap.time_headway_s + ROOM_S) * speeds
        positions = pace.positions_m + np.maximum(largest_m - LAG_M - LAG_S * speeds, spacing_m)
        for stop in road.stops:
            behind_m = stop.position_m + gap.standstill_gap_m
            stands = (pace.times_s < stop.until_s) & (positions > behind_m)
            positions, speeds = np.where(stands, behind_m, positions), np.where(stands, 0.0, speeds)
        return LeaderPreview(pace.times_s, np.maximum.accumulate(positions), speeds)

    def _paced(
        self, state: VehicleState, road: RoadAhead, limits: SpeedLimits, largest_m: float
    ) -> tuple[float, float, float]:
        """Return time, position and speed from which the pace goes on, and keep them."""
        pace = self.pace
        if pace is None or pace.is_held or pace.time_s > state.time_s:
            # It has waited for an ego vehicle that something else held, and starts again with it.
            position_m, pace_m_s = state.position_m, state.speed_m_s
        else:
            steps = max(math.ceil((state.time_s - pace.time_s) / _STEP_S), 1)
            step_s = (state.time_s - pace.time_s) / steps
            start = (pace.time_s, pace.position_m, pace.speed_m_s)
            moved = lawful_drive(limits, road.stops, start, steps, step_s)
            position_m, pace_m_s = float(moved.positions_m[-1]), float(moved.speeds_m_s[-1])
            position_m = min(max(position_m, state.position_m - largest_m), state.position_m)
        self.pace = PaceMemory(state.time_s, position_m, pace_m_s, is_held=False)
        return state.time_s, position_m, pace_m_s

    def _hold(self) -> None:
        """Note that something else than the pace binds the ego vehicle."""
        if self.pace is not None:
            self.pace = replace(self.pace, is_held=True)

    def nearest(
        self, state: VehicleState, road: RoadAhead, leader: LeaderState | None
    ) -> LeaderState:
        """Return where what is nearest now is, the lead vehicle or the rules, for driving without a plan."""
        rules = self._of_rules(state, road)
        position_m, speed_m_s = float(rules.positions_m[0]), float(rules.speeds_m_s[0])
        if leader is not None and leader.position_m <= position_m:
            return leader
        return LeaderState(state.time_s, position_m, speed_m_s)

    def speed_limits_m_s(
        self, road: RoadAhead, expected: tuple[FloatArray, FloatArray, FloatArray]
    ) -> FloatArray:
        """Return the speed limits at the ends of the motion steps, shape (n,).

        Each is the lowest one around the place where the ego vehicle is expected, a tick to either side, as
        speeds are limited at the nodes only and the plan may come out a little different.

        Args:
            road: rules, with limits.
            expected: times, positions and speeds of the expected motion at the nodes, shape (n + 1,) each.
        """
        if road.limits is None:
            raise AssertionError("rules without limits bind to nothing")
        _, places, speeds = expected
        positions_m, reach_m = places[1:], np.maximum(speeds[1:], 0.0) * self._tick_s
        around = np.stack([positions_m - reach_m, positions_m, positions_m + reach_m])
        approach = [road.limits.approach_at_m_s(place) for place in around.ravel().tolist()]
        limits: FloatArray = np.array(approach).reshape(around.shape).min(axis=0)
        return limits

    def command_m_s2(self, state: VehicleState, road: RoadAhead | None) -> float:
        """Return the acceleration of a driver who keeps the limits and foresees what comfort needs.

        Args:
            road: rules, with limits; without any, nothing limits the acceleration.
        """
        if road is None or road.limits is None:
            return math.inf
        speed, jerk = state.speed_m_s, self._limits.max_jerk_m_s3
        # Brakes build up within the jerk limit, so it begins to brake as if it were farther on.
        ahead_m = speed * (0.5 * BRAKING_M_S2 / jerk + self._tick_s)
        start = (state.time_s, state.position_m + ahead_m, speed)
        steps = max(round(self._tick_s / _STEP_S), 1)
        drive = lawful_drive(road.limits, road.stops, start, steps, self._tick_s / steps)
        wanted = (float(drive.speeds_m_s[-1]) - speed) / self._tick_s
        rest_m_s = max(road.limits.approach_at_m_s(state.position_m) - speed, 0.0)
        return min(wanted, math.sqrt(jerk * rest_m_s)) if wanted > 0.0 else wanted
