"""The other end of the link: a drive, known or in progress, as the datagrams of its car.

Every random number depends only on the seed and the number of the message, so a run repeats exactly, however
it is cut into ticks.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from iptm_core.routes.cycles import FINAL_BRAKING_M_S2, LeaderMotion, cumulative_integral
from iptm_core.routes.road_line import RoadLine, step_m
from iptm_core.state import NS_PER_MS, NS_PER_S, FloatArray
from iptm_v2x_bridge.messages.cam import (
    ASSUMED_LENGTH_M,
    PASSENGER_CAR,
    CamMessage,
    PredictedPath,
    encode_cam,
)
from iptm_v2x_bridge.messages.packets import delta_time_ms, wrap
from iptm_v2x_bridge.settings import Foresight, Framing, SenderSettings, path_times_s

BEFORE_START_S = 3.0
"""Time before the trip for which the standing leader sends messages."""
POSITION_BOUND_M = 0.02
"""Position bound of a sender with an exact position: the resolution of the wire."""

LONG_BEFORE_NS = 10**12
"""Negative, the trip time from which everything has been sent."""
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
    """Return the message of a car on a road, its rear end at `rear_m`, `left_m` to the left of the middle."""
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
    return wrap(
        encode_cam(message),
        message.station_id,
        PASSENGER_CAR,
        timestamp_ms,
        (message.latitude_deg, message.longitude_deg),
        message.speed_m_s,
        message.heading_deg or 0.0,
    )


class CamSender:
    """Sends a drive message by message."""

    def __init__(
        self,
        motion: LeaderMotion,
        road: RoadLine,
        settings: SenderSettings,
        start_timestamp_ms: int = 0,
        *,
        plan: tuple[int, float] | None = None,
    ) -> None:
        """Set up a sender.

        Args:
            motion: rear bumper over trip time.
            road: where it drives.
            settings: of the messages.
            start_timestamp_ms: TimestampIts at trip time 0.
            plan: tick (ns) whose message alone carries a path, and end (s) of that; None for the settings.
        """
        self._motion, self._road, self._settings = motion, road, settings
        self._start_ms, self._plan = start_timestamp_ms, plan
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
            position_bound_m=settings.position_accuracy_m,
            path=self._path(time_ns),
        )

    def _path(self, time_ns: int) -> PredictedPath | None:
        """Return the path in a message: the first one of each period, or of the plan, carries one."""
        settings, time_s = self._settings, time_ns / NS_PER_S
        period_ns = max(round(settings.path_period_s * NS_PER_S), self._period_ns)
        is_due = time_ns % period_ns < self._period_ns
        ahead = path_times_s(settings.path_points, settings.path_length_s)
        if self._plan is not None:
            is_due = time_ns == self._plan[0]
            ahead = ahead[ahead <= self._plan[1] - time_s + 1e-9]
        if settings.foresight is Foresight.NONE or not is_due or not ahead.size:
            return None
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
        """Return what arrives after one trip time and up to another, with the instants, in order.

        `after_ns` is negative for all that came before the trip.
        """
        settings = self._settings
        longest_s = settings.link_delay_s + 40.0 * settings.link_jitter_s
        oldest = (after_ns - round(longest_s * NS_PER_S)) // self._period_ns
        sent = self._sent(max(oldest, self._first), until_ns)
        found = sorted(entry for entry in sent if after_ns < entry[0] <= until_ns)
        return [(arrival_ns, self.datagram_at(generated_ns)) for arrival_ns, generated_ns in found]

    def take(self, after_ns: int | None, until_ns: int) -> tuple[list[tuple[int, bytes]], int]:
        """Return what arrives in a time as received at the end of it, as in lock-step over a socket.

        None for all before; see `DatagramSource.take`.
        """
        arrivals = self.arrivals(-LONG_BEFORE_NS if after_ns is None else after_ns, until_ns)
        return [(until_ns, datagram) for _, datagram in arrivals], 0

    def departures(self, after_ns: int, until_ns: int) -> list[tuple[int, bytes]]:
        """Return the messages of a span of trip time that are not lost, with the instants of its arrival."""
        sent = self._sent(after_ns // self._period_ns + 1, until_ns)
        return [(arrival_ns, self.datagram_at(generated_ns)) for arrival_ns, generated_ns in sent]

    def _sent(self, first: int, until_ns: int) -> Iterator[tuple[int, int]]:
        """Yield instants of arrival and generation of the messages that are not lost."""
        settings = self._settings
        for number in range(first, until_ns // self._period_ns + 1):
            delay_s = settings.link_delay_s
            if settings.loss_probability > 0.0 or settings.link_jitter_s > 0.0:
                draws = np.random.Generator(
                    np.random.Philox(key=settings.sender_seed, counter=(number + 2**32) << 64)
                )
                if draws.random() < settings.loss_probability:
                    continue
                # Forty means and more happen once in 10^17 messages.
                delay_s += min(draws.exponential(), 40.0) * settings.link_jitter_s
            generated_ns = number * self._period_ns
            yield generated_ns + round(delay_s * NS_PER_S), generated_ns


MAX_TICK_S = 10.0
"""Longest interval between two ticks over which the motion is sent."""


@dataclass(frozen=True, eq=False)
class EgoTick:
    """State and plan of a car at a tick.

    Attributes:
        time_ns: the tick, integer nanoseconds of trip time.
        position_m: its front along its own road.
        speed_m_s: its speed.
        plan_times_s: nodes of its plan, trip times, shape (n,), increasing; empty without a plan.
        plan_speeds_m_s: speeds there, shape (n,), linear in between.
    """

    time_ns: int
    position_m: float
    speed_m_s: float
    plan_times_s: FloatArray
    plan_speeds_m_s: FloatArray


class PlanSender:
    """Sends the messages of a drive in progress.

    The message of a tick carries the plan made at it; messages since the tick before carry none.
    """

    def __init__(
        self,
        road: RoadLine,
        settings: SenderSettings,
        ahead_m: float,
        start_timestamp_ms: int = 0,
    ) -> None:
        """Set up a sender.

        Args:
            road: where it drives.
            settings: of the messages.
            ahead_m: where its rear bumper is on this road when its own position is 0.
            start_timestamp_ms: TimestampIts at trip time 0.
        """
        self._road, self._settings, self._ahead_m = road, settings, ahead_m
        self._start_ms = start_timestamp_ms
        self._past: deque[EgoTick] = deque(maxlen=3)
        self._under_way: list[tuple[int, bytes]] = []

    def arrivals(self, tick: EgoTick) -> list[bytes]:
        """Return what arrives up to a tick and was not returned before."""
        last = self._past[-1] if self._past else None
        if last is None or tick.time_ns - last.time_ns > MAX_TICK_S * NS_PER_S:
            self._past.clear()
            # Of a car that drives already nothing is known before; one that stands, stood there.
            stood_s = BEFORE_START_S if tick.speed_m_s == 0.0 else 0.0
            after_ns = tick.time_ns - max(round(stood_s * NS_PER_S), 1)
        else:
            after_ns = last.time_ns
        self._past.append(tick)
        plan_end_s = float(tick.plan_times_s[-1]) if tick.plan_times_s.size else -math.inf
        sender = CamSender(
            self._motion(),
            self._road,
            self._settings,
            self._start_ms,
            plan=(tick.time_ns, plan_end_s),
        )
        self._under_way += sender.departures(after_ns, tick.time_ns)
        self._under_way.sort(key=lambda entry: entry[0])
        arrived = [datagram for at_ns, datagram in self._under_way if at_ns <= tick.time_ns]
        del self._under_way[: len(arrived)]
        return arrived

    def _motion(self) -> LeaderMotion:
        """Return the motion from some ticks before to the end of the plan, and a halt after it."""
        tick = self._past[-1]
        past_s = np.array([known.time_ns / NS_PER_S for known in self._past])
        past_m_s = np.array([known.speed_m_s for known in self._past])
        # A second before the first of them as it is there: no acceleration is known.
        past_s, past_m_s = (
            np.insert(past_s, 0, past_s[0] - 1.0),
            np.insert(past_m_s, 0, past_m_s[0]),
        )
        ahead = tick.plan_times_s > past_s[-1] + 1e-6
        times = np.concatenate([past_s, tick.plan_times_s[ahead]])
        speeds = np.concatenate([past_m_s, np.maximum(tick.plan_speeds_m_s[ahead], 0.0)])
        halt_s = times[-1] + max(speeds[-1] / FINAL_BRAKING_M_S2, 1e-3)
        distance_m = float(cumulative_integral(past_s, past_m_s)[-1])
        return LeaderMotion(
            np.append(times, halt_s),
            np.append(speeds, 0.0),
            self._ahead_m + tick.position_m - distance_m,
        )
