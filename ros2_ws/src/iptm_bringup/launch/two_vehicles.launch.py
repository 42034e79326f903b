"""Two closed loops in one graph, each in its namespace, with its clock and with a bag of its own.

    ros2 launch iptm_bringup two_vehicles.launch.py first_cycle:=wltc_class3b second_cycle:=us06
    ros2 launch iptm_bringup two_vehicles.launch.py record:=true bag:=bags/both

All other arguments of `closed_loop.launch.py` hold for both vehicles.
"""

from datetime import datetime
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from iptm_core.settings import RoadSettings
from launch import LaunchDescription

LOOP = Path(get_package_share_directory("iptm_bringup")) / "launch" / "closed_loop.launch.py"
VEHICLES = {"car_1": "first_cycle", "car_2": "second_cycle"}


def generate_launch_description() -> LaunchDescription:
    """Return both loops; the launch ends when both have ended."""
    arguments = [
        DeclareLaunchArgument(
            argument,
            default_value=RoadSettings.cycle,
            description=f"driving cycle ahead of {vehicle}",
        )
        for vehicle, argument in VEHICLES.items()
    ]
    arguments.append(
        DeclareLaunchArgument(
            "bag",
            default_value=f"bags/run_{datetime.now().astimezone():%Y%m%d_%H%M%S}",
            description="with record:=true, folder of the bag folders, one for each vehicle",
        )
    )
    # A group each: what an included file sets would otherwise hold for the next one.
    loops = [
        GroupAction(
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(LOOP)),
                    launch_arguments={
                        "namespace": vehicle,
                        "cycle": LaunchConfiguration(argument),
                        "bag": [LaunchConfiguration("bag"), f"/{vehicle}"],
                    }.items(),
                )
            ]
        )
        for vehicle, argument in VEHICLES.items()
    ]
    return LaunchDescription([*arguments, *loops])
