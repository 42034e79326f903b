"""Two closed loops in one graph, each in its namespace and with a clock of its own.

ros2 launch iptm_bringup two_vehicles.launch.py first_cycle:=wltc_class3b second_cycle:=us06
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from iptm_core.settings import RoadSettings
from launch import LaunchDescription

LOOP = Path(get_package_share_directory("iptm_bringup")) / "launch" / "closed_loop.launch.py"
VEHICLES = {"car_1": "first_cycle", "car_2": "second_cycle"}


def generate_launch_description() -> LaunchDescription:
    """Return both loops; with the first that ends, everything ends."""
    arguments = [
        DeclareLaunchArgument(
            argument,
            default_value=RoadSettings.cycle,
            description=f"driving cycle ahead of {vehicle}",
        )
        for vehicle, argument in VEHICLES.items()
    ]
    loops = [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(LOOP)),
            launch_arguments={
                "namespace": vehicle,
                "clock": f"/{vehicle}/clock",
                "cycle": LaunchConfiguration(argument),
            }.items(),
        )
        for vehicle, argument in VEHICLES.items()
    ]
    return LaunchDescription([*arguments, *loops])
