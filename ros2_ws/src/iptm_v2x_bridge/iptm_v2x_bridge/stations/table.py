"""The stations heard lately. Whatever arrives is believed, or counted with the reason why not."""

from __future__ import annotations

from iptm_core.routes.road_line import RoadLine
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.rejections import Rejection, RejectionCounts
from iptm_v2x_bridge.stations.plausibility import absurd, contradiction, generation_time_ms
from iptm_v2x_bridge.stations.station import Station

STATION_TIMEOUT_MS = 5000
"""A station is forgotten when nothing plausible has come from it for as long."""
MAX_CONFIRMED = 512
MAX_NEWCOMERS = 4096
"""Stations held at most, confirmed and not yet confirmed: a flood of identities pushes out its own kind."""


class StationTable:
    """Holds stations by identity.

    A message that contradicts its station's last one is dropped, and the station stays what it was: of two
    senders with one identity the first one is followed until it falls silent.
    """

    def __init__(self, road: RoadLine) -> None:
        self._road = road
        self._confirmed: dict[int, Station] = {}
        self._newcomers: dict[int, Station] = {}
        self.accepted = 0
        self.rejections = RejectionCounts()

    @property
    def confirmed(self) -> tuple[Station, ...]:
        """Stations whose messages have agreed for long enough."""
        return tuple(self._confirmed.values())

    def __len__(self) -> int:
        """Return the number of stations held, newcomers included."""
        return len(self._confirmed) + len(self._newcomers)

    def find(self, station_id: int) -> Station | None:
        """Return a confirmed station."""
        return self._confirmed.get(station_id)

    def receive(
        self,
        message: CamMessage,
        packet_timestamp_ms: int | None,
        now_ms: int,
        host_position_m: float = 0.0,
    ) -> Rejection | None:
        """Take a message in; return why not, None if it was accepted.

        Args:
            message: the message.
            packet_timestamp_ms: TimestampIts of its packet modulo 2^32, None without one.
            now_ms: TimestampIts of the receiver's clock.
            host_position_m: where the host is; the farthest station gives way when there are too many.
        """
        reason = self._judge(message, packet_timestamp_ms, now_ms, host_position_m)
        if reason is None:
            self.accepted += 1
        else:
            self.rejections.add(reason)
        return reason

    def _judge(
        self,
        message: CamMessage,
        packet_timestamp_ms: int | None,
        now_ms: int,
        host_position_m: float,
    ) -> Rejection | None:
        if absurd(message):
            return Rejection.ABSURD
        generated_ms = generation_time_ms(message, packet_timestamp_ms, now_ms)
        if isinstance(generated_ms, Rejection):
            return generated_ms
        identity = message.station_id
        station = self._confirmed.get(identity) or self._newcomers.get(identity)
        if station is None or now_ms - station.generated_ms > STATION_TIMEOUT_MS:
            self._confirmed.pop(identity, None)
            self._newcomers.pop(identity, None)
            self._admit(Station(message, generated_ms, self._road, now_ms))
            return None
        if generated_ms <= station.generated_ms:
            equal = generated_ms == station.generated_ms
            return Rejection.DUPLICATE if equal else Rejection.OLDER
        elapsed_s = (generated_ms - station.generated_ms) / 1000.0
        reason = contradiction(station.message, message, elapsed_s)
        if reason is not None:
            return reason
        station.update(message, generated_ms, now_ms)
        if station.is_confirmed and identity in self._newcomers:
            del self._newcomers[identity]
            self._confirm(station, host_position_m)
        return None

    def _admit(self, station: Station) -> None:
        if len(self._newcomers) >= MAX_NEWCOMERS:
            del self._newcomers[next(iter(self._newcomers))]
            self.rejections.add(Rejection.TABLE_FULL)
        self._newcomers[station.message.station_id] = station

    def _confirm(self, station: Station, host_position_m: float) -> None:
        self._confirmed[station.message.station_id] = station
        if len(self._confirmed) > MAX_CONFIRMED:
            farthest = max(
                self._confirmed.items(),
                key=lambda entry: (
                    abs(entry[1].fix.position_m - host_position_m) + abs(entry[1].fix.lateral_m)
                ),
            )
            del self._confirmed[farthest[0]]
            self.rejections.add(Rejection.TABLE_FULL)

    def forget_silent(self, now_ms: int) -> None:
        """Forget stations that have been silent for too long."""
        for stations in (self._confirmed, self._newcomers):
            silent = [
                identity
                for identity, station in stations.items()
                if now_ms - station.generated_ms > STATION_TIMEOUT_MS
            ]
            for identity in silent:
                del stations[identity]
