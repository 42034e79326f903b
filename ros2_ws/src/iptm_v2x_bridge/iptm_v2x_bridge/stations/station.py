"""One station as its accepted messages show it, seen from the road."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from iptm_core.routes.road_line import NEAR_M, RoadFix, RoadLine
from iptm_core.state import FloatArray
from iptm_v2x_bridge.messages.cam import ASSUMED_WIDTH_M, SLOW_M_S, CamMessage, PredictedPath
from iptm_v2x_bridge.prediction.predictor import CREEP_M_S, LeaderTrack, Observation
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.stations.plausibility import (
    ClockOffset,
    Heard,
    contradiction,
    lies_between,
    same_measurement,
)

LATERALS = 16
"""Distances from the path of the ego vehicle kept of a station: more than a second at 10 Hz."""
HISTORY = 64
"""Messages kept of a station: six seconds at 10 Hz."""
OBSERVATIONS = 128
"""Observations kept of a station: twelve seconds at 10 Hz, for predictors."""
CONFIRMED_AFTER_MS = 300
"""A station counts once two or more messages over this time agree with each other."""
LANE_HALF_WIDTH_M = 1.5
"""A station whose middle is closer to the ego vehicle's path than this is in the ego vehicle's lane ..."""
LEFT_LANE_M = 2.5
"""... and has left it when it is farther away than this."""
ACCURACY_SHARE = 0.5
LARGEST_ALLOWANCE_M = 1.0
"""Both grow with this share of the stated position accuracy, by this much at most: a car in the next lane may
lead by mistake, one in the lane of the ego vehicle must not be lost."""
LANE_LINE_M = 1.75
"""Where the line of the lane is, half the width of a lane of a motorway (3.5 m)."""
CUT_IN_S = 1.5
"""A station with an edge over the line is in the lane if its middle will be there so soon."""
LATERAL_SPEED_OVER_S = (0.25, 1.2)
"""Lateral speeds are differences over times in this range, the longest there is."""
ALTITUDE_BOUNDS, LEVEL_TOLERANCE_M = 2.0, 1.5
"""A car is on another level beyond twice the stated 95 % bound of its altitude, because such errors last for
minutes, and an error of the heights of the road."""
LANE_VOTES = 2
"""Messages in a row that it takes to enter the lane."""
LEAVING_VOTES = 5
"""Messages in a row that it takes to leave it."""
NEAR_EGO_M = 50.0
"""A new station this close to the road around the ego vehicle is not looked for elsewhere on the road."""
MAX_HEADING_APART_DEG = 60.0
OVERLAP_MS = 1000
"""A message that is older than this when it arrives is not compared with those around its generation."""
DENSE_MS = 500
"""Between messages no farther apart than this, a station moves smoothly."""
CLOCK_LEARNING_MS = 1000
"""Time after its first message in which the clock offset of a station is learnt."""
CLOCK_TOLERANCE_MS = 50
"""Tolerance of the clock offset after that."""


class Station:
    """Follows one station from message to message.

    Attributes:
        road: the road of the ego vehicle.
        newest: newest accepted message with its times.
        message: this message itself.
        generated_ms: when it was generated, TimestampIts.
        heard_ms: when it arrived, TimestampIts of the receiver's clock; never before its generation.
        fix: its reference position as seen from the road.
        observations: accepted messages, oldest first.
        moved_s: when it was last heard moving, s of TimestampIts; when it was first heard if it never was.
        path: newest predicted path: TimestampIts of its message, the path, the rear end at its beginning.
        in_lane: whether it is in the lane of the ego vehicle.
    """

    def __init__(self, heard: Heard, road: RoadLine, near_m: float | None = None) -> None:
        self.road = road
        self.first_ms = heard.generated_ms
        self.in_lane = False
        self._learns_clock_until_ms = heard.heard_ms + CLOCK_LEARNING_MS
        self._clock_ahead_ms = 0
        self._ages_ms: deque[int] = deque(maxlen=OBSERVATIONS)
        self._messages: deque[Heard] = deque(maxlen=HISTORY)
        self.observations: deque[Observation] = deque(maxlen=OBSERVATIONS)
        self._asides: deque[tuple[float, float]] = deque(maxlen=LATERALS)
        """When (s of TimestampIts) it was how far from the path of the ego vehicle (m)."""
        self.path: tuple[int, PredictedPath, float] | None = None
        self._votes = LANE_VOTES - 1
        self._driven_heading_deg: float | None = None
        self._take(heard, near_m)

    def _take(self, heard: Heard, near_m: float | None) -> None:
        message, generated_ms = heard.message, heard.generated_ms
        self.newest, self.message, self.generated_ms = heard, message, generated_ms
        self.heard_ms = max(heard.heard_ms, generated_ms)
        age_ms = heard.heard_ms - generated_ms
        self._ages_ms.append(age_ms)
        self._messages.append(heard)
        if heard.heard_ms <= self._learns_clock_until_ms:
            self._clock_ahead_ms = max(self._clock_ahead_ms, -age_ms)
        if message.speed_m_s >= SLOW_M_S and not message.reversing:
            self._driven_heading_deg = message.heading_deg
        self.fix: RoadFix = self._project(message, near_m)
        self.observations.append(
            Observation(
                time_s=generated_ms / 1000.0,
                position_m=self.fix.position_m - message.front_to_rear_m,
                speed_m_s=0.0 if message.reversing else message.speed_m_s,
                acceleration_m_s2=message.acceleration_m_s2,
                bound_m=message.position_bound_m or 0.0,
            )
        )
        if self.last.speed_m_s > CREEP_M_S or len(self.observations) == 1:
            self.moved_s = self.last.time_s
        if message.path is not None:
            self.path = (generated_ms, message.path, self.last.position_m)
        self._vote()

    def _project(self, message: CamMessage, near_m: float | None) -> RoadFix:
        """Return the place on the road, near the expected one if the road passes there."""
        place = message.latitude_deg, message.longitude_deg
        if near_m is not None:
            fix = self.road.project(*place, near_m, heading_deg=self._driven_heading_deg)
            if self.observations or abs(fix.lateral_m) <= NEAR_EGO_M:
                return fix
        return self.road.project(*place)

    def update(self, heard: Heard) -> None:
        """Take the next accepted message."""
        self._take(heard, self.fix.position_m)

    def refusal(self, heard: Heard) -> Rejection | None:
        """Return why a message cannot be the next one of this station, None if it can.

        `DUPLICATE` and `OLDER` are repetitions that agree with it; other reasons contradict it.
        """
        elapsed_ms = heard.generated_ms - self.generated_ms
        if elapsed_ms > 0:
            reason = contradiction(self.newest, heard)
            if reason is None and self._is_ahead_of_its_clock(heard):
                return Rejection.FUTURE
            return reason
        if elapsed_ms >= -OVERLAP_MS and self._is_at_odds(heard):
            return Rejection.CONTRADICTION
        return Rejection.OLDER if elapsed_ms else Rejection.DUPLICATE

    def contradicts(self, other: Station) -> bool:
        """Return whether the newest message of another station came from another sender.

        Only known for a message with others of this station before and after it, not long ago.
        """
        elapsed_ms = self.generated_ms - other.generated_ms
        return 0 <= elapsed_ms <= 2 * OVERLAP_MS and self._is_at_odds(other.newest)

    def _is_at_odds(self, heard: Heard) -> bool:
        """Return whether a message no newer than the last one contradicts those around its time."""
        later: Heard | None = None
        earlier: Heard | None = None
        for entry in reversed(self._messages):
            if entry.generated_ms == heard.generated_ms:
                return not same_measurement(entry.message, heard.message)
            if entry.generated_ms < heard.generated_ms:
                earlier = entry
                break
            later = entry
        if later is None:
            return False
        if earlier is not None:
            if later.generated_ms - earlier.generated_ms <= DENSE_MS:
                return not lies_between(earlier, heard, later)
            # Late news from before a jump of the position agree with what was known then.
            if contradiction(earlier, heard) is None:
                return False
        return contradiction(heard, later) is not None

    def _is_ahead_of_its_clock(self, heard: Heard) -> bool:
        """Return whether a stamp lies farther ahead than the clock of this station, which was measured.

        A clock that was set, the receiver's or the sender's, is accepted after a second of silence.
        """
        now_ms = heard.heard_ms
        if now_ms <= self._learns_clock_until_ms or now_ms - self.heard_ms > CLOCK_LEARNING_MS:
            return False
        return heard.generated_ms - now_ms > self._clock_ahead_ms + CLOCK_TOLERANCE_MS

    @property
    def clock(self) -> ClockOffset:
        """What the ages of its last messages show of its clock."""
        return ClockOffset.of(self._ages_ms)

    def _vote(self) -> None:
        """Change lanes only after several consecutive messages in the new lane."""
        accuracy_m = self.message.position_bound_m or 0.0
        aside_m = abs(self.fix.lateral_m) - min(ACCURACY_SHARE * accuracy_m, LARGEST_ALLOWANCE_M)
        is_inside = aside_m < (LEFT_LANE_M if self.in_lane else LANE_HALF_WIDTH_M)
        is_inside |= not self.in_lane and self._cuts_in()
        is_inside &= not self.is_on_another_level
        self._asides.append((self.last.time_s, abs(self.fix.lateral_m)))
        if is_inside == self.in_lane:
            self._votes = 0
            return
        self._votes += 1
        if self._votes >= (LEAVING_VOTES if self.in_lane else LANE_VOTES):
            self.in_lane, self._votes = is_inside, 0

    @property
    def is_on_another_level(self) -> bool:
        """Whether its altitude contradicts the road's, as on a bridge; never where either is unknown."""
        message, road_m = self.message, self.road.height_at_m(self.fix.position_m)
        if road_m is None or message.altitude_m is None or message.altitude_bound_m is None:
            return False
        return abs(message.altitude_m - road_m) > (
            ALTITUDE_BOUNDS * message.altitude_bound_m + LEVEL_TOLERANCE_M
        )

    def _cuts_in(self) -> bool:
        """Return whether an edge is over the line of the lane, and the middle soon will be inside."""
        aside_m = abs(self.fix.lateral_m)
        if aside_m - 0.5 * (self.message.width_m or ASSUMED_WIDTH_M) >= LANE_LINE_M:
            return False
        shortest_s, longest_s = LATERAL_SPEED_OVER_S
        for time_s, before_m in self._asides:
            elapsed_s = self.last.time_s - time_s
            if shortest_s <= elapsed_s <= longest_s:
                inwards_m_s = (before_m - aside_m) / elapsed_s
                return aside_m - CUT_IN_S * inwards_m_s < LANE_HALF_WIDTH_M
        return False

    @property
    def is_confirmed(self) -> bool:
        """Whether its messages have agreed for long enough."""
        heard_for_s = self.last.time_s - self.observations[0].time_s
        return 1000.0 * heard_for_s > CONFIRMED_AFTER_MS - 0.5

    @property
    def last(self) -> Observation:
        """The newest observation."""
        return self.observations[-1]

    @property
    def drives_along(self) -> bool:
        """Whether its heading follows the road.

        Below `SLOW_M_S` the last heading while driving counts, or its own if it never drove. A station
        without any heading stands in the way.
        """
        heading_deg = self._driven_heading_deg
        if heading_deg is None:
            heading_deg = self.message.heading_deg
        if heading_deg is None:
            return True
        apart = (heading_deg - self.fix.heading_deg + 180.0) % 360.0 - 180.0
        return abs(apart) < MAX_HEADING_APART_DEG


