"""Every service of the suite, as data: names, types, servers and what they do.

Names are relative like those of the topics, so that a namespace moves them with the vehicle. Those of player
and recorder are named as those of `ros2 bag`, whose types are in `rosbag2_interfaces`: no wheel has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType

from rclpy.node import Node
from std_srvs.srv import Trigger

from iptm_core.trip_time import NS_PER_S


class Service(Enum):
    """Key of a service; the value is its name."""

    PAUSE = "plant/pause"
    RESUME = "plant/resume"
    STEP = "plant/step"
    RESET = "plant/reset"
    SAVE_PLANT = "plant/save_state"
    SAVE_CONTROLLER = "controller/save_state"
    PLAYER_PAUSE = "player/pause"
    PLAYER_RESUME = "player/resume"
    PLAYER_TOGGLE_PAUSED = "player/toggle_paused"
    PLAYER_PLAY_NEXT = "player/play_next"
    RECORDER_PAUSE = "recorder/pause"
    RECORDER_RESUME = "recorder/resume"
    RECORDER_SPLIT = "recorder/split_bagfile"


@dataclass(frozen=True)
class ServiceSpec:
    """What a service promises; all are `std_srvs/srv/Trigger`, whose message tells what was done or why not.

    Attributes:
        service: key; `service.value` is the name.
        server: node that offers it.
        meaning: what it does.
    """

    service: Service
    server: str
    meaning: str
    service_type: type = Trigger


_SPECS = (
    ServiceSpec(
        Service.PAUSE,
        "plant",
        "hold the trip: in lock-step at the present state, in real time at the next one, before the start "
        "at the first one; the state is repeated every second, so that nobody takes the plant for dead",
    ),
    ServiceSpec(Service.RESUME, "plant", "go on with a trip that is paused"),
    ServiceSpec(
        Service.STEP,
        "plant",
        "drive one interval of a trip that is paused: in lock-step as soon as the command has arrived that "
        "answers the present state, in real time at once",
    ),
    ServiceSpec(
        Service.RESET,
        "plant",
        "begin a new trip from the start, which the other nodes follow; one that is paused stays so",
    ),
    ServiceSpec(
        Service.SAVE_PLANT,
        "plant",
        "write the present state into a file of `state_folder`, to start from with `start_state`",
    ),
    ServiceSpec(
        Service.SAVE_CONTROLLER,
        "controller",
        "write what the controller knew before its newest decision into a file of `state_folder`, likewise",
    ),
    ServiceSpec(Service.PLAYER_PAUSE, "player", "hold the playback"),
    ServiceSpec(Service.PLAYER_RESUME, "player", "go on with a playback that is paused"),
    ServiceSpec(Service.PLAYER_TOGGLE_PAUSED, "player", "hold the playback, or go on"),
    ServiceSpec(
        Service.PLAYER_PLAY_NEXT, "player", "play the next message of a playback that is paused"
    ),
    ServiceSpec(
        Service.RECORDER_PAUSE,
        "recorder",
        "record nothing but latched topics after the present tick",
    ),
    ServiceSpec(Service.RECORDER_RESUME, "recorder", "record again, from the next tick on"),
    ServiceSpec(
        Service.RECORDER_SPLIT, "recorder", "complete the file of the bag and begin the next one"
    ),
)

SERVICES: Mapping[Service, ServiceSpec] = MappingProxyType({spec.service: spec for spec in _SPECS})
"""The table: specification of every service by its key."""


def state_path(node: Node, folder: str, stamp_ns: int) -> Path:
    """Return the file for the state of a node at a trip time: `<folder>/car_1_plant_120s.json`."""
    name = node.get_fully_qualified_name().strip("/").replace("/", "_")
    return Path(folder).resolve() / f"{name}_{stamp_ns / NS_PER_S:.9g}s.json"
