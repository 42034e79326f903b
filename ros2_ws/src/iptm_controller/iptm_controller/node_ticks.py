"""Which tick is answered: a complete one, of several the newest; and what its messages measure."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from iptm_controller.measurements import Measurements
from iptm_core.errors import MessageError
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import LeaderPreview, LeaderState, PackReading, SlopePreview, VehicleState
from iptm_ros.codecs import decode_leader, decode_observation
from iptm_ros.stamp_matcher import MatchedSet
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

SLOW_DECISION_S = 0.05
WAITED_SHARE = 0.5
"""A tick that is complete within this share of the time of a slow decision after it has waited for it."""
CATCH_UP_S = 0.002
OTHER_INPUTS = (Topic.LEADER_PREVIEW, Topic.ROAD_AHEAD, Topic.LEADER)
"""What a decision takes besides the state."""
FLAT_ROAD = SlopePreview(np.zeros(1), np.zeros(1))


class CompleteTick:
    """Determines whether all messages of a tick have arrived.

    The road ahead states whether there is a leader to wait for. Without such a topic, as of a bridge of the
    user's, there always is.
    """

    def __init__(self, node: SuiteNode) -> None:
        name = node.resolve_topic_name(Topic.ROAD_AHEAD.value)
        self._look = partial(node.count_publishers, name)
        self._has_road = False

    def __call__(self, values: Mapping[Topic, Any]) -> bool:
        """Return whether a tick with these messages can be decided."""
        if not {Topic.PLANT_STATE, Topic.LEADER_PREVIEW} <= values.keys():
            return False
        road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
        if road is not None:
            return Topic.LEADER in values or not road.has_leader
        if Topic.LEADER not in values:
            return False
        self._has_road = self._has_road or self._look() > 0
        return not self._has_road


class CatchUp:
    """Answers the newest tick only, where others have waited for the decision on the one before.

    In real time a controller that decides more slowly than ticks come would otherwise fall behind further
    and further. In lock-step the plant waits, so nothing is skipped.

    Attributes:
        is_skipping: whether ticks are skipped at present.
        skipped_ticks: ticks without a decision of their own.
    """

    def __init__(self, node: SuiteNode, answer: Callable[[MatchedSet[Topic]], None]) -> None:
        self.is_skipping = False
        self.skipped_ticks = 0
        self._answer = answer
        self._newest: MatchedSet[Topic] | None = None
        self._seen_last: MatchedSet[Topic] | None = None
        self._answered_s = -math.inf
        self._took_s = 0.0
        self._timer = node.every(CATCH_UP_S, self._catch_up)
        self._timer.cancel()

    def note_answer(self, started_s: float) -> None:
        """Note that a decision which was begun at a steady time is made."""
        self._answered_s = time.monotonic()
        self._took_s = self._answered_s - started_s

    def takes(self, matched: MatchedSet[Topic]) -> bool:
        """Return whether a tick is kept until what else has waited is taken in."""
        if self._newest is None and not self._is_behind():
            self.is_skipping = False
            return False
        if self._newest is not None:
            self.skipped_ticks += 1
            self.is_skipping = True
        self._newest = matched
        if self._timer.is_canceled():
            self._seen_last = None
            self._timer.reset()
        return True

    def _is_behind(self) -> bool:
        """Return whether a tick has waited for the decision on the one before."""
        waited = time.monotonic() - self._answered_s < WAITED_SHARE * self._took_s
        return waited and self._took_s > SLOW_DECISION_S

    def _catch_up(self) -> None:
        """Answer as soon as no further tick has been completed for a moment."""
        if self._newest is not self._seen_last:
            self._seen_last = self._newest
            return
        self._timer.cancel()
        newest, self._newest = self._newest, None
        if newest is not None:
            self._answer(newest)


def read_measurements(values: Mapping[Topic, Any], slope: SlopePreview | None) -> Measurements:
    """Decode the arrived messages, with the reason for each missing one.

    Args:
        values: messages of a tick by topic, preview and road decoded already.
        slope: of the road, None where it is not known.
    """
    faults = []
    road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
    state: VehicleState | None = None
    leader: LeaderState | None = None
    pack: PackReading | None = None
    try:
        if Topic.PLANT_STATE in values:
            observed = decode_observation(values[Topic.PLANT_STATE])
            state, pack = observed.state, observed.pack_reading
        else:
            faults.append(f"no {Topic.PLANT_STATE.value} received")
    except MessageError as error:
        faults.append(str(error))
    try:
        if Topic.LEADER in values:
            leader = decode_leader(values[Topic.LEADER])
        elif road is None or road.has_leader or road.limits is None:
            faults.append("no measurement of the leader received")
    except MessageError as error:
        faults.append(str(error))
    preview: LeaderPreview = values.get(Topic.LEADER_PREVIEW) or LeaderPreview.empty()
    return Measurements(state, leader, preview, slope or FLAT_ROAD, "; ".join(faults), road, pack)
