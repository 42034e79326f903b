"""The lead vehicle by the range sensor, alone or joined with its messages, or as a vehicle of the same graph.

Alone, the sensor gives gap and speed, and nothing is known of the future. Joined, gap and speed come from
the sensor and the future from the messages, moved to the measured place, as long as both agree on where the
vehicle is. Where they do not, the nearer one leads. A vehicle of the same graph gives its measured states,
and its plans as predictions.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TypeVar

import numpy as np

from iptm_core.declaration import TextEnum
from iptm_core.lead_track import ANOTHER_LEAD_M, RangeTrack
from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge, single_sample
from iptm_v2x_bridge.prediction.expected_motion import AssumedBraking
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, Observation

LANE_HALF_WIDTH_M = 1.8
"""A track farther to the side is in another lane; the road is taken as straight up to it."""
LONGEST_AGE_NS = NS_PER_S // 2
"""A sensor without a younger measurement counts as silent."""
SAME_SPEED_M_S = 3.0
"""Difference of speeds up to which sensor and messages may mean the same vehicle."""
_KEPT = 64


class Join(TextEnum):
    """What sensor and messages state together."""

    NEITHER = "neither"
    SENSOR = "sensor alone"
    MESSAGES = "messages alone"
    AGREED = "agreed"
    SENSOR_NEARER = "contradiction, sensor nearer"
    MESSAGES_NEARER = "contradiction, messages nearer"


class RangeSensorBridge:
    """Answers ticks from tracks, and from the bridge of messages where there is one; a `TickBridge`.

    Attributes:
        counts: ticks by what sensor and messages state together.
    """

    def __init__(
        self, messages: TickBridge | None = None, before: RangeSensorBridge | None = None
    ) -> None:
        """Set up a bridge.

        Args:
            messages: the bridge of the messages; None for the sensor alone.
            before: the bridge of the trip before, which may hold measurements of this one already.
        """
        self._messages = messages
        self._measured: dict[int, tuple[RangeTrack, ...]] = (
            {} if before is None else before.measurements
        )
        self.counts: Counter[Join] = Counter()

    def take(self, stamp_ns: int, tracks: tuple[RangeTrack, ...]) -> None:
        """Take in the tracks of one instant."""
        self._measured[stamp_ns] = tracks
        while len(self._measured) > _KEPT:
            del self._measured[next(iter(self._measured))]

    @property
    def measurements(self) -> dict[int, tuple[RangeTrack, ...]]:
        """Tracks of the last few instants, by ns of their time."""
        return dict(self._measured)

    def has_measured(self, time_ns: int) -> bool:
        """Return whether there is a measurement at an instant or soon after."""
        return any(0 <= ns - time_ns <= LONGEST_AGE_NS for ns in self._measured)

    def measured(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float
    ) -> LeaderState | None:
        """Return the nearest vehicle of the own lane at an instant; None for none, or a silent sensor."""
        return next(iter(self.in_lane(time_ns, ego_position_m, ego_speed_m_s)), None)

    def in_lane(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float
    ) -> list[LeaderState]:
        """Return the vehicles ahead in the own lane, the nearest first; none of a silent sensor."""
        nearest_ns: int | None = time_ns
        if time_ns not in self._measured:
            nearest_ns = min(self._measured, key=lambda ns: abs(time_ns - ns), default=None)
        if nearest_ns is None or abs(time_ns - nearest_ns) > LONGEST_AGE_NS:
            return []
        ahead = sorted(
            track
            for track in self._measured[nearest_ns]
            if track.gap_m >= 0.0 and abs(track.left_m) <= LANE_HALF_WIDTH_M
        )
        return [
            LeaderState(
                time_ns / NS_PER_S,
                ego_position_m
                + (track.gap_m + track.relative_speed_m_s * (time_ns - nearest_ns) / NS_PER_S),
                max(ego_speed_m_s + track.relative_speed_m_s, 0.0),
            )
            for track in ahead
        ]

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick; see `TickBridge.answer`."""
        sensor = self.measured(time_ns, ego_position_m, ego_speed_m_s)
        alone = BridgeAnswer(time_ns, sensor, LeaderPreview.empty(), lost=False)
        heard = alone
        if self._messages is not None:
            heard = self._messages.answer(time_ns, ego_position_m, ego_speed_m_s)
        join = self._join(sensor, None if self._messages is None else heard)
        self.counts[join] += 1
        if join is Join.AGREED and sensor is not None:
            return _moved(heard, sensor)
        if join is Join.MESSAGES_NEARER:
            return replace(heard, contested=True)
        if join is Join.SENSOR_NEARER:
            return replace(alone, contested=True)
        return heard if join is Join.MESSAGES else alone

    @staticmethod
    def _join(sensor: LeaderState | None, heard: BridgeAnswer | None) -> Join:
        leader = None if heard is None else heard.leader
        if leader is None or heard is None:
            return Join.NEITHER if sensor is None else Join.SENSOR
        if sensor is None:
            return Join.MESSAGES
        ahead_m = leader.position_m + heard.leader_bound_m - sensor.position_m
        same_place = abs(ahead_m) <= ANOTHER_LEAD_M + heard.leader_bound_m
        if same_place and abs(leader.speed_m_s - sensor.speed_m_s) <= SAME_SPEED_M_S:
            return Join.AGREED
        nearer = sensor.position_m <= leader.position_m
        return Join.SENSOR_NEARER if nearer else Join.MESSAGES_NEARER


