"""One station as its accepted messages show it, seen from the road."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from iptm_core.routes.road_line import RoadFix, RoadLine
from iptm_v2x_bridge.messages.cam import CamMessage, PredictedPath

HISTORY = 64
"""Observations kept of a station: six seconds at 10 Hz."""
CONFIRMED_AFTER_MS = 300
"""A station counts once two or more messages over this time agree with each other."""
LANE_HALF_WIDTH_M = 1.5
"""A station whose middle is closer to the host's path than this is in the host's lane ..."""
LEFT_LANE_M = 2.5
"""... and has left it when it is farther away than this."""
LANE_VOTES = 2
"""Messages in a row that it takes to change."""
MAX_HEADING_APART_DEG = 60.0


@dataclass(frozen=True)
class Observation:
    """A station at the generation of one message.

    Attributes:
        time_s: time of generation, s of TimestampIts.
        position_m: rear end along the road.
        speed_m_s: speed along the road.
        acceleration_m_s2: acceleration, None where it is not told.
        bound_m: 95 % bound of the position as its sender states it, 0 if it does not.
    """

    time_s: float
    position_m: float
    speed_m_s: float
    acceleration_m_s2: float | None
    bound_m: float = 0.0

    def moved_on_m(self, time_s: float) -> float:
        """Return where the rear end is at another time if the speed is kept."""
        return self.position_m + self.speed_m_s * (time_s - self.time_s)


class Station:
    """Follows one station from message to message.

    Attributes:
        message: newest accepted message.
        generated_ms: when it was generated, TimestampIts.
        heard_ms: when it arrived, TimestampIts of the receiver's clock.
        fix: its reference position as seen from the road.
        observations: what the accepted messages said, oldest first.
        path: newest predicted path: TimestampIts of its message, the path, the rear end at its beginning.
        in_lane: whether it is in the lane of the host.
    """

    def __init__(
        self, message: CamMessage, generated_ms: int, road: RoadLine, heard_ms: int = 0
    ) -> None:
        self._road = road
        self.first_ms = generated_ms
        self.messages = 0
        self.in_lane = False
        self.observations: deque[Observation] = deque(maxlen=HISTORY)
        self.path: tuple[int, PredictedPath, float] | None = None
        self._votes = LANE_VOTES - 1
        self._take(message, generated_ms, heard_ms, None)

    def _take(
        self, message: CamMessage, generated_ms: int, heard_ms: int, near_m: float | None
    ) -> None:
        self.message = message
        self.generated_ms = generated_ms
        self.heard_ms = max(heard_ms, generated_ms)
        self.messages += 1
        self.fix: RoadFix = self._road.project(message.latitude_deg, message.longitude_deg, near_m)
        self.observations.append(
            Observation(
                time_s=generated_ms / 1000.0,
                position_m=self.fix.position_m - message.front_to_rear_m,
                speed_m_s=0.0 if message.reversing else message.speed_m_s,
                acceleration_m_s2=message.acceleration_m_s2,
                bound_m=message.position_bound_m or 0.0,
            )
        )
        if message.path is not None:
            self.path = (generated_ms, message.path, self.last.position_m)
        self._vote()

    def update(self, message: CamMessage, generated_ms: int, heard_ms: int = 0) -> None:
        """Take the next accepted message."""
        self._take(message, generated_ms, heard_ms, self.fix.position_m)

    def _vote(self) -> None:
        """Change lanes only after some messages in a row that say so."""
        aside_m = abs(self.fix.lateral_m)
        says_inside = aside_m < (LEFT_LANE_M if self.in_lane else LANE_HALF_WIDTH_M)
        if says_inside == self.in_lane:
            self._votes = 0
            return
        self._votes += 1
        if self._votes >= LANE_VOTES:
            self.in_lane, self._votes = says_inside, 0

    @property
    def is_confirmed(self) -> bool:
        """Whether its messages have agreed for long enough."""
        return self.messages > 1 and self.generated_ms - self.first_ms >= CONFIRMED_AFTER_MS

    @property
    def last(self) -> Observation:
        """The newest observation."""
        return self.observations[-1]

    @property
    def drives_along(self) -> bool:
        """Whether its heading is that of the road."""
        apart = (self.message.heading_deg - self.fix.heading_deg + 180.0) % 360.0 - 180.0
        return abs(apart) < MAX_HEADING_APART_DEG