DRIVES_OFF_M_S2 = 2.5
"""Acceleration that a vehicle may have just begun with."""
MAX_PATH_AGE_MS = 10_000
"""Age up to which the last received path is used, as not every message carries one and some are lost."""
AROUND_M, AROUND_M_S = 200.0, 100.0
"""How far from a point of a path the next one is looked for, and how much farther with the time between."""
MAX_ASIDE_M = 10.0
"""A predicted path that leaves the road by more than this ends there: the leader means to turn off."""


def leader_track(station: Station, now_s: float | None = None) -> LeaderTrack:
    """Return the observations of a station, and its predicted path as far as it stays on the road.

    Args:
        station: the station.
        now_s: s of TimestampIts; what was observed later is left out where there is anything before. None
            for the time of the last observation.
    """
    length_m = station.message.front_to_rear_m
    stood_s = station.last.time_s - station.moved_s
    observations = _allowing_for_its_clock(station)
    if now_s is not None:
        by_then = tuple(each for each in observations if each.time_s <= now_s)
        observations = by_then or observations[:1]
    age_s = 0.0 if now_s is None else max(now_s - observations[-1].time_s, 0.0)
    return LeaderTrack(observations, _road_path(station), length_m, stood_s, age_s)


def _allowing_for_its_clock(station: Station) -> tuple[Observation, ...]:
    """Return what a station sent; the way that it moves while its clock is behind widens the bounds.

    A clock that is ahead makes the station seem nearer, which needs no bound. Its times are not moved back:
    one of two senders with the same identity could place the other one farther away.
    """
    behind_s = station.clock.behind_s
    if not behind_s:
        return tuple(station.observations)
    return tuple(
        replace(each, bound_m=each.bound_m + _moved_m(each, behind_s))
        for each in station.observations
    )


