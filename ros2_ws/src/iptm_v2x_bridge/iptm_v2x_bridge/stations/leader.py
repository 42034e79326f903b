"""Which station is the leader: the nearest one ahead on the host's own path."""

from __future__ import annotations

from collections.abc import Iterable

from iptm_v2x_bridge.stations.station import Station

MAX_DISTANCE_M = 1000.0
"""Stations beyond this distance are not leader candidates."""
BEHIND_M = 2.0
"""Distance of a rear end behind the host's front up to which it counts as ahead: accuracy of positions."""


class LeaderSelector:
    """Picks the leader at every tick.

    Whether a station is in the host's lane is decided with hysteresis by the station itself, so a leader
    changes once per cut-in or turn-off and not with the noise of positions.
    """

    def __init__(self) -> None:
        self._leader_id: int | None = None
        self.changes = 0

    @property
    def leader_id(self) -> int | None:
        """Identity of the present leader."""
        return self._leader_id

    def select(
        self, stations: Iterable[Station], host_position_m: float, now_s: float
    ) -> Station | None:
        """Return the leader, None if there is none."""
        ahead = [station for station in stations if self.may_lead(station, host_position_m, now_s)]
        ahead = [station for station in ahead if not self._stands_inside(station, ahead)]
        leader = min(ahead, key=lambda station: station.last.moved_on_m(now_s), default=None)
        identity = None if leader is None else leader.message.station_id
        if identity != self._leader_id:
            self.changes += 1
        self._leader_id = identity
        return leader

    @staticmethod
    def may_lead(station: Station, host_position_m: float, now_s: float) -> bool:
        """Return whether a station is ahead in the lane of the host; see `select`."""
        if not (station.in_lane and station.drives_along):
            return False
        distance_m = station.last.moved_on_m(now_s) - host_position_m
        # A vehicle of unknown length that would overlap the host is ahead, only shorter.
        least_m = -BEHIND_M - station.message.uncertain_length_m
        return least_m <= distance_m <= MAX_DISTANCE_M

    @staticmethod
    def _stands_inside(station: Station, others: Iterable[Station]) -> bool:
        """Return whether a station would be inside another one that has been known for longer."""
        rear = station.last.position_m + station.message.uncertain_length_m
        front, now_s = station.fix.position_m, station.last.time_s
        for other in others:
            if other.first_ms >= station.first_ms:
                continue
            if other.message.station_id == station.message.station_id:
                continue  # hypotheses of a contested identity
            moved_m = other.last.moved_on_m(now_s) - other.last.position_m
            other_front = other.fix.position_m + moved_m
            other_rear = other_front - other.message.front_to_rear_m
            other_rear += other.message.uncertain_length_m
            # The older the other one's message, the less is known of where it is.
            margin = 1.0 + 0.5 * abs(moved_m)
            shared = min(front, other_front) - max(rear, other_rear)
            if shared > margin:
                return True
        return False
