"""What a topic is: its key, its promise, and the frames that headers name."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

from rclpy.qos import QoSProfile

ROAD_FRAME = "road"
"""Frame along the road: origin at the host's start, x in metres travelled."""
HOST_FRAME = "host"
"""Body frame of the host vehicle: x forward, accelerations positive forward."""
LEADER_FRAME = "leader"
"""Body frame of the preceding vehicle."""
PACK_FRAME = "battery_pack"
"""Frame named by the battery, coolant and degradation messages."""


class Topic(Enum):
    """Key of a topic; the value is its name."""

    CLOCK = "/clock"
    DIAGNOSTICS = "/diagnostics"
    PLANT_ODOMETRY = "plant/odometry"
    PLANT_ACCELERATION = "plant/acceleration"
    PLANT_BATTERY = "plant/battery"
    PLANT_CELL_1_TEMPERATURE = "plant/cell_1_temperature"
    PLANT_CELL_N_TEMPERATURE = "plant/cell_n_temperature"
    PLANT_COOLANT_INLET_TEMPERATURE = "plant/coolant_inlet_temperature"
    PLANT_COOLANT_OUTLET_TEMPERATURE = "plant/coolant_outlet_temperature"
    PLANT_POWERS = "plant/powers"
    PLANT_CAPACITY_LOSS = "plant/capacity_loss"
    LEADER = "v2x/leader"
    LEADER_PREVIEW = "v2x/leader_preview"
    SLOPE = "v2x/slope"
    COMMAND = "controller/command"
    ACCELERATION_COMMAND = "controller/acceleration_command"
    COMPRESSOR_POWER_COMMAND = "controller/compressor_power_command"
    PLAN = "controller/plan"
    SOLVE = "controller/solve"


@dataclass(frozen=True)
class NamedField:
    """One entry of a named-values message or one column of a trajectory, with its unit."""

    name: str
    unit: str


@dataclass(frozen=True)
class TopicSpec:
    """What a topic promises.

    Attributes:
        topic: key; `topic.value` is the name.
        message_type: message class.
        qos: profile offered by the publisher and requested by subscribers.
        unit: unit of the content, or `see fields` for named values.
        frame: header frame, or `-`.
        meaning: content and sign convention.
        rate: when it is published.
        publisher: node that publishes it.
        fields: names and units of named values and trajectory columns, in published order.
    """

    topic: Topic
    message_type: type[Any]
    qos: QoSProfile
    unit: str
    frame: str
    meaning: str
    rate: str
    publisher: str
    fields: tuple[NamedField, ...] = ()

    @property
    def name(self) -> str:
        """Topic name as given to the node (relative unless global)."""
        return self.topic.value

    @property
    def type_name(self) -> str:
        """Message type as ROS tools print it, e.g. `nav_msgs/msg/Odometry`."""
        package = self.message_type.__module__.split(".", maxsplit=1)[0]
        return f"{package}/msg/{self.message_type.__name__}"

    @property
    def field_names(self) -> tuple[str, ...]:
        """Names of the fields, in published order."""
        return tuple(entry.name for entry in self.fields)
