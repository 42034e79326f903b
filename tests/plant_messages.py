"""Messages of the plant, for tests of who receives them."""

from __future__ import annotations

from typing import Any

from rclpy.serialization import deserialize_message

from iptm_core.state import IntervalPowers, PlantObservation, SafetyRecord, VehicleState
from iptm_ros.codecs import encode_observation
from iptm_ros.topics import TOPICS, Topic


def plant_messages(
    state: VehicleState,
    powers: IntervalPowers | None = None,
    coolant_k: tuple[float, float] = (300.0, 301.0),
    safety: SafetyRecord | None = None,
) -> dict[Topic, Any]:
    """Return the messages of a state by topic, but for the battery; compressor power is that of the state."""
    drawn = powers or IntervalPowers(9e3, state.compressor_power_w, 200.0, 9.5e3, 100.0)
    observation = PlantObservation(state, drawn, *coolant_k, safety or SafetyRecord())
    data = encode_observation(observation, "")
    return {topic: deserialize_message(data[topic], TOPICS[topic].message_type) for topic in data}
