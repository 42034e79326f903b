"""Plausibility of a message: by itself, against the clock, and against the previous message of the station.

Signatures are not verified here, so a forger that moves like a car is accepted; these checks stop what no car
can do, and what an old message cannot hide.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from iptm_core.routes.road_line import step_m
from iptm_v2x_bridge.messages.cam import SLOW_M_S, CamMessage
from iptm_v2x_bridge.messages.packets import (
    DELTA_MODULUS_MS,
    TIMESTAMP_MODULUS_MS,
    resolve_delta_ms,
)
from iptm_v2x_bridge.rejections import Rejection

MAX_AGE_MS = 3000
"""Age beyond which messages are discarded."""
LARGEST_OFFSET_MS = 500
"""Largest offset of a sender's clock that is allowed for: clocks set by satellites are closer by far."""
MAX_TIMES_APART_MS = 2000
"""Between the positions of the packet and of the message."""
MAX_SPEED_M_S = 70.0
MAX_ACCELERATION_M_S2 = 12.0
MAX_LATERAL_SPEED_M_S = 3.0
MAX_TURN_DEG_S = 60.0

MAX_COUNTED_BOUND_M = 5.0
"""A sender that states a larger error of its position must not move more freely from message to message."""
POSITION_TOLERANCE_M = 2.5
SPEED_TOLERANCE_M_S = 1.0
LATERAL_TOLERANCE_M = 0.75
TURN_TOLERANCE_DEG = 15.0
SAME_POSITION_M = 0.5
SAME_SPEED_M_S = 0.1
"""Two messages of one sender with the same time of generation differ by their rounding at most."""


@dataclass(frozen=True)
class Heard:
    """A message with its times, TimestampIts.

    Attributes:
        message: the message.
        generated_ms: when it was generated.
        heard_ms: when it arrived, by the receiver's clock.
    """

    message: CamMessage
    generated_ms: int
    heard_ms: int = 0

    def since_s(self, earlier: Heard) -> float:
        """Return the time between the generation of another message and of this one."""
        return (self.generated_ms - earlier.generated_ms) / 1000.0


