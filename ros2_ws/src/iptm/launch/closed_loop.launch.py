"""The closed loop for a full ROS 2 installation: plant, V2X bridge, controller and, if wanted, the recorder.

    ros2 launch iptm closed_loop.launch.py cycle:=us06 slope:=large record:=true
    ros2 launch iptm closed_loop.launch.py trip:=real_time namespace:=car_1

Every setting of a trip is an argument; all others are the trip's. Files such as
plant_parameters:=FILE hold further parameters of a node. The loop ends with the first of its nodes that does;
it goes on without its recorder. If one of its processes has failed, the launch then fails with exit code 1,
after a mistake in the arguments at once.
"""

import atexit
import shutil
import tempfile
from datetime import datetime
from functools import partial
from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch_ros.actions import Node

from iptm.runner.composition import node_parameters, parameter_file_text
from iptm.runner.runner import check_over_ros
from iptm.trip_files import DEFAULT_TRIP, load_trip, shipped_trips
from iptm.trip_settings import HOME, NODES, SPECS
from iptm_core.errors import ScenarioError
from iptm_core.program import EXIT_USER_ERROR
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT, full_name
from launch import LaunchDescription

EXECUTABLES = {
    PLANT: ("iptm_plant_sim", "plant"),
    BRIDGE: ("iptm_v2x_bridge", "bridge"),
    CONTROLLER: ("iptm_controller", "controller"),
}
OF_THE_RUNNER = ("domain", "faults")
SETTINGS = [name for name in HOME if name not in OF_THE_RUNNER]
# Argument -> default, description.
ARGUMENTS = {
    "trip": (DEFAULT_TRIP, f"{', '.join(shipped_trips())}, or a .yaml file"),
    "clock": ("clock", "topic of the clock; a relative name moves with the namespace"),
    "use_sim_time": ("false", "the nodes go by the stamps of messages; only their logs differ"),
    "record": ("false", "whether to record a bag"),
    "fails_launch": ("true", "whether the launch fails when a process of this loop has failed"),
    "bag": (f"bags/run_{datetime.now().astimezone():%Y%m%d_%H%M%S}", "bag folder to create"),
    **{
        name: ("", f"{SPECS[name].description}; {SPECS[name].allowed}; empty: as in the trip")
        for name in SETTINGS
    },
    **{f"{node}_parameters": ("", f"parameter file of {node}, over the trip") for node in NODES},
}
START_TIMEOUT_S = 660.0
"""For two compilations at a first start."""
TRUTH_VALUES = ["true", "false", "True", "False"]


class LoopEnd:
    """Ends a loop when one of its nodes has ended, and then fails the launch if a process has failed."""

    def __init__(self) -> None:
        self.processes: list[Node] = []
        self._running = 0
        self._fails_launch = True
        self._failures: list[str] = []

    def prepare(self, context) -> None:
        """Read the arguments that the end depends on; they are not in scope any more when it comes."""
        given = context.launch_configurations
        self._running = len(NODES) + (given["record"].lower() == "true")
        self._fails_launch = given["fails_launch"].lower() == "true"

    def on_exit(self, process, event, context) -> list[EmitEvent]:
        """Return what ends the other processes.

        Raises:
            RuntimeError: a process failed; this ends the launch, with exit code 1.
        """
        self._running -= 1
        if event.returncode and not context.is_shutdown:
            failure = f"{event.process_name} ended with exit code {event.returncode}"
            self._failures.append(failure)
            if event.returncode == EXIT_USER_ERROR:
                raise RuntimeError(failure)
        if self._running == 0 and self._failures and self._fails_launch:
            raise RuntimeError("; ".join(self._failures))
        if self.processes.index(process) == len(NODES):  # the recorder
            return []
        others = [each for each in self.processes if each is not process]
        return [
            EmitEvent(event=ShutdownProcess(process_matcher=matches_action(other)))
            for other in others
        ]

    @staticmethod
    def on_start_signal(event, context) -> None:
        """Fail where the trip could not be begun."""
        if event.returncode and not context.is_shutdown:
            raise RuntimeError(
                f"the trip did not begin: {event.process_name} ended with exit code "
                f"{event.returncode}"
            )


def choices_of(name: str) -> list[str] | None:
    """Return what an argument may be, None where that is not a list."""
    if name in {"record", "use_sim_time", "fails_launch"}:
        return TRUTH_VALUES
    spec = SPECS.get(name)
    return ["", *spec.choices] if spec and spec.choices and not spec.suffixes else None


def trip_of(given: dict[str, str]):
    """Return the trip that arguments describe.

    Raises:
        ScenarioError: it is not sound, or asks for what a launch cannot do.
    """
    options = {name: given[name] for name in SETTINGS if given.get(name)}
    trip = check_over_ros(load_trip(given["trip"], options))
    if trip.conditions.faults:
        raise ScenarioError(
            f"trip {trip.name} has faults; allowed: none here, `iptm run` drives it"
        )
    return trip


def loop(context, end: LoopEnd) -> list[RegisterEventHandler | Node]:
    """Return the processes of the loop and what their ends lead to."""
    given = context.launch_configurations
    end.prepare(context)
    trip, is_recorded = trip_of(given), given["record"].lower() == "true"
    folder = Path(tempfile.mkdtemp(prefix="iptm_launch_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    common = {
        "namespace": given["namespace"],
        # rclpy itself subscribes to the second one with use_sim_time.
        "remappings": [("clock", given["clock"]), ("/clock", given["clock"])],
        "output": "screen",
    }
    use_sim_time = given["use_sim_time"].lower() == "true"
    for node, parameters in node_parameters(trip).items():
        file = folder / f"{node}.yaml"
        file.write_text(parameter_file_text(node, parameters), encoding="utf-8")
        files = [str(file), *filter(None, [given[f"{node}_parameters"]])]
        package, executable = EXECUTABLES[node]
        own = {"use_sim_time": use_sim_time}
        end.processes.append(
            Node(
                package=package,
                executable=executable,
                name=node,
                parameters=[*files, own],
                **common,
            )
        )
    if is_recorded:
        recorder = {"package": "iptm_ros", "executable": "recorder", "name": "recorder"}
        end.processes.append(Node(**recorder, arguments=[given["bag"]], **common))
    # Not `Shutdown`, which would end the other vehicles of a launch, too.
    endings = [
        RegisterEventHandler(
            OnProcessExit(target_action=process, on_exit=partial(end.on_exit, process))
        )
        for process in end.processes
    ]
    start = Node(
        package="iptm_ros",
        executable="call",
        arguments=[
            full_name(trip.full_namespace, PLANT),
            "resume",
            "--connected",
            ",".join([*NODES, *(["recorder"] if is_recorded else [])]),
            "--timeout-s",
            str(START_TIMEOUT_S),
        ],
        output="screen",
    )
    endings.append(
        RegisterEventHandler(OnProcessExit(target_action=start, on_exit=end.on_start_signal))
    )
    return [*endings, *end.processes, start]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the processes."""
    arguments = [
        DeclareLaunchArgument(
            name, default_value=default, description=description, choices=choices_of(name)
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=partial(loop, end=LoopEnd()))])
