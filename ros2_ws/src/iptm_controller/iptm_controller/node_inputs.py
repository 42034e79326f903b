"""From the messages of a tick to what the controller takes; what is missing or malformed is left out."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from iptm_controller.measurements import Measurements
from iptm_core.errors import MessageError
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_interfaces.codecs import decode_leader, decode_vehicle_state
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import STATE_TOPICS, Topic

FLAT_ROAD = SlopePreview(np.zeros(1), np.zeros(1))


TICK_INPUTS = (*STATE_TOPICS, Topic.LEADER_PREVIEW, Topic.ROAD_AHEAD, Topic.LEADER)


class CompleteTick:
    """Determines whether all messages of a tick have arrived.

    The road ahead states whether there is a leader to wait for. Bridges of earlier versions, and their bags,
    have no such topic; then there always is.
    """

    def __init__(self, node: SuiteNode) -> None:
        name = node.resolve_topic_name(Topic.ROAD_AHEAD.value)
        self._look = partial(node.count_publishers, name)
        self._has_road = False

    def __call__(self, values: Mapping[Topic, Any]) -> bool:
        """Return whether a tick with these messages can be decided."""
        if Topic.LEADER_PREVIEW not in values or any(each not in values for each in STATE_TOPICS):
            return False
        road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
        if road is not None:
            return Topic.LEADER in values or not road.has_leader
        if Topic.LEADER not in values:
            return False
        self._has_road = self._has_road or self._look() > 0
        return not self._has_road


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
    missing = [topic.value for topic in STATE_TOPICS if topic not in values]
    try:
        if missing:
            faults.append(f"no {', '.join(missing)} received")
        else:
            state = decode_vehicle_state(values)
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
    return Measurements(state, leader, preview, slope or FLAT_ROAD, "; ".join(faults), road)
