"""A string of vehicles in one graph, each in its namespace, with its clock and with a bag of its own.

    ros2 launch iptm_bringup string.launch.py vehicles:=5
    ros2 launch iptm_bringup string.launch.py vehicles:=2 cycle:=us06 record:=true bag:=bags/both

car_1 follows the driving cycle, every other vehicle follows the one before, whose plan is its preview. All
other arguments of `closed_loop.launch.py` hold for every vehicle. The launch ends when all trips have ended.
"""

from datetime import datetime
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from iptm_core.parameters import load_parameters
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.vehicle_string import vehicles_in_string
from launch import LaunchContext, LaunchDescription

LOOP = Path(get_package_share_directory("iptm_bringup")) / "launch" / "closed_loop.launch.py"
# Argument -> default, description.
ARGUMENTS = {
    "vehicles": ("5", "number of vehicles"),
    "leader_length_m": (str(VEHICLE_LENGTH_M), "length of every vehicle in m"),
    "initial_gap_m": (
        str(load_parameters().values.gap.initial_gap_m),
        "gap at the start in m, as in the parameter set",
    ),
    "bag": (
        f"bags/string_{datetime.now().astimezone():%Y%m%d_%H%M%S}",
        "with record:=true, folder of the bag folders, one for each vehicle",
    ),
}


def loops(context: LaunchContext) -> list[GroupAction]:
    """Return a closed loop for each vehicle."""
    told = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    gap_m, length_m = float(told["initial_gap_m"]), float(told["leader_length_m"])
    actions = []
    for vehicle in vehicles_in_string(int(told["vehicles"]), gap_m, length_m):
        arguments = {
            "namespace": vehicle.namespace,
            "vehicle_ahead": vehicle.vehicle_ahead,
            "vehicle_behind": vehicle.vehicle_behind,
            "start_position_m": str(vehicle.start_position_m),
            "leader_source": "vehicle" if vehicle.vehicle_ahead else "cycle",
            "leader_length_m": told["leader_length_m"],
            "initial_gap_m": told["initial_gap_m"],
            "bag": f"{told['bag']}/{vehicle.name}",
        }
        include = IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(LOOP)), launch_arguments=arguments.items()
        )
        # A group each: what an included file sets would otherwise hold for the next one.
        actions.append(GroupAction([include]))
    return actions


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the loops."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=loops)])
