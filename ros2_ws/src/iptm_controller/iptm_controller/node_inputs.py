"""From the messages of a tick to what the controller takes; what is missing or malformed is left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from iptm_controller.measurements import Measurements
from iptm_core.errors import MessageError
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_interfaces.codecs import decode_leader, decode_vehicle_state
from iptm_interfaces.topics import STATE_TOPICS, Topic

FLAT_ROAD = SlopePreview(np.zeros(1), np.zeros(1))


def read_measurements(values: Mapping[Topic, Any], slope: SlopePreview | None) -> Measurements:
    """Decode what arrived, and say why something was not.

    Args:
        values: messages of a tick by topic, the preview decoded already.
        slope: of the road, None where it is not known.
    """
    faults = []
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
        else:
            faults.append("no measurement of the leader received")
    except MessageError as error:
        faults.append(str(error))
    preview: LeaderPreview = values.get(Topic.LEADER_PREVIEW) or LeaderPreview.empty()
    return Measurements(state, leader, preview, slope or FLAT_ROAD, "; ".join(faults))