def _moved(heard: BridgeAnswer, sensor: LeaderState) -> BridgeAnswer:
    """Return the answer of the messages with the vehicle where the sensor measures it."""
    preview = heard.preview
    if preview.times_s.size:
        here_m = float(preview.at(np.array([sensor.time_s]))[0][0])
        preview = preview.nearer_by(here_m - sensor.position_m)
    return replace(heard, leader=sensor, preview=preview, leader_bound_m=0.0)


T = TypeVar("T")


class VehicleAhead:
    """Leader from its own state and plan messages; a `PreviewSource`.

    Everything is kept by its stamp, so an answer depends on stamps alone and not on what else has arrived: to
    a tick belong the state and the plan of that tick. A plan ends where its horizon does, and so does the
    prediction. A silent vehicle is assumed to brake to a halt from its last state on.
    """

    def __init__(self, length_m: float, kept: int | None = None) -> None:
        """Set up a vehicle of which nothing is known yet.

        Args:
            length_m: from the front bumper, the reference point of its position, to the rear one.
            kept: how many of the newest states and plans to keep; None keeps all.
        """
        self._length_m = length_m
        self._kept = kept
        self._states: dict[int, LeaderState] = {}
        self._plans: dict[int, LeaderPreview] = {}

    def note_state(self, stamp_ns: int, front_position_m: float, speed_m_s: float) -> None:
        """Take in a state."""
        rear_m = front_position_m - self._length_m
        self._states[stamp_ns] = LeaderState(stamp_ns / NS_PER_S, rear_m, speed_m_s)
        self._forget(self._states)

    def note_plan(
        self,
        stamp_ns: int,
        times_s: FloatArray,
        front_positions_m: FloatArray,
        speeds_m_s: FloatArray,
    ) -> None:
        """Take in the plan of a tick.

        Args:
            stamp_ns: instant of the state that it starts from, integer nanoseconds of trip time.
            times_s: trip times of its nodes, shape (n,), increasing; n = 0 where the tick has no plan.
            front_positions_m: front bumper at the nodes, shape (n,).
            speeds_m_s: speeds at the nodes, shape (n,).
        """
        # Round-off may let a plan roll backwards at a standstill; a prediction must not.
        positions = np.maximum.accumulate(front_positions_m - self._length_m)
        speeds = np.maximum(speeds_m_s, 0.0)
        self._plans[stamp_ns] = LeaderPreview(times_s, positions, speeds)
        self._forget(self._plans)

    def _forget(self, entries: dict[int, T]) -> None:
        while self._kept is not None and len(entries) > self._kept:
            del entries[next(iter(entries))]

    def has_state(self, time_ns: int) -> bool:
        """Return whether the state of a tick is known."""
        return time_ns in self._states

    def has_plan(self, time_ns: int) -> bool:
        """Return whether it is known what the vehicle planned at a tick, be it nothing."""
        return time_ns in self._plans

    @property
    def was_heard(self) -> bool:
        """Whether any state is known."""
        return bool(self._states)

    def leader_at(self, time_ns: int) -> LeaderState:
        """Return the leader's state at a tick; one state must be known.

        Where the one of the tick is not, the vehicle has braked since the last one known.
        """
        if time_ns in self._states:
            return self._states[time_ns]
        braking = self._braking(np.array([time_ns / NS_PER_S]))
        return LeaderState(
            time_ns / NS_PER_S, float(braking.positions_m[0]), float(braking.speeds_m_s[0])
        )

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the vehicle at the first instant; what it does then is planned, not measured."""
        now_s = float(times_s[0])
        return single_sample(self.leader_at(round(now_s * NS_PER_S)), now_s)

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the plan of a tick as a prediction, at the nodes of the plan; see `PreviewSource`.

        Args:
            times_s: the tick first, the last instant of interest last; the plan decides on those between.

        Returns:
            The prediction; empty where the vehicle had no plan.
        """
        time_ns = round(float(times_s[0]) * NS_PER_S)
        plan = self._plans.get(time_ns)
        if plan is None:
            return self._braking(times_s)
        count = int(np.searchsorted(plan.times_s, times_s[-1], side="right"))
        return LeaderPreview(
            plan.times_s[:count],
            plan.positions_m[:count],
            plan.speeds_m_s[:count],
        )

    def _braking(self, times_s: FloatArray) -> LeaderPreview:
        last = self._states[max(self._states)]
        observed = Observation(last.time_s, last.position_m, last.speed_m_s, None)
        # Without its bounds, which are 0.
        return AssumedBraking().predict(LeaderTrack((observed,)), times_s).cautious()
