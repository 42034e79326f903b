"""The chain of vehicles ahead: the vehicle in front of the leader shows what the leader will do.

A bridge around the one of range sensor and messages. Where the second track of the sensor, or the messages of
a station, show a vehicle ahead of the leader, the leader is expected to follow it (`car_following`), and to
keep signals and limits. The answer has a preview with bounds as any other one. Without such a vehicle, signal
or limit the answer is the inner one at once, to the last bit.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from iptm_core.declaration import TextEnum
from iptm_core.lead_track import ANOTHER_LEAD_M, ANOTHER_LEAD_M_S, ANOTHER_LEAD_M_S2
from iptm_core.settings import VEHICLE_LENGTH_M, PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState
from iptm_its.car_following import PAST_S, FollowingLaw, Past, shipped_law
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge, preview_times_s
from iptm_v2x_bridge.cam_bridge import SILENT_MS, CamBridge
from iptm_v2x_bridge.prediction.expected_motion import History
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, Observation, PredictorName
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules
from iptm_v2x_bridge.range_sensor import SAME_SPEED_M_S, RangeSensorBridge
from iptm_v2x_bridge.stations.table import LeaderSelector

LONGEST_CHAIN = 4
"""Vehicles ahead of the leader that are looked at, the nearest first."""
KEPT = 128
"""Measurements kept of a vehicle: twelve seconds at 10 Hz."""
LONGEST_STEP_S = 1.5
"""Between measurements that are farther apart, a vehicle may be another one."""
LEAST_SEEN_S = 1.0
"""A vehicle counts after this time: the law needs the change of its speed."""
SECOND_S = 1.0 + 1e-6
"""Time over which a measured acceleration is the mean, with the tolerance of a stamp."""
CLEAR_M = 1.0
"""Space between two vehicles, at least."""
FARTHEST_M = 200.0
"""A vehicle farther ahead of the leader has no influence on its next seconds."""
CHECKED_LEAD_S = 2.0
DOUBTED_S = 10.0
DOUBTED_AFTER = 3
"""After as many forecasts of `CHECKED_LEAD_S` in a row beyond their 90 % bound there is none for `DOUBTED_S`:
the leader does not follow the vehicle that is taken to be ahead of it."""
CHECKED_M = 0.2
"""Tolerance of that bound: resolution of the measurements."""
RULED_S = 20.0
"""Signals count as far ahead as the leader gets in this time."""
CHANGED_M, CHANGED_S = 1.0, 10.0
"""Signals and limits give a preview where they move the leader by as much within this time. An expectation
without them is left to the controller, whose own extrapolation saves more (study `chain`)."""
PREDICTED = "car_following"


class ChainSource(TextEnum):
    """What shows a vehicle ahead of the leader."""

    RANGE_SENSOR = "range_sensor"
    MESSAGES = "messages"


@dataclass(frozen=True)
class ChainVehicle:
    """A vehicle ahead of the leader in the own lane.

    Attributes:
        source: what shows it.
        identity: of its station, 0 for the range sensor.
        position_m: rear end at the tick.
        speed_m_s: speed at the tick.
        acceleration_m_s2: acceleration that it sends, None if it does not.
        age_s: of the measurement.
        bound_m: 95 % bound of its position.
    """

    source: ChainSource
    identity: int
    position_m: float
    speed_m_s: float
    acceleration_m_s2: float | None = None
    age_s: float = 0.0
    bound_m: float = 0.0


class Seen:
    """Bounded past of one vehicle, which begins anew where it can be another one."""

    def __init__(self) -> None:
        self._entries: deque[tuple[float, float, float]] = deque(maxlen=KEPT)

    def add(self, time_s: float, position_m: float, speed_m_s: float) -> None:
        """Take in where the vehicle is (rear end) and how fast."""
        if self._entries:
            then_s, then_m, then_m_s = self._entries[-1]
            passed_s = time_s - then_s
            moved_m = 0.5 * (then_m_s + speed_m_s) * passed_s
            allowed_m_s = ANOTHER_LEAD_M_S + ANOTHER_LEAD_M_S2 * passed_s
            if (
                not 0.0 < passed_s <= LONGEST_STEP_S
                or abs(position_m - then_m - moved_m) > ANOTHER_LEAD_M
                or abs(speed_m_s - then_m_s) > allowed_m_s
            ):
                self._entries.clear()
        self._entries.append((time_s, position_m, speed_m_s))
        while len(self._entries) > 1 and self._entries[1][0] <= time_s - PAST_S:
            self._entries.popleft()

    def forget(self) -> None:
        """Forget the vehicle."""
        self._entries.clear()

    def past(self, now_s: float) -> FloatArray | None:
        """Return position, speed and weight now and 1 to `PAST_S` seconds ago, shape (3, `PAST_S` + 1).

        None for a vehicle that has not been seen for `LEAST_SEEN_S`.
        """
        if not self._entries or self._entries[-1][0] < now_s - 0.5:
            return None
        times, positions, speeds = np.array(self._entries).T
        if now_s - times[0] < LEAST_SEEN_S - 1e-6:
            return None
        at = now_s - _LAGS_S
        found = np.empty((3, at.size))
        found[0] = np.interp(at, times, positions)
        found[1] = np.interp(at, times, speeds)
        found[2] = at >= times[0] - 1e-6
        return found

    @property
    def recent(self) -> tuple[Observation, ...]:
        """Measurements of the last second as predictors take them, oldest first."""
        newest_s = self._entries[-1][0]
        within = takewhile(lambda entry: entry[0] >= newest_s - SECOND_S, reversed(self._entries))
        return tuple(Observation(*entry, None) for entry in within)[::-1]


_LAGS_S = np.arange(PAST_S + 1.0)


class ChainBridge:
    """Answers ticks with a forecast of the leader by the vehicles ahead of it; a `TickBridge`.

    Attributes:
        counts: ticks by what the answer was made of.
    """

    def __init__(
        self,
        inner: TickBridge,
        settings: PreviewSettings,
        *,
        sensor: RangeSensorBridge | None = None,
        messages: CamBridge | None = None,
        rules: tuple[RoadRules, RoadRules] | None = None,
        law: FollowingLaw | None = None,
    ) -> None:
        """Set up a bridge.

        Args:
            inner: the bridge whose answers are completed.
            settings: length and step of the previews.
            sensor: has the second track.
            messages: has the stations.
            rules: likely signals and limits, and the certain ones among them.
            law: of car following; None for the shipped one.
        """
        self._inner, self._settings = inner, settings
        self._sensor, self._messages, self._rules = sensor, messages, rules
        self._law = law or shipped_law()
        self._restart()

    def _restart(self) -> None:
        self._leader, self._second = Seen(), Seen()
        self._stations: dict[int, Seen] = {}
        self._checks: deque[tuple[float, float, float]] = deque(maxlen=KEPT)
        self._failed, self._doubted_until_s = 0, -math.inf
        self._chain: tuple[ChainVehicle, ...] = ()
        self._last: BridgeAnswer | None = None
        self.counts: Counter[str] = Counter()

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick; see `TickBridge.answer`."""
        if self._last is not None and time_ns == self._last.time_ns:
            return self._last
        if self._last is not None and time_ns < self._last.time_ns:
            self._restart()
        answer = self._inner.answer(time_ns, ego_position_m, ego_speed_m_s)
        leader, now_s = answer.leader, time_ns / NS_PER_S
        if leader is None:
            self._leader.forget()
            self._chain = ()
        else:
            if answer.leader_bound_m:
                leader = replace(leader, position_m=leader.position_m + answer.leader_bound_m)
            self._leader.add(now_s, leader.position_m, leader.speed_m_s)
            self._chain = self._ahead(leader, now_s, ego_position_m, ego_speed_m_s)
            if self._may_complete(answer):
                answer = self._completed(answer, now_s)
        self.counts[answer.predictor or "none"] += 1
        self._last = answer
        return answer

    def _may_complete(self, answer: BridgeAnswer) -> bool:
        """Return whether the answer has no better preview, nor reasons for caution."""
        if self._settings.preview_mode is not PreviewMode.FULL:
            return False
        if answer.predictor in {PredictorName.RECEIVED_PATH, PredictorName.ASSUMED_BRAKING}:
            return False
        # The sensor leads where it sees a nearer vehicle than messages state.
        return not answer.contested or (self._sensor is not None and not answer.predictor)

    def _ahead(
        self, leader: LeaderState, now_s: float, ego_position_m: float, ego_speed_m_s: float
    ) -> tuple[ChainVehicle, ...]:
        """Return the vehicles ahead of the leader, the nearest first, without what the sensor contradicts."""
        beyond_m = leader.position_m + VEHICLE_LENGTH_M - CLEAR_M
        time_ns = round(now_s * NS_PER_S)
        measured: ChainVehicle | None = None
        if self._sensor is not None:
            lane = self._sensor.in_lane(time_ns, ego_position_m, ego_speed_m_s)
            seen = next((each for each in lane[1:] if each.position_m > beyond_m), None)
            if seen is None:
                self._second.forget()
            else:
                self._second.add(now_s, seen.position_m, seen.speed_m_s)
                measured = ChainVehicle(
                    ChainSource.RANGE_SENSOR, 0, seen.position_m, seen.speed_m_s
                )
        heard = self._heard(beyond_m, now_s, ego_position_m)
        chain = tuple(heard[:LONGEST_CHAIN])
        if measured is not None:
            beyond_m = measured.position_m + VEHICLE_LENGTH_M
            farther = [each for each in heard if each.position_m > beyond_m]
            agrees = any(
                abs(each.position_m - measured.position_m) <= ANOTHER_LEAD_M + each.bound_m
                and abs(each.speed_m_s - measured.speed_m_s) <= SAME_SPEED_M_S
                for each in heard
            )
            if len(farther) < len(heard) and not agrees:
                self.counts["contradicted"] += 1
            chain = (measured, *farther[: LONGEST_CHAIN - 1])
        self._follow_stations(chain, now_s)
        return chain

    def _follow_stations(self, chain: Sequence[ChainVehicle], now_s: float) -> None:
        """Keep the past of the stations in the chain, and of no other one."""
        kept = {}
        for each in chain:
            if each.source is ChainSource.MESSAGES:
                seen = kept[each.identity] = self._stations.get(each.identity) or Seen()
                seen.add(now_s, each.position_m, each.speed_m_s)
        self._stations = kept

    def _heard(self, beyond_m: float, now_s: float, ego_position_m: float) -> list[ChainVehicle]:
        """Return what stations in the lane show ahead of the leader, the nearest first."""
        if self._messages is None:
            return []
        messages = self._messages
        its_s = messages.start_timestamp_ms / 1000.0 + now_s
        contested = messages.table.contested_since_ms
        found = []
        for station in messages.table.confirmed:
            identity, last = station.message.station_id, station.last
            if identity in contested or 1000.0 * its_s - station.heard_ms > SILENT_MS:
                continue
            if not LeaderSelector.may_lead(station, ego_position_m, its_s):
                continue
            position_m = last.moved_on_m(its_s)
            if beyond_m < position_m <= beyond_m + FARTHEST_M:
                age_s = its_s - last.time_s
                found.append(
                    ChainVehicle(
                        ChainSource.MESSAGES,
                        identity,
                        position_m,
                        last.speed_m_s,
                        last.acceleration_m_s2,
                        age_s,
                        last.bound_m,
                    )
                )
        return sorted(found, key=lambda each: each.position_m)

    def _completed(self, answer: BridgeAnswer, now_s: float) -> BridgeAnswer:
        """Return the answer with the forecast, where there is one."""
        leader = self._leader.past(now_s)
        if leader is None:
            return answer
        self._check(now_s, float(leader[0][0]))
        followed = self._followed(leader, now_s)
        preview = self._obeying(followed, now_s)
        if preview is None:
            return answer
        predictor = PREDICTED if followed is not None else str(PredictorName.SIGNALS)
        bound_m = answer.leader_bound_m
        # Messages that seemed to contradict the sensor state a vehicle of the chain.
        explained = any(each.source is ChainSource.MESSAGES for each in self._chain)
        return replace(
            answer,
            preview=preview.nearer_by(bound_m),
            predictor=predictor,
            contested=answer.contested and not explained,
        )

    def _check(self, now_s: float, position_m: float) -> None:
        """Compare the leader with its earlier forecast for now."""
        while self._checks and self._checks[0][0] <= now_s + 1e-6:
            due_s, expected_m, allowed_m = self._checks.popleft()
            if due_s > now_s - 1e-3:
                self._failed = self._failed + 1 if abs(position_m - expected_m) > allowed_m else 0
                if self._failed == DOUBTED_AFTER:
                    self._doubted_until_s = now_s + DOUBTED_S
                    self.counts["doubted"] += 1

    def _followed(self, leader: FloatArray, now_s: float) -> LeaderPreview | None:
        """Return the leader's motion if it follows the nearest vehicle ahead; None without one."""
        if not self._chain:
            return None
        nearest = self._chain[0]
        seen = self._second
        if nearest.source is ChainSource.MESSAGES:
            seen = self._stations[nearest.identity]
        ahead = seen.past(now_s)
        if ahead is None:
            return None
        gap_m = ahead[0] - leader[0] - VEHICLE_LENGTH_M
        past = Past(leader[1:2], ahead[1:2], gap_m[None], (ahead[2] * leader[2])[None])
        speeds, driven, spread = (values[0] for values in self._law.motion(past))
        nodes = now_s + np.concatenate([[0.0], self._law.leads_s])
        checked = int(np.searchsorted(self._law.leads_s, CHECKED_LEAD_S)) + 1
        allowed_m = float(self._law.half_90[checked] * spread[checked]) + CHECKED_M
        due = (float(nodes[checked]), float(leader[0][0] + driven[checked]), allowed_m)
        self._checks.append(due)
        if now_s < self._doubted_until_s:
            return None
        # What is ahead of the leader moves the expectation, never the limit: that is today's at the best.
        usual = History().predict(LeaderTrack(self._leader.recent), nodes)
        behind = leader[0][0] + driven - (usual.positions_m - usual.bounds_m)
        bounds = np.maximum(self._law.behind_99 * spread, behind)
        bounds = np.minimum(np.maximum.accumulate(bounds), driven)
        return LeaderPreview(nodes, leader[0][0] + driven, speeds, bounds)

    def _obeying(self, followed: LeaderPreview | None, now_s: float) -> LeaderPreview | None:
        """Return the motion at the times of a preview, within signals and limits as far as they are known."""
        time_ns = round(now_s * NS_PER_S)
        times = preview_times_s(self._settings, time_ns)
        free = None if followed is None else _at(followed, times)
        if self._rules is None:
            return free
        track = LeaderTrack(self._leader.recent)
        if not _binds(self._rules[0], track.last):
            return free
        inner = _Fixed(followed)
        its_s = 0.0 if self._messages is None else self._messages.start_timestamp_ms / 1000.0
        moved = tuple(replace(each, time_s=each.time_s + its_s) for each in track.observations)
        inner.offset_s = its_s
        track = replace(track, observations=moved)
        likely, surely = (
            BoundedByRules(inner, rules).predict(track, times + its_s) for rules in self._rules
        )
        if likely is None or surely is None:
            return free
        if free is None:
            near = times <= now_s + CHANGED_S
            usual_m = History().predict(track, times + its_s).positions_m
            moved_m = [abs(each.positions_m - usual_m)[near].max() for each in (likely, surely)]
            if max(moved_m) < CHANGED_M:
                return None
        bounds = likely.bounds_m if free is None else free.bounds_m
        behind = np.maximum(likely.positions_m - surely.positions_m, 0.0)
        bounds = np.maximum.accumulate(np.maximum(bounds, behind))
        return LeaderPreview(times, likely.positions_m, likely.speeds_m_s, bounds)

    @property
    def chain(self) -> Sequence[ChainVehicle]:
        """Vehicles ahead of the leader at the last tick, the nearest first."""
        return self._chain

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        shown = ", ".join(
            f"{each.source} {each.position_m:.0f} m {each.speed_m_s:.1f} m/s"
            for each in self._chain
        )
        ticks = {f"ticks_{name}": count for name, count in sorted(self.counts.items())}
        values: dict[str, object] = {"vehicles_ahead_of_leader": shown or "none", **ticks}
        if self._last is not None:
            values["predictor"] = self._last.predictor or "none"
        return values


