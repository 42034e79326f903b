"""A leader's drive as datagrams, in the order of their arrival.

Every random number depends only on the seed and the number of the message, so a run repeats exactly, however
it is cut into ticks.
"""

from __future__ import annotations

import numpy as np

from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.road_line import RoadLine, step_m
from iptm_core.state import NS_PER_MS, NS_PER_S
from iptm_v2x_bridge.messages.cam import (
    ASSUMED_LENGTH_M,
    PASSENGER_CAR,
    CamMessage,
    PredictedPath,
)
from iptm_v2x_bridge.messages.cam_codec import encode_cam
from iptm_v2x_bridge.messages.geonetworking import SenderPosition, wrap
from iptm_v2x_bridge.messages.its_time import delta_time_ms
from iptm_v2x_bridge.sending.settings import Foresight, Framing, SenderSettings, path_times_s

BEFORE_START_S = 3.0
"""Time before the trip for which the standing leader sends messages."""
POSITION_BOUND_M = 0.02
"""Position bound of a sender with an exact position: the resolution of the wire."""

_ACCELERATION_WINDOW_S = 0.2
HIGHEST_ACCELERATION_M_S2 = 16.0
"""Range of accelerations on the wire."""


def car_on_road(
    road: RoadLine,
    station_id: int,
    timestamp_ms: int,
    rear_m: float,
    speed_m_s: float,
    *,
    acceleration_m_s2: float = 0.0,
    length_m: float = ASSUMED_LENGTH_M,
    left_m: float = 0.0,
    position_bound_m: float = POSITION_BOUND_M,
    path: PredictedPath | None = None,
) -> CamMessage:
    """Return the message of a car that drives along a road.

    Args:
        road: the road.
        station_id: identity of the car.
        timestamp_ms: TimestampIts of the generation.
        rear_m: rear end along the road.
        speed_m_s: speed.
        acceleration_m_s2: acceleration, cut to the range of the standard.
        length_m: length of the car.
        left_m: how far it is to the left of the middle.
        position_bound_m: 95 % bound of its position that it states.
        path: its predicted path.
    """
    latitude, longitude, heading = (float(value) for value in road.locate(rear_m + length_m))
    if left_m:
        heading_rad = np.radians(heading)
        east, north = step_m(latitude + 1e-5, longitude + 1e-5, (latitude, longitude))
        latitude += left_m * float(np.sin(heading_rad)) * 1e-5 / north
        longitude -= left_m * float(np.cos(heading_rad)) * 1e-5 / east
    return CamMessage(
        station_id=station_id,
        delta_time_ms=delta_time_ms(timestamp_ms),
        latitude_deg=latitude,
        longitude_deg=longitude,
        heading_deg=heading,
        speed_m_s=speed_m_s,
        acceleration_m_s2=max(
            min(acceleration_m_s2, HIGHEST_ACCELERATION_M_S2), -HIGHEST_ACCELERATION_M_S2
        ),
        length_m=length_m,
        width_m=1.8,
        position_bound_m=position_bound_m,
        path=path,
    )


def packet_of(message: CamMessage, timestamp_ms: int) -> bytes:
    """Return the packet of a message on the air; `timestamp_ms` is the TimestampIts of its generation."""
    position = SenderPosition(
        timestamp_ms=timestamp_ms,
        latitude=round(message.latitude_deg * 1e7),
        longitude=round(message.longitude_deg * 1e7),
        speed_cm_s=round(message.speed_m_s * 100.0),
        heading=round((message.heading_deg or 0.0) * 10.0) % 3600,
    )
    return wrap(encode_cam(message), position, message.station_id, PASSENGER_CAR)


