"""What the controller acts on, read from the messages of a tick."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from iptm_controller.measurements import Measurements
from iptm_core.errors import MessageError
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import LeaderPreview, LeaderState, PackReading, SlopePreview, VehicleState
from iptm_ros.codecs import decode_leader, decode_observation
from iptm_ros.topics import Topic

FLAT_ROAD = SlopePreview(np.zeros(1), np.zeros(1))


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