def dated(message: CamMessage, packet_timestamp_ms: int | None, now_ms: int) -> Heard | Rejection:
    """Return a message with the time of its generation, or the reason for its refusal."""
    generated_ms = resolve_delta_ms(message.delta_time_ms, now_ms, DELTA_MODULUS_MS // 2)
    if packet_timestamp_ms is not None:
        apart = (packet_timestamp_ms - generated_ms) % TIMESTAMP_MODULUS_MS
        if min(apart, TIMESTAMP_MODULUS_MS - apart) > MAX_TIMES_APART_MS:
            return Rejection.TIMESTAMPS
    if generated_ms > now_ms + LARGEST_OFFSET_MS:
        return Rejection.FUTURE
    if generated_ms < now_ms - MAX_AGE_MS:
        return Rejection.STALE
    return Heard(message, generated_ms, now_ms)


def absurd(message: CamMessage) -> bool:
    """Return whether no road vehicle moves like that."""
    acceleration_m_s2 = message.acceleration_m_s2 or 0.0
    return message.speed_m_s > MAX_SPEED_M_S or abs(acceleration_m_s2) > MAX_ACCELERATION_M_S2


def contradiction(earlier: Heard, later: Heard) -> Rejection | None:
    """Return why one message cannot follow another one of the same station, None if it can."""
    before, after, elapsed_s = earlier.message, later.message, later.since_s(earlier)
    change_m_s = abs(after.speed_m_s - before.speed_m_s)
    if change_m_s > MAX_ACCELERATION_M_S2 * elapsed_s + SPEED_TOLERANCE_M_S:
        return Rejection.SPEED_JUMP
    east, north = step_m(
        after.latitude_deg, after.longitude_deg, (before.latitude_deg, before.longitude_deg)
    )
    moved_m = math.hypot(east, north)
    bounds_m = POSITION_TOLERANCE_M + min(before.position_bound_m or 0.0, MAX_COUNTED_BOUND_M)
    bounds_m += min(after.position_bound_m or 0.0, MAX_COUNTED_BOUND_M)
    farthest_m = max(before.speed_m_s, after.speed_m_s) * elapsed_s
    farthest_m += 0.5 * MAX_ACCELERATION_M_S2 * elapsed_s**2 + bounds_m
    if moved_m > farthest_m:
        return Rejection.POSITION_JUMP
    if after.heading_deg is None or before.heading_deg is None:
        return None
    turned_deg = abs((after.heading_deg - before.heading_deg + 180.0) % 360.0 - 180.0)
    fast = min(before.speed_m_s, after.speed_m_s) > SLOW_M_S
    if fast and turned_deg > MAX_TURN_DEG_S * elapsed_s + TURN_TOLERANCE_DEG:
        return Rejection.HEADING_JUMP
    # Seen from the heading in the middle of the turn, a car moves sideways no faster than it steers.
    half_turn = 0.5 * ((after.heading_deg - before.heading_deg + 180.0) % 360.0 - 180.0)
    heading = math.radians(before.heading_deg + half_turn)
    aside_m = abs(east * math.cos(heading) - north * math.sin(heading))
    allowed_m = MAX_LATERAL_SPEED_M_S * elapsed_s + LATERAL_TOLERANCE_M
    allowed_m += bounds_m - POSITION_TOLERANCE_M
    # The chord of a bend leaves the mean heading by a small part of the way.
    allowed_m += moved_m * math.sin(math.radians(min(turned_deg, 90.0)) / 4.0)
    return Rejection.LATERAL_JUMP if aside_m > allowed_m and moved_m > bounds_m / 2.0 else None


def same_measurement(one: CamMessage, other: CamMessage) -> bool:
    """Return whether two messages with the same time of generation can come from one sender."""
    east, north = step_m(
        other.latitude_deg, other.longitude_deg, (one.latitude_deg, one.longitude_deg)
    )
    return (
        math.hypot(east, north) <= SAME_POSITION_M
        and abs(other.speed_m_s - one.speed_m_s) <= SAME_SPEED_M_S
        and (one.path is None or other.path is None or one.path == other.path)
    )


def lies_between(earlier: Heard, middle: Heard, later: Heard) -> bool:
    """Return whether a message agrees with those shortly before and after it.

    The error of a position, however large, is the same for all three of them.
    """
    before, message, after = earlier.message, middle.message, later.message
    elapsed_s, remaining_s = middle.since_s(earlier), later.since_s(middle)
    share = elapsed_s / (elapsed_s + remaining_s)
    place = (
        before.latitude_deg + share * (after.latitude_deg - before.latitude_deg),
        before.longitude_deg + share * (after.longitude_deg - before.longitude_deg),
    )
    east, north = step_m(message.latitude_deg, message.longitude_deg, place)
    # The hardest acceleration leaves the chord by half of this; half of it may begin or end in between.
    bend_m = MAX_ACCELERATION_M_S2 * elapsed_s * remaining_s
    if math.hypot(east, north) > POSITION_TOLERANCE_M + 0.5 * bend_m:
        return False
    speed_m_s = before.speed_m_s + share * (after.speed_m_s - before.speed_m_s)
    tolerance_m_s = SPEED_TOLERANCE_M_S + bend_m / (elapsed_s + remaining_s)
    return abs(message.speed_m_s - speed_m_s) <= tolerance_m_s


def deviation(earlier: Heard, later: Heard) -> float:
    """Return by how much a message deviates from constant speed since another one, m plus m/s.

    Either may be the older one.
    """
    before, after = earlier.message, later.message
    east, north = step_m(
        after.latitude_deg, after.longitude_deg, (before.latitude_deg, before.longitude_deg)
    )
    elapsed_ms = later.generated_ms - earlier.generated_ms
    distance_m = 0.5 * (before.speed_m_s + after.speed_m_s) * elapsed_ms / 1000.0
    heading = math.radians(before.heading_deg or 0.0)  # without one it hardly moves
    aside_m = math.hypot(
        east - distance_m * math.sin(heading), north - distance_m * math.cos(heading)
    )
    return aside_m + abs(after.speed_m_s - before.speed_m_s)


@dataclass(frozen=True)
class ClockOffset:
    """Of the clock of a sender, in s; at most one of both is not 0.

    No message arrives before it was sent: a smallest age below zero proves that the clock is ahead by as
    much, at least. One above zero is the delay of the fastest message and what the clock is behind.

    Attributes:
        ahead_s: by how much it is ahead at least.
        behind_s: by how much it may be behind.
    """

    ahead_s: float = 0.0
    behind_s: float = 0.0

    @classmethod
    def of(cls, ages_ms: Iterable[int]) -> ClockOffset:
        """Return what the ages of messages show; there is at least one."""
        age_s = 1e-3 * min(max(min(ages_ms), -LARGEST_OFFSET_MS), LARGEST_OFFSET_MS)
        return cls(max(-age_s, 0.0), max(age_s, 0.0))
