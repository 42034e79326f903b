"""The stations that send with one identity: usually one, more if their messages contradict each other."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.routes.road_line import RoadLine
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.stations.plausibility import deviation
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


@dataclass
class _Candidate:
    """What contradicts the station, and how often that was proven to be another sender."""

    station: Station
    proofs: int = 0


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
        self._candidates: list[_Candidate] = []
        self._at_odds_ms = 0

    @property
    def first(self) -> Station:
        """The station that was heard first."""
        return self.hypotheses[0]

    @property
    def is_confirmed(self) -> bool:
        """Whether the messages of one of its stations have agreed for long enough."""
        return any(station.is_confirmed for station in self.hypotheses)

    def receive(
        self,
        message: CamMessage,
        generated_ms: int,
        now_ms: int,
        road: RoadLine,
        ego_position_m: float,
    ) -> Rejection | None:
        """Take a message in; return why not, None if it was accepted."""
        if self.contested_since_ms is not None:
            return self._receive_contested(message, generated_ms, now_ms, road, ego_position_m)
        refused = self.first.refusal(message, generated_ms, now_ms)
        if refused is None:
            self.first.update(message, generated_ms, now_ms)
        elif refused not in REPEATED and self._proves_another(
            message, generated_ms, now_ms, road, ego_position_m
        ):
            return None
        return refused

    def _receive_contested(
        self,
        message: CamMessage,
        generated_ms: int,
        now_ms: int,
        road: RoadLine,
        ego_position_m: float,
    ) -> Rejection | None:
        refusals = [station.refusal(message, generated_ms, now_ms) for station in self.hypotheses]
        fitting = [
            (deviation(station.message, message, generated_ms - station.generated_ms), number)
            for number, station in enumerate(self.hypotheses)
            if refusals[number] is None or refusals[number] in REPEATED
        ]
        if not fitting:
            proven = self._proves_another(message, generated_ms, now_ms, road, ego_position_m)
            return None if proven else refusals[0]
        best = min(fitting)[1]
        if refusals[best] is None:
            station = self.hypotheses[best]
            station.update(message, generated_ms, now_ms)
            if any(station.contradicts(other) for other in self.hypotheses):
                self._at_odds_ms = generated_ms
        return refusals[best]

    def _proves_another(
        self,
        message: CamMessage,
        generated_ms: int,
        now_ms: int,
        road: RoadLine,
        ego_position_m: float,
    ) -> bool:
        """Take in what no hypothesis can have sent; return whether it proves another one."""
        for candidate in self._candidates:
            station = candidate.station
            refused = station.refusal(message, generated_ms, now_ms)
            if refused in REPEATED:
                return False
            if refused is None:
                at_odds_ms = station.generated_ms
                candidate.proofs += any(known.contradicts(station) for known in self.hypotheses)
                station.update(message, generated_ms, now_ms)
                if candidate.proofs < PROOFS:
                    return False
                self._candidates.remove(candidate)
                self._add_hypothesis(station, ego_position_m)
                self._at_odds_ms = at_odds_ms
                self.contested_since_ms = self.contested_since_ms or at_odds_ms
                return True
        near_m = self.first.fix.position_m
        self._candidates = self._candidates[-(MAX_CANDIDATES - 1) :]
        self._candidates.append(_Candidate(Station(message, generated_ms, road, now_ms, near_m)))
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
        self._candidates = [
            candidate
            for candidate in self._candidates
            if now_ms - candidate.station.generated_ms <= CANDIDATE_TIMEOUT_MS
        ]
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