class CamSender:
    """Sends a drive message by message."""

    def __init__(
        self,
        motion: LeaderMotion,
        road: RoadLine,
        settings: SenderSettings,
        start_timestamp_ms: int = 0,
    ) -> None:
        """Set up a sender.

        Args:
            motion: rear bumper of the leader over trip time.
            road: where it drives.
            settings: what is sent.
            start_timestamp_ms: TimestampIts at trip time 0.
        """
        self._motion, self._road, self._settings = motion, road, settings
        self._start_ms = start_timestamp_ms
        self._period_ns = max(round(NS_PER_S / settings.rate_hz / NS_PER_MS), 1) * NS_PER_MS
        self._first = -round(BEFORE_START_S * NS_PER_S) // self._period_ns

    def message_at(self, time_ns: int) -> CamMessage:
        """Return the message of an instant (whole milliseconds of trip time, in ns)."""
        time_s, settings = time_ns / NS_PER_S, self._settings
        around = time_s + np.array([-_ACCELERATION_WINDOW_S, 0.0])
        speed_before, speed = self._motion.speeds_at(around).tolist()
        return car_on_road(
            self._road,
            settings.station_id,
            self._start_ms + time_ns // NS_PER_MS,
            float(self._motion.positions_at(time_s)),
            speed,
            acceleration_m_s2=(speed - speed_before) / _ACCELERATION_WINDOW_S,
            length_m=settings.vehicle_length_m,
            left_m=self._left_m(time_s),
            position_bound_m=settings.position_accuracy_m,
            path=self._path(time_s) if self._tells_path(time_ns) else None,
        )

    def _left_m(self, time_s: float) -> float:  # noqa: ARG002
        """Return how far the car is to the left of the middle of its lane."""
        return 0.0

    def _tells_path(self, time_ns: int) -> bool:
        """Return whether this message carries a path: the first one of each period does."""
        if self._settings.foresight is Foresight.NONE:
            return False
        period_ns = max(round(self._settings.path_period_s * NS_PER_S), self._period_ns)
        return time_ns % period_ns < self._period_ns

    def _path(self, time_s: float) -> PredictedPath | None:
        settings = self._settings
        ahead = path_times_s(settings.path_points, settings.path_length_s)
        fronts = self._motion.positions_at(time_s + ahead) + settings.vehicle_length_m
        latitudes, longitudes, _ = self._road.locate(fronts)
        return PredictedPath(ahead, latitudes, longitudes, confidence=0.95)

    def datagram_at(self, time_ns: int) -> bytes:
        """Return the datagram of an instant."""
        message = self.message_at(time_ns)
        if self._settings.framing is Framing.BARE:
            return encode_cam(message)
        return packet_of(message, self._start_ms + time_ns // NS_PER_MS)

    def arrivals(self, after_ns: int, until_ns: int) -> list[tuple[int, bytes]]:
        """Return what arrives in a span of trip time, with the instants, in order.

        Args:
            after_ns: the span begins after this instant; negative for all that came before the trip.
            until_ns: the span ends with this instant.
        """
        settings = self._settings
        longest_s = settings.link_delay_s + 40.0 * settings.link_jitter_s
        oldest = (after_ns - round(longest_s * NS_PER_S)) // self._period_ns
        found = []
        for number in range(max(oldest, self._first), until_ns // self._period_ns + 1):
            generated_ns = number * self._period_ns
            arrival_ns = self._arrival_ns(number, generated_ns)
            if arrival_ns is not None and after_ns < arrival_ns <= until_ns:
                found.append((arrival_ns, generated_ns))
        found.sort()
        return [(arrival_ns, self.datagram_at(generated_ns)) for arrival_ns, generated_ns in found]

    def departures(self, after_ns: int, until_ns: int) -> list[tuple[int, bytes]]:
        """Return what is generated in a span of trip time and not lost, with the instants of its arrival."""
        found = []
        for number in range(after_ns // self._period_ns + 1, until_ns // self._period_ns + 1):
            generated_ns = number * self._period_ns
            arrival_ns = self._arrival_ns(number, generated_ns)
            if arrival_ns is not None:
                found.append((arrival_ns, self.datagram_at(generated_ns)))
        return found

    def _arrival_ns(self, number: int, generated_ns: int) -> int | None:
        """Return when a message arrives, None if it is lost."""
        settings = self._settings
        delay_s = settings.link_delay_s
        if settings.loss_probability > 0.0 or settings.link_jitter_s > 0.0:
            draws = np.random.Generator(
                np.random.Philox(key=settings.sender_seed, counter=(number + 2**32) << 64)
            )
            if draws.random() < settings.loss_probability:
                return None
            # Forty means and more happen once in 10^17 messages.
            delay_s += min(draws.exponential(), 40.0) * settings.link_jitter_s
        return generated_ns + round(delay_s * NS_PER_S)
