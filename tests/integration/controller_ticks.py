"""Messages of plant and bridge at a tick, and the answers, for tests of the controller node."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from tests.integration.node_bench import NodeBench, S
from tests.plant_messages import plant_messages
from tests.table_messages import encode_leader_preview

from iptm_controller.measurements import Measurements
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_ros.codecs import (
    decode_command,
    decode_leader,
    decode_leader_preview,
    decode_observation,
    encode_leader,
)
from iptm_ros.diagnostics import Level
from iptm_ros.topics import Topic

ROAD = SlopePreview(np.arange(0.0, 3000.0, 10.0), 0.04 * np.sin(np.arange(300) / 9.0))
LINK = (Topic.LEADER, Topic.LEADER_PREVIEW)
SMALL: dict[str, Any] = {"horizon": "2x1+2x5", "input_timeout_s": 60.0}
"""A small problem without compiled code, and no time limit that a busy machine could break."""


WELL = (Level.OK, "optimal plans")


def tick_messages(
    time_s: float, leader_acceleration_m_s2: float = -0.3, **changes: float
) -> dict[Topic, Any]:
    """All messages of plant and bridge at one tick."""
    state = replace(
        VehicleState(time_s, 200.0 + 15.0 * time_s, 15.0, 0.1, 300.0, 307.0, 308.5, 1e-3, 1e-3),
        **changes,
    )
    ahead = np.arange(61.0)
    speeds = np.maximum(16.0 + leader_acceleration_m_s2 * ahead, 0.0)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    leader = LeaderState(time_s, state.position_m + 45.0, 16.0)
    preview = LeaderPreview(time_s + ahead, leader.position_m + moved, speeds)
    plant = plant_messages(state)
    return {
        Topic.PLANT_STATE: plant[Topic.PLANT_STATE],
        Topic.LEADER: encode_leader(leader),
        Topic.LEADER_PREVIEW: encode_leader_preview(preview, round(time_s * S)),
    }


def as_measured(messages: dict[Topic, Any], road: SlopePreview = ROAD) -> Measurements:
    """What the node makes of them."""
    observed = decode_observation(messages[Topic.PLANT_STATE])
    return Measurements(
        observed.state,
        decode_leader(messages[Topic.LEADER]),
        decode_leader_preview(messages[Topic.LEADER_PREVIEW])[1],
        road,
        pack=observed.pack_reading,
    )


def await_answer(controller: NodeBench, tick: int) -> Any:
    """Return the command of a tick; after a slow decision the controller first looks for newer ticks."""
    controller.spin_until(lambda: controller.stamps(Topic.COMMAND)[-1:] == [tick])
    return decode_command(controller.received[Topic.COMMAND][-1])[1]


def assert_hears(controller: NodeBench, *ticks: int) -> None:
    """Check that ticks are answered as usual."""
    for tick in ticks:
        controller.hear(tick_messages(float(tick)))
        await_answer(controller, tick)
    assert controller.situation == WELL
