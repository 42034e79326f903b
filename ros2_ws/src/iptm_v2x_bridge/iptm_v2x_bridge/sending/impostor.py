"""A second sender with the identity of the first: the test signal for contested identities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.road_line import RoadLine
from iptm_core.state import NS_PER_MS, NS_PER_S
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.sending.sender import CamSender
from iptm_v2x_bridge.sending.settings import Impostor, SenderSettings

LATERAL_SPEED_M_S = 1.0
LONGEST_DRIVE_S = 1e6


class ContestedSender(CamSender):
    """Merges the messages of a sender and of its impostor in the order of their arrival."""

    def __init__(
        self,
        motion: LeaderMotion,
        road: RoadLine,
        settings: SenderSettings,
        start_timestamp_ms: int = 0,
    ) -> None:
        """Set up both senders; see `CamSender`."""
        super().__init__(motion, road, settings, start_timestamp_ms)
        self._impostor = _ImpostorSender(motion, road, settings, start_timestamp_ms)
        self._delay_ns = round(settings.impostor_delay_s * NS_PER_S)

    def arrivals(self, after_ns: int, until_ns: int) -> list[tuple[int, bytes]]:
        """Return the datagrams of both senders; see `CamSender.arrivals`."""
        delay_ns = self._delay_ns
        forged = self._impostor.arrivals(after_ns - delay_ns, until_ns - delay_ns)
        found = super().arrivals(after_ns, until_ns)
        found += [(arrival_ns + delay_ns, datagram) for arrival_ns, datagram in forged]
        return sorted(found, key=lambda entry: entry[0])


class _ImpostorSender(CamSender):
    """Repeats the motion of the leader until it departs from it; its stamps come from a clock of its own."""

    def __init__(
        self,
        motion: LeaderMotion,
        road: RoadLine,
        settings: SenderSettings,
        start_timestamp_ms: int,
    ) -> None:
        self._departure_s = settings.impostor_departure_s
        self._aside = settings.impostor is Impostor.DRIFTS_ASIDE
        self._ahead_ms = round(settings.impostor_clock_ahead_s * NS_PER_S) // NS_PER_MS
        super().__init__(
            _departing(motion, self._departure_s),
            road,
            replace(settings, sender_seed=settings.sender_seed ^ 1),
            start_timestamp_ms,
        )

    def message_at(self, time_ns: int) -> CamMessage:
        # What is sent at one instant is the motion at the instant of the stamp, so that both senders agree.
        return super().message_at(time_ns + self._ahead_ms * NS_PER_MS)

    def _left_m(self, time_s: float) -> float:
        return LATERAL_SPEED_M_S * max(time_s - self._departure_s, 0.0) if self._aside else 0.0


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


def build_sender(
    motion: LeaderMotion, road: RoadLine, settings: SenderSettings, start_timestamp_ms: int = 0
) -> CamSender:
    """Return the sender of a drive, with its impostor where the settings ask for one; see `CamSender`."""
    kind = CamSender if settings.impostor is Impostor.NONE else ContestedSender
    return kind(motion, road, settings, start_timestamp_ms)
