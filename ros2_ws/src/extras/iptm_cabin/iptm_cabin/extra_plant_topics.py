"""Topics that this extra adds to the plant's: the cabin of every state.

`plant/cabin/temperature` (`sensor_msgs/Temperature`, degC) is what a thermometer in the cabin measures, and
`plant/cabin/state` (`sensor_msgs/JointState`) has the numbers of `CABIN` by name, as positions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import JointState, Temperature

from iptm_cabin.cabin_plant import CABIN, CabinPlant, CabinVehicleState
from iptm_cabin.parameters import SUFFIX
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_ros.codecs import ns_from_s
from iptm_ros.codecs.cdr import time_from_ns
from iptm_ros.publishers import STREAM_QOS

__all__ = ["SUFFIX", "TYPES", "publisher"]

TEMPERATURE_TOPIC = "plant/cabin/temperature"
STATE_TOPIC = "plant/cabin/state"
TYPES = {
    TEMPERATURE_TOPIC: "sensor_msgs/msg/Temperature",
    STATE_TOPIC: "sensor_msgs/msg/JointState",
}
FRAME = "cabin"


def publisher(node: Any, plant: Plant) -> Callable[[PlantStep], None] | None:
    """Return what publishes the cabin of a step, None for a plant without one."""
    if not isinstance(plant, CabinPlant):
        return None
    temperature = node.create_publisher(Temperature, TEMPERATURE_TOPIC, STREAM_QOS)
    whole = node.create_publisher(JointState, STATE_TOPIC, STREAM_QOS)

    def publish(step: PlantStep) -> None:
        state = step.state
        if not isinstance(state, CabinVehicleState):
            return
        measured = Temperature(temperature=float(state.cabin.air_k - CELSIUS_ZERO_K))
        numbers = JointState(
            name=list(CABIN), position=[float(getattr(state.cabin, name)) for name in CABIN]
        )
        for message in (measured, numbers):
            message.header.stamp = time_from_ns(ns_from_s(state.time_s))
            message.header.frame_id = FRAME
        temperature.publish(measured)
        whole.publish(numbers)

    return publish