def _moved_m(observed: Observation, duration_s: float) -> float:
    """Return how far a vehicle moves at most in a short time, even if it drives off."""
    faster_m_s = max(observed.acceleration_m_s2 or 0.0, DRIVES_OFF_M_S2) * duration_s
    return duration_s * (observed.speed_m_s + 0.5 * faster_m_s)


def _road_path(station: Station) -> tuple[FloatArray, FloatArray] | None:
    if station.path is None or station.generated_ms - station.path[0] > MAX_PATH_AGE_MS:
        return None
    generated_ms, path, rear_m = station.path
    length_m = station.message.front_to_rear_m
    times, places = [generated_ms / 1000.0], [rear_m]
    near_m = rear_m + length_m
    points = zip(
        path.times_s.tolist(),
        path.latitudes_deg.tolist(),
        path.longitudes_deg.tolist(),
        strict=True,
    )
    for time_s, latitude, longitude in points:
        # Most of the time goes into the road that is looked at; no leader gets farther between two points.
        elapsed_s = generated_ms / 1000.0 + time_s - times[-1]
        around_m = min(AROUND_M + AROUND_M_S * elapsed_s, NEAR_M)
        fix = station.road.project(latitude, longitude, near_m, around_m)
        if abs(fix.lateral_m) > MAX_ASIDE_M:
            break
        near_m = fix.position_m
        times.append(generated_ms / 1000.0 + time_s)
        places.append(near_m - length_m)
    return (np.array(times), np.array(places)) if len(times) > 1 else None