class _Fixed:
    """A motion that is known already, in place of a predictor; without one the acceleration decays."""

    name = PredictorName.HISTORY

    def __init__(self, motion: LeaderPreview | None) -> None:
        self._motion = motion
        self.offset_s = 0.0

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview:
        """Return the motion at times by the clock of the messages."""
        if self._motion is None:
            return History().predict(track, times_s)
        found = _at(self._motion, times_s - self.offset_s)
        return replace(found, times_s=times_s)


def _at(motion: LeaderPreview, times_s: FloatArray) -> LeaderPreview:
    """Return a motion at other times; behind its end speed and growth of the bound are kept."""
    positions, speeds = motion.at(times_s)
    nodes, bounds = motion.times_s, motion.bounds_m
    rate = (bounds[-1] - bounds[-2]) / (nodes[-1] - nodes[-2])
    grown = np.interp(times_s, nodes, bounds) + rate * np.maximum(times_s - nodes[-1], 0.0)
    return LeaderPreview(times_s, positions, speeds, grown)


def _binds(rules: RoadRules, last: Observation) -> bool:
    """Return whether a limit is known, or a signal is near enough for the leader to respond."""
    signal = rules.next_after(last.position_m)
    near_m = last.position_m + RULED_S * last.speed_m_s + FARTHEST_M
    return rules.limits is not None or (signal is not None and signal.stop_line_m <= near_m)
