"""A string of vehicles in one graph, each in its namespace, with its clock and with a bag of its own.

    ros2 launch iptm_string string.launch.py vehicles:=5
    ros2 launch iptm_string string.launch.py vehicles:=2 cycle:=us06 record:=true bag:=bags/both

car_1 follows the driving cycle, every other vehicle follows the one before, whose plan is its preview. All
other arguments of `closed_loop.launch.py` hold for every vehicle. A vehicle with a failed process stops, and
the others go on. The launch ends when all have ended, with exit code 1 if a process has failed.
"""

from datetime import datetime
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource

from iptm.trip_files import DEFAULT_TRIP, load_trip
from iptm.trip_settings import HOME, NODES
from iptm_string import extra_strings as strings
from launch import LaunchContext, LaunchDescription

LOOP = Path(get_package_share_directory("iptm")) / "launch" / "closed_loop.launch.py"
OF_A_PLACE = ("namespace", "vehicle_ahead", "vehicle_behind", "start_position_m", "leader_source")
"""Settings in which the vehicles of a string differ."""
# Argument -> default, description.
ARGUMENTS = {
    "vehicles": ("5", f"number of vehicles, 2 to {strings.MAX_VEHICLES}"),
    "bag": (
        f"bags/string_{datetime.now().astimezone():%Y%m%d_%H%M%S}",
        "with record:=true, folder of the bag folders, one for each vehicle",
    ),
}


def loops(context: LaunchContext) -> list[RegisterEventHandler | GroupAction]:
    """Return a closed loop for each vehicle.

    Raises:
        ScenarioError: an argument is not a number, or out of range.
    """
    chosen = context.launch_configurations
    options = {name: chosen[name] for name in HOME if chosen.get(name)}
    trip = load_trip(chosen.get("trip", DEFAULT_TRIP), options)
    vehicles = strings.trips_in_string(trip, strings.vehicle_count(chosen["vehicles"]))
    record = chosen.get("record", "false").lower() == "true"
    end = StringEnd(len(vehicles) * (len(NODES) + record + 1))  # 1: the start signal
    actions = [RegisterEventHandler(OnProcessExit(on_exit=end.on_exit))]
    for name, each in vehicles.items():
        arguments = {
            **{key: str(each.settings[key]) for key in OF_A_PLACE},
            "bag": f"{chosen['bag']}/{name}",
            "fails_launch": "false",
        }
        include = IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(LOOP)), launch_arguments=arguments.items()
        )
        # A group each: what an included file sets would otherwise hold for the next one.
        actions.append(GroupAction([include]))
    return actions


class StringEnd:
    """Fails the launch when all processes have ended and one of them has failed."""

    def __init__(self, processes: int) -> None:
        self._running = processes
        self._failures: list[str] = []

    def on_exit(self, event, context) -> None:
        """Count the end of a process.

        Raises:
            RuntimeError: it was the last one, and one has failed; the launch ends with exit code 1.
        """
        self._running -= 1
        if event.returncode and not context.is_shutdown:
            self._failures.append(f"{event.process_name} ended with exit code {event.returncode}")
        if self._running == 0 and self._failures:
            raise RuntimeError("; ".join(self._failures))


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the loops."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=loops)])
