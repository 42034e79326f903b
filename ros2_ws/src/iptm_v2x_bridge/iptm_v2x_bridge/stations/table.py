"""Table of recently received stations, and which of them leads; rejected messages are counted by reason."""

from __future__ import annotations

from collections.abc import Iterable

from iptm_core.routes.road_line import RoadLine
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.rejections import Rejection, RejectionCounts
from iptm_v2x_bridge.stations.plausibility import Heard, absurd, dated, deviation
from iptm_v2x_bridge.stations.station import Station

STATION_TIMEOUT_MS = 5000
"""A station is forgotten when nothing plausible has come from it for as long."""
CANDIDATE_TIMEOUT_MS = 2500
"""Contradicting messages that are farther apart are single errors."""
PROOFS = 2
"""How often a candidate has to be heard again after the station itself was heard in between."""
MAX_HYPOTHESES = 4
MAX_CANDIDATES = 32
"""Contradicting messages kept at most; the one that was heard first makes room."""
REPEATED = frozenset({Rejection.DUPLICATE, Rejection.OLDER})
"""Nothing new, but no contradiction either."""


class Identity:
    """Assigns the messages with one identity to one or more stations.

    A message that contradicts the station begins a candidate. A station whose position jumped is silent at
    its old position, and a single wrong position is not repeated. Two senders are proven when a candidate is
    heard again twice after the station itself was heard in between, and the two contradict each other at the
    same time. From then on the identity is contested: both are hypotheses, and each message belongs to the
    one that it continues best. That ends when no two hypotheses have contradicted each other for
    `STATION_TIMEOUT_MS`, because one is silent or they agree; the one heard last remains.

    Attributes:
        hypotheses: stations that may be the true one, at least one; the one heard first comes first.
        contested_since_ms: generation of the first message that proved a second sender, TimestampIts; None
            while the identity is not contested.
    """

    def __init__(self, station: Station) -> None:
        self.hypotheses = [station]
        self.contested_since_ms: int | None = None
        self._candidates: dict[Station, int] = {}
        """What contradicts the station, and how often that was proven to be another sender."""
        self._at_odds_ms = 0

    @property
    def first(self) -> Station:
        """The station that was heard first."""
        return self.hypotheses[0]

    @property
    def is_confirmed(self) -> bool:
        """Whether the messages of one of its stations have agreed for long enough."""
        return any(station.is_confirmed for station in self.hypotheses)

    def receive(self, heard: Heard, ego_position_m: float) -> Rejection | None:
        """Take a message in; return why not, None if it was accepted."""
        if self.contested_since_ms is not None:
            return self._receive_contested(heard, ego_position_m)
        refused = self.first.refusal(heard)
        if refused is None:
            self.first.update(heard)
        elif refused not in REPEATED and self._proves_another(heard, ego_position_m):
            return None
        return refused

    def _receive_contested(self, heard: Heard, ego_position_m: float) -> Rejection | None:
        refusals = [station.refusal(heard) for station in self.hypotheses]
        fitting = [
            (deviation(station.newest, heard), number)
            for number, station in enumerate(self.hypotheses)
            if refusals[number] is None or refusals[number] in REPEATED
        ]
        if not fitting:
            return None if self._proves_another(heard, ego_position_m) else refusals[0]
        best = min(fitting)[1]
        if refusals[best] is None:
            station = self.hypotheses[best]
            station.update(heard)
            if any(station.contradicts(other) for other in self.hypotheses):
                self._at_odds_ms = heard.generated_ms
        return refusals[best]

    def _proves_another(self, heard: Heard, ego_position_m: float) -> bool:
        """Take in what no hypothesis can have sent; return whether it proves another one."""
        for station in self._candidates:
            refused = station.refusal(heard)
            if refused in REPEATED:
                return False
            if refused is None:
                at_odds_ms = station.generated_ms
                proven = any(known.contradicts(station) for known in self.hypotheses)
                self._candidates[station] += proven
                station.update(heard)
                if self._candidates[station] < PROOFS:
                    return False
                del self._candidates[station]
                self._add_hypothesis(station, ego_position_m)
                self._at_odds_ms = at_odds_ms
                self.contested_since_ms = self.contested_since_ms or at_odds_ms
                return True
        if len(self._candidates) >= MAX_CANDIDATES:
            del self._candidates[next(iter(self._candidates))]
        first = self.first
        self._candidates[Station(heard, first.road, first.fix.position_m)] = 0
        return False

    def _add_hypothesis(self, station: Station, ego_position_m: float) -> None:
        station.first_ms = min(station.first_ms, self.first.first_ms)
        self.hypotheses.append(station)
        if len(self.hypotheses) > MAX_HYPOTHESES:
            # Stations in other lanes or behind the ego vehicle matter least, then those far ahead.
            def importance(known: Station) -> tuple[bool, float]:
                ahead_m = known.fix.position_m - ego_position_m
                return known.in_lane and ahead_m > 0.0, -abs(ahead_m)

            self.hypotheses.remove(min(self.hypotheses, key=importance))

    def forget_silent(self, now_ms: int) -> bool:
        """Forget stations that have been silent for too long; return whether any is left."""
        self._candidates = {
            station: proofs
            for station, proofs in self._candidates.items()
            if now_ms - station.generated_ms <= CANDIDATE_TIMEOUT_MS
        }
        heard = [
            station
            for station in self.hypotheses
            if now_ms - station.generated_ms <= STATION_TIMEOUT_MS
        ]
        if not heard:
            return False
        if now_ms - self._at_odds_ms > STATION_TIMEOUT_MS:
            heard = [max(heard, key=lambda station: station.generated_ms)]
        if len(heard) == 1:
            self.contested_since_ms = None
        self.hypotheses = heard
        return True


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
        ego_position_m: float = 0.0,
    ) -> Rejection | None:
        """Take a message in; return why not, None if it was accepted."""
        reason = self._judge(message, packet_timestamp_ms, now_ms, ego_position_m)
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
        ego_position_m: float,
    ) -> Rejection | None:
        if absurd(message):
            return Rejection.ABSURD
        heard = dated(message, packet_timestamp_ms, now_ms)
        if isinstance(heard, Rejection):
            return heard
        station_id = message.station_id
        identity = self._confirmed.get(station_id) or self._newcomers.get(station_id)
        if identity is None or not identity.forget_silent(now_ms):
            self._confirmed.pop(station_id, None)
            self._newcomers.pop(station_id, None)
            self._admit(station_id, Identity(Station(heard, self._road, ego_position_m)))
            return None
        refused = identity.receive(heard, ego_position_m)
        if refused is None and station_id in self._newcomers and identity.is_confirmed:
            del self._newcomers[station_id]
            self._confirm(station_id, identity, ego_position_m)
        return refused

    def _admit(self, station_id: int, identity: Identity) -> None:
        if len(self._newcomers) >= MAX_NEWCOMERS:
            del self._newcomers[next(iter(self._newcomers))]
            self.rejections.add(Rejection.TABLE_FULL)
        self._newcomers[station_id] = identity

    def _confirm(self, station_id: int, identity: Identity, ego_position_m: float) -> None:
        self._confirmed[station_id] = identity
        if len(self._confirmed) > MAX_CONFIRMED:
            farthest = max(
                self._confirmed.items(),
                key=lambda entry: min(
                    abs(station.fix.position_m - ego_position_m) + abs(station.fix.lateral_m)
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


MAX_DISTANCE_M = 1000.0
"""Stations beyond this distance are not leader candidates."""
BEHIND_M = 2.0
"""Distance of a rear end behind the ego's front up to which it counts as ahead: accuracy of positions."""


class LeaderSelector:
    """Picks the leader at every tick.

    Whether a station is in the ego vehicle's lane is decided with hysteresis by the station itself, so a
    leader changes once per cut-in or turn-off and not with the noise of positions.
    """

    def __init__(self) -> None:
        self._leader_id: int | None = None
        self.changes = 0

    @property
    def leader_id(self) -> int | None:
        """Identity of the present leader."""
        return self._leader_id

    def select(
        self, stations: Iterable[Station], ego_position_m: float, now_s: float
    ) -> Station | None:
        """Return the leader, None if there is none."""
        ahead = [station for station in stations if self.may_lead(station, ego_position_m, now_s)]
        ahead = [station for station in ahead if not self._stands_inside(station, ahead)]
        leader = min(ahead, key=lambda station: station.last.moved_on_m(now_s), default=None)
        identity = None if leader is None else leader.message.station_id
        if identity != self._leader_id:
            self.changes += 1
        self._leader_id = identity
        return leader

    @staticmethod
    def may_lead(station: Station, ego_position_m: float, now_s: float) -> bool:
        """Return whether a station is ahead in the lane of the ego vehicle; see `select`."""
        if not (station.in_lane and station.drives_along):
            return False
        distance_m = station.last.moved_on_m(now_s) - ego_position_m
        # A vehicle of unknown length that would overlap the ego vehicle is ahead, only shorter.
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
