"""The bridge of received messages: datagrams in, for every tick the leader and what it will do.

Where the leader is, is known from its messages alone: its position is the predicted one less its 99 %
bound, its speed the expected one (lowered as well where no preview is published). The preview has the
expected motion and its bounds, without what is unknown of the present position, which moves all of it
nearer. The controller keeps its
braking reserve from where the bounds exceed what counts as known. A leader that falls silent is still
there: it goes on leading, as one that brakes to a halt since its last message.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_MS, NS_PER_S, FloatArray, LeaderPreview, LeaderState
from iptm_v2x_bridge.bridge import BridgeAnswer, preview_times_s
from iptm_v2x_bridge.its import RoadsideRules, Unverified, Verification
from iptm_v2x_bridge.messages.cam import decode_cam
from iptm_v2x_bridge.messages.packets import MessageKind, open_datagram
from iptm_v2x_bridge.prediction.expected_motion import AssumedBraking, History
from iptm_v2x_bridge.prediction.predictor import (
    LeaderPredictor,
    LeaderTrack,
    PredictorName,
    ReceivedPath,
    joined_motion,
)
from iptm_v2x_bridge.rejections import Rejection, RejectionCounts
from iptm_v2x_bridge.stations.station import Station, leader_track
from iptm_v2x_bridge.stations.table import LeaderSelector, StationTable

SILENT_MS = 1500
"""Silence after which a leader is assumed to brake."""
HOLD_MS = 60_000
"""Time for which a silent leader is kept; the ego vehicle has halted behind it by then."""
HOLD_BEFORE_OTHER_MS = 10_000
"""The same time if another station is received farther ahead."""
SAME_CAR_MS = 1000
"""A station first heard no earlier than this before the leader fell silent may be its new identity."""


MAX_REPORTED = 8
"""Contested identities on `/diagnostics`; of more, the number."""


class CamBridge:
    """Answers ticks in increasing order of time from the messages received before them.

    An earlier tick means that a new trip has begun; everything heard before is forgotten.

    Attributes:
        start_timestamp_ms: TimestampIts at trip time 0.
        read_until_ns: trip time up to which datagrams have been handed over, None before any.
    """

    def __init__(
        self,
        road: RoadLine,
        settings: PreviewSettings | None = None,
        *,
        predictors: Sequence[LeaderPredictor] | None = None,
        start_timestamp_ms: int = 0,
        datagram_offset_bytes: int = 0,
        roadside: RoadsideRules | None = None,
        verifier: Verification | None = None,
    ) -> None:
        """Set up a bridge.

        Args:
            road: the ego vehicle's route; position 0 is where the ego vehicle starts.
            settings: length and step of the previews; the faults of a simulated link play no part.
            predictors: from the best informed to one that always has an answer.
            start_timestamp_ms: TimestampIts at trip time 0.
            datagram_offset_bytes: length of what a receiver puts in front of every message or packet.
            roadside: takes in what roadside stations send; None refuses it.
            verifier: verifies signatures; None accepts every message unverified.
        """
        self._road = road
        self._roadside = roadside
        self._verifier = verifier or Unverified()
        self._kinds = tuple(MessageKind) if roadside else (MessageKind.CAM,)
        self._settings = settings or PreviewSettings()
        self._predictors = tuple(predictors or (ReceivedPath(), History()))
        self.start_timestamp_ms = start_timestamp_ms
        self.read_until_ns: int | None = None
        self._offset_bytes = datagram_offset_bytes
        self._restart()

    def _restart(self) -> None:
        self._table = StationTable(self._road)
        if self._roadside is not None:
            self._roadside.forget()
        self._selector = LeaderSelector()
        self._unread = RejectionCounts()
        self._datagrams = 0
        self._verifier.forget()
        self._ego_position_m = 0.0
        self._leader: Station | None = None
        self._last: BridgeAnswer | None = None

    def _begin(self, time_ns: int) -> None:
        if self._last is not None and time_ns < self._last.time_ns:
            self._restart()

    def receive(self, datagram: bytes, time_ns: int) -> Rejection | None:
        """Take a datagram in; return why not, None if its message was accepted, or waits to be decoded."""
        self._begin(time_ns)
        self._datagrams += 1
        opened = open_datagram(datagram[self._offset_bytes :], self._kinds)
        if isinstance(opened, Rejection):
            self._unread.add(opened)
            return opened
        now_ms = self._timestamp_ms(time_ns)
        refused = self._verifier.check(opened, now_ms)
        if refused is not None:
            self._unread.add(refused)
            return refused
        if self._roadside is not None and opened.kind is not MessageKind.CAM:
            self._roadside.receive(opened, now_ms)
            return None
        message = decode_cam(opened.payload)
        if isinstance(message, Rejection):
            self._unread.add(message)
            return message
        return self._table.receive(
            message, opened.packet_timestamp_ms, now_ms, self._ego_position_m
        )

    def decode_waiting(self, time_ns: int) -> None:
        """Decode messages of roadside stations that wait, as many as may be by now (ns of trip time)."""
        if self._roadside is not None:
            self._roadside.decode(self._timestamp_ms(time_ns))

    def count_overflow(self, datagrams: int) -> None:
        """Count datagrams that had to be dropped unread."""
        self._unread.add(Rejection.OVERFLOW, datagrams)

    @property
    def received(self) -> int:
        """Datagrams of this trip so far, those that were dropped unread included."""
        return self._datagrams + self._unread[Rejection.OVERFLOW]

    def _timestamp_ms(self, time_ns: int) -> int:
        return self.start_timestamp_ms + time_ns // NS_PER_MS

    def answer(
        self,
        time_ns: int,
        ego_position_m: float,
        ego_speed_m_s: float = 0.0,  # noqa: ARG002
    ) -> BridgeAnswer:
        """Return the answer to one tick; see `TickBridge.answer`."""
        self._begin(time_ns)
        self._ego_position_m = ego_position_m
        self._table.forget_silent(self._timestamp_ms(time_ns))
        if self._roadside is not None:
            self._roadside.refresh(self._timestamp_ms(time_ns), ego_position_m)
        leader = self._leader = self._leading(time_ns, ego_position_m)
        self._last = (
            BridgeAnswer(time_ns, None, LeaderPreview.empty(), lost=False)
            if leader is None
            else self._answer_with(leader, time_ns)
        )
        return self._last

    def _leading(self, time_ns: int, ego_position_m: float) -> Station | None:
        """Return who leads: the nearest one heard, unless a silent leader is nearer still."""
        now_ms = self._timestamp_ms(time_ns)
        heard = self._selector.select(self._table.confirmed, ego_position_m, now_ms / 1000.0)
        held = self._leader
        if held is None or heard is held:
            return heard
        identity = held.message.station_id
        if any(station is held for station in self._table.hypotheses(identity)):
            return heard  # it is heard, and has left the lane or is not the nearest one any more
        hold_ms = HOLD_MS if heard is None else HOLD_BEFORE_OTHER_MS
        if now_ms - held.heard_ms > hold_ms:
            return heard
        if heard is not None:
            same_car = heard.message.station_id == identity
            same_car |= heard.first_ms >= held.generated_ms - SAME_CAR_MS
            now_s = now_ms / 1000.0
            braking = AssumedBraking().predict(LeaderTrack((held.last,)), np.array([now_s]))
            held_at_m = float(braking.positions_m[0])
            if same_car or heard.last.moved_on_m(now_s) < held_at_m:
                return heard
        return held

    def _answer_with(self, leader: Station, time_ns: int) -> BridgeAnswer:
        stations = self._alternatives(leader, time_ns)
        contested = leader.message.station_id in self._table.contested_since_ms
        now_s = time_ns / NS_PER_S
        # A sender's clock that is a little ahead must not put the generation into the future.
        generated_ms = min(station.generated_ms for station in stations)
        generated_ns = min((generated_ms - self.start_timestamp_ms) * NS_PER_MS, time_ns)
        # Once a second since then, so that the farthest place reached meanwhile is not forgotten.
        since = np.arange(generated_ns, max(time_ns, generated_ns + 1), NS_PER_S) / NS_PER_S
        nodes = np.union1d(since, preview_times_s(self._settings, time_ns))
        predictors, predictions = zip(
            *(self._predict(station, nodes, now_s, contested=contested) for station in stations),
            strict=True,
        )
        joined = joined_motion(predictions)
        preview = replace(joined, times_s=nodes[: joined.times_s.size])
        here = int(np.searchsorted(preview.times_s, now_s - 1e-9))
        bound_m = float(predictions[0].bounds_m[0] + preview.bounds_m[here])
        if not preview.bounds_m.any():
            # A motion that is certain is sent without bounds.
            preview = replace(preview, bounds_m=np.empty(0))
        cautious = preview.cautious()
        position_m, speed_m_s = float(cautious.positions_m[here]), float(preview.speeds_m_s[here])
        if self._settings.preview_mode is not PreviewMode.FULL:
            # The bounds that would cover a slower leader are part of the preview.
            speed_m_s, preview = float(cautious.speeds_m_s[here]), LeaderPreview.empty()
        state = LeaderState(now_s, position_m, speed_m_s)
        return BridgeAnswer(
            time_ns,
            state,
            preview,
            lost=False,
            predictor=str(predictors[0]),
            leader_bound_m=bound_m,
            contested=contested,
        )

    def _alternatives(self, leader: Station, time_ns: int) -> list[Station]:
        """Return the stations that may be the leader, the nearest first: one, unless it is contested."""
        now_s = self._timestamp_ms(time_ns) / 1000.0
        others = [
            station
            for station in self._table.hypotheses(leader.message.station_id)
            if station is not leader
            and self._selector.may_lead(station, self._ego_position_m, now_s)
        ]
        return [leader, *others]

    def _predict(
        self, station: Station, nodes: FloatArray, now_s: float, *, contested: bool
    ) -> tuple[PredictorName, LeaderPreview]:
        """Return the first prediction (in s of TimestampIts) that reaches the present, and its predictor.

        Of a silent leader, the worst case.
        """
        times = nodes + self.start_timestamp_ms / 1000.0
        now = now_s + self.start_timestamp_ms / 1000.0
        track = leader_track(station, now)
        if round(1000.0 * now) - station.heard_ms > SILENT_MS:
            return AssumedBraking.name, AssumedBraking().predict(track, times)
        if contested:
            track = replace(track, path=None)  # its sender is ambiguous
        for predictor in self._predictors:
            prediction = predictor.predict(track, times)
            if prediction is None or not prediction.times_s.size:
                continue
            if prediction.times_s[-1] >= now - 1e-6:
                return predictor.name, prediction
        return History.name, History().predict(track, times)

    @property
    def leader_id(self) -> int | None:
        """Identity of the present leader, heard or silent."""
        return None if self._leader is None else self._leader.message.station_id

    @property
    def table(self) -> StationTable:
        """The stations."""
        return self._table

    def _contested_text(self) -> str:
        """Return the contested identities and since when in trip time, the earliest first."""
        since_ms = sorted((ms, known) for known, ms in self._table.contested_since_ms.items())
        texts = [
            f"{known} since {(ms - self.start_timestamp_ms) / 1000.0:.1f} s"
            for ms, known in since_ms
        ]
        more = [f"{len(texts) - MAX_REPORTED} more"] if len(texts) > MAX_REPORTED else []
        return ", ".join([*texts[:MAX_REPORTED], *more]) or "none"

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics: what arrived, what became of it, who leads."""
        values: dict[str, object] = {
            "datagrams": self._datagrams,
            **self._verifier.report(),
            "messages_accepted": self._table.accepted,
            "stations": len(self._table),
            "leader_station": "none" if self.leader_id is None else self.leader_id,
            "leader_changes": self._selector.changes,
            "contested_stations": self._contested_text(),
        }
        if self._last is not None:
            values["predictor"] = self._last.predictor or "none"
            values["leader_bound_m"] = self._last.leader_bound_m
        counts = self._unread + self._table.rejections
        if self._roadside is not None:
            values |= self._roadside.report()
            counts += self._roadside.rejections
        return values | {f"rejected_{name}": count for name, count in counts.by_reason().items()}
