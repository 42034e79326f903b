"""Table of recently received stations; rejected messages are counted by reason."""

from __future__ import annotations

from iptm_core.routes.road_line import RoadLine
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.rejections import Rejection, RejectionCounts
from iptm_v2x_bridge.stations.identity import Identity
from iptm_v2x_bridge.stations.plausibility import absurd, generation_time_ms
from iptm_v2x_bridge.stations.station import Station

MAX_CONFIRMED = 512
MAX_NEWCOMERS = 4096
"""Stations held at most, confirmed and not yet confirmed: a flood of identities pushes out its own kind."""


class StationTable:
    """Holds stations by identity; see `Identity` for two senders with the same one."""

    def __init__(self, road: RoadLine) -> None:
        self._road = road
        self._confirmed: dict[int, Identity] = {}
        self._newcomers: dict[int, Identity] = {}
        self.accepted = 0
        self.rejections = RejectionCounts()

    @property
    def confirmed(self) -> tuple[Station, ...]:
        """Stations whose messages have agreed for long enough."""
        return tuple(
            station
            for identity in self._confirmed.values()
            for station in identity.hypotheses
            if station.is_confirmed
        )

    @property
    def contested_since_ms(self) -> dict[int, int]:
        """Confirmed identities that more than one station sends with, and since when (TimestampIts)."""
        return {
            station_id: identity.contested_since_ms
            for station_id, identity in self._confirmed.items()
            if identity.contested_since_ms is not None
        }

    def __len__(self) -> int:
        """Return the number of stations held, newcomers included."""
        return len(self._confirmed) + len(self._newcomers)

    def hypotheses(self, station_id: int) -> tuple[Station, ...]:
        """Return the confirmed stations with an identity: none, one, or more if it is contested."""
        identity = self._confirmed.get(station_id)
        stations = identity.hypotheses if identity else ()
        return tuple(station for station in stations if station.is_confirmed)

    def receive(
        self,
        message: CamMessage,
        packet_timestamp_ms: int | None,
        now_ms: int,
        host_position_m: float = 0.0,
    ) -> Rejection | None:
        """Take a message in; return why not, None if it was accepted."""
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
        station_id = message.station_id
        identity = self._confirmed.get(station_id) or self._newcomers.get(station_id)
        if identity is None or not identity.forget_silent(now_ms):
            self._confirmed.pop(station_id, None)
            self._newcomers.pop(station_id, None)
            station = Station(message, generated_ms, self._road, now_ms, host_position_m)
            self._admit(station_id, Identity(station))
            return None
        refused = identity.receive(message, generated_ms, now_ms, self._road, host_position_m)
        if refused is None and station_id in self._newcomers and identity.is_confirmed:
            del self._newcomers[station_id]
            self._confirm(station_id, identity, host_position_m)
        return refused

    def _admit(self, station_id: int, identity: Identity) -> None:
        if len(self._newcomers) >= MAX_NEWCOMERS:
            del self._newcomers[next(iter(self._newcomers))]
            self.rejections.add(Rejection.TABLE_FULL)
        self._newcomers[station_id] = identity

    def _confirm(self, station_id: int, identity: Identity, host_position_m: float) -> None:
        self._confirmed[station_id] = identity
        if len(self._confirmed) > MAX_CONFIRMED:
            farthest = max(
                self._confirmed.items(),
                key=lambda entry: min(
                    abs(station.fix.position_m - host_position_m) + abs(station.fix.lateral_m)
                    for station in entry[1].hypotheses
                ),
            )
            del self._confirmed[farthest[0]]
            self.rejections.add(Rejection.TABLE_FULL)

    def forget_silent(self, now_ms: int) -> None:
        """Forget stations that have been silent for too long."""
        for identities in (self._confirmed, self._newcomers):
            silent = [
                station_id
                for station_id, identity in identities.items()
                if not identity.forget_silent(now_ms)
            ]
            for station_id in silent:
                del identities[station_id]
