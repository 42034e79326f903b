"""A second sender with the identity of the leader, whose motion it repeats until it departs from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.road_line import RoadLine
from iptm_core.state import NS_PER_S
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.sender import CamSender, car_on_road
from iptm_v2x_bridge.settings import SenderSettings

DEPARTURE_S, DRIFT_M_S = 60, 1.0
LONGEST_DRIVE_S = 1e6


@dataclass(frozen=True)
class Impostor:
    """What the second sender does.

    Attributes:
        drifts_aside: from its departure on it moves to the left, too, and not only keeps its speed.
        clock_ahead_s: how far its clock is ahead.
        delay_s: additional delay of its messages; negative: they arrive first.
    """

    departure_s: float = DEPARTURE_S
    drifts_aside: bool = False
    clock_ahead_s: float = 0.0
    delay_s: float = 0.01


CLOCKS: Mapping[str, tuple[Impostor, float]] = {
    "100 ms ahead": (Impostor(clock_ahead_s=0.1), 0.0),
    "150 ms ahead, arriving later": (Impostor(clock_ahead_s=0.15, delay_s=0.05), 0.0),
    "the same, arriving first": (Impostor(delay_s=-0.01), 0.02),
    "50 ms behind": (Impostor(clock_ahead_s=-0.05), 0.0),
}
"""Impostors by their stamps, and the delay (s) of the messages of both."""


class ContestedSender(CamSender):
    """Merges the messages of a sender and of an impostor in the order of their arrival.

    What both send at one instant agrees until the departure: it is the motion at the instant of the stamp.
    """

    def __init__(
        self,
        motion: LeaderMotion,
        road: RoadLine,
        settings: SenderSettings,
        impostor: Impostor | None,
    ) -> None:
        super().__init__(motion, road, settings)
        self._impostor = None if impostor is None else _Impostor(motion, road, settings, impostor)
        self._delay_ns = round(impostor.delay_s * NS_PER_S) if impostor else 0

    def arrivals(self, after_ns: int, until_ns: int) -> list[tuple[int, bytes]]:
        """Return what arrives in a time; see `CamSender.arrivals`."""
        found, delay_ns = super().arrivals(after_ns, until_ns), self._delay_ns
        if self._impostor is None:
            return found
        forged = self._impostor.arrivals(after_ns - delay_ns, until_ns - delay_ns)
        found += [(arrival_ns + delay_ns, datagram) for arrival_ns, datagram in forged]
        return sorted(found, key=lambda entry: entry[0])


class _Impostor(CamSender):
    def __init__(
        self, motion: LeaderMotion, road: RoadLine, settings: SenderSettings, how: Impostor
    ) -> None:
        seeded = replace(settings, sender_seed=settings.sender_seed ^ 1)
        super().__init__(_departing(motion, how.departure_s), road, seeded)
        self._how = how

    def message_at(self, time_ns: int) -> CamMessage:
        """Return the message of an instant by its own clock."""
        time_ns += round(self._how.clock_ahead_s * NS_PER_S)
        message, time_s = super().message_at(time_ns), time_ns / NS_PER_S
        left_m = DRIFT_M_S * max(time_s - self._how.departure_s, 0.0)
        if not (self._how.drifts_aside and left_m):
            return message
        place: dict[str, Any] = {"length_m": self._settings.vehicle_length_m, "left_m": left_m}
        rear_m = float(self._motion.positions_at(time_s))
        aside = car_on_road(self._road, message.station_id, 0, rear_m, message.speed_m_s, **place)
        return replace(message, latitude_deg=aside.latitude_deg, longitude_deg=aside.longitude_deg)


def _departing(motion: LeaderMotion, departure_s: float) -> LeaderMotion:
    """Return a motion that keeps its speed from an instant on."""
    known = motion.times_s < departure_s
    speed_m_s = float(motion.speeds_at(departure_s))
    end_s = departure_s + LONGEST_DRIVE_S
    return LeaderMotion(
        np.concatenate([motion.times_s[known], [departure_s, end_s, end_s + 1.0]]),
        np.concatenate([motion.speeds_m_s[known], [speed_m_s, speed_m_s, 0.0]]),
        motion.start_position_m,
    )
