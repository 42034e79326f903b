"""Every service of the suite, as data: names and what they do.

Names are private, `~/pause`, as in rosbag2 and nav2: they follow name and namespace of the node, so that
two nodes of one kind can share a namespace. Player and recorder name theirs as `ros2 bag` does,
whose types are in `rosbag2_interfaces`: no wheel has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from types import MappingProxyType

from rclpy.node import Node

from iptm_core.state import NS_PER_S


class Service(Enum):
    """Key of a service; the value is its name where the node that offers it has its default name."""

    PAUSE = "plant/pause"
    RESUME = "plant/resume"
    STEP = "plant/step"
    RESET = "plant/reset"
    SAVE_PLANT = "plant/save_state"
    SAVE_CONTROLLER = "controller/save_state"
    BENCH_ENABLE = "vehicle_interface/bench_enable"
    CANCEL = "vehicle_interface/cancel"
    PLAYER_PAUSE = "player/pause"
    PLAYER_RESUME = "player/resume"
    PLAYER_TOGGLE_PAUSED = "player/toggle_paused"
    PLAYER_PLAY_NEXT = "player/play_next"
    RECORDER_PAUSE = "recorder/pause"
    RECORDER_RESUME = "recorder/resume"
    RECORDER_SPLIT = "recorder/split_bagfile"

    @property
    def base_name(self) -> str:
        """Name below the one of the node."""
        return self.value.partition("/")[2]

    @property
    def private_name(self) -> str:
        """Name with which a node offers it."""
        return f"~/{self.base_name}"


MEANINGS: Mapping[Service, str] = MappingProxyType(
    {
        Service.PAUSE: (
            "hold the trip: in lock-step at the present state, in real time at the next one, before the "
            "start at the first one; the state is repeated every second, so that other nodes do not "
            "count the plant as dead"
        ),
        Service.RESUME: "begin a trip that waits for its start, or go on with one that is paused",
        Service.STEP: (
            "drive one interval of a trip that is paused: in lock-step as soon as the command has arrived "
            "that answers the present state, in real time at once; with start_paused the first step leads "
            "to the first state"
        ),
        Service.RESET: (
            "begin a new trip from the start, which the other nodes follow; one that is paused stays so"
        ),
        Service.SAVE_PLANT: (
            "write the present state into a file of `state_folder`, to start from with `start_state`"
        ),
        Service.SAVE_CONTROLLER: (
            "write the state of the controller before its newest decision into a file of `state_folder`, "
            "to start from with `start_state`"
        ),
        Service.BENCH_ENABLE: "as the enable button, on the bench: `bench:=true`, gateway with `--bench`",
        Service.CANCEL: "as the cancel button of the car: the suite stops driving",
        Service.PLAYER_PAUSE: "hold the playback",
        Service.PLAYER_RESUME: "go on with a playback that is paused",
        Service.PLAYER_TOGGLE_PAUSED: "hold the playback, or go on",
        Service.PLAYER_PLAY_NEXT: "play the next message of a playback that is paused",
        Service.RECORDER_PAUSE: "record nothing but latched topics after the present tick",
        Service.RECORDER_RESUME: "record again, from the next tick on",
        Service.RECORDER_SPLIT: "complete the file of the bag and begin the next one",
    }
)
"""Description of each service. All are `std_srvs/srv/Trigger`; the message is the result or the reason."""


def state_path(node: Node, folder: str, stamp_ns: int) -> Path:
    """Return the file for the state of a node at a trip time: `<folder>/car_1_plant_120s.json`."""
    name = node.get_fully_qualified_name().strip("/").replace("/", "_")
    return Path(folder).resolve() / f"{name}_{stamp_ns / NS_PER_S:.9g}s.json"
