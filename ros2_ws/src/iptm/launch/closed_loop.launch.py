"""The closed loop for a full ROS 2 installation: plant, V2X bridge, controller and, if wanted, the recorder.

    ros2 launch iptm closed_loop.launch.py cycle:=us06 slope:=large record:=true
    ros2 launch iptm closed_loop.launch.py scenario:=real_time namespace:=car_1

The loop ends with the first of its nodes that does; it goes on without its recorder. If one of its processes
has failed, the launch then fails with exit code 1, after a mistake in the arguments at once. Arguments go
before the scenario; what neither names is set in the parameter files.
"""

import atexit
import shutil
import tempfile
from datetime import datetime
from functools import partial
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from iptm.runner.composition import parameter_file_text
from iptm.runner.scenario import NODES, Scenario, names_for
from iptm.runner.scenario_files import load_scenario, shipped_scenarios
from iptm_core.declaration import parameter_specs, plain
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.program import EXIT_USER_ERROR
from iptm_core.settings import VEHICLE_LENGTH_M, VehicleAheadSettings, VehicleSettings
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT
from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("iptm")) / "config" / "nodes"
EXECUTABLES = {
    PLANT: ("iptm_plant_sim", "plant"),
    BRIDGE: ("iptm_v2x_bridge", "bridge"),
    CONTROLLER: ("iptm_controller", "controller"),
}

SPECS = {spec.name: spec for spec in parameter_specs(Scenario)}
# Node -> parameters of it that are arguments here, with their types.
PARAMETERS = {node: {name: SPECS[name].kind for name in names_for(node)} for node in NODES}
PARAMETERS[BRIDGE] |= {
    "initial_gap_m": float,
    "vehicle_ahead": str,
    "leader_length_m": float,
}
PARAMETERS[PLANT] |= {"vehicle_ahead": str, "vehicle_behind": str, "start_position_m": float}
NEIGHBOURS = {
    spec.name: spec
    for group in (VehicleAheadSettings, VehicleSettings)
    for spec in parameter_specs(group)
    if spec.name in {"vehicle_ahead", "vehicle_behind"}
}

START_TIMEOUT_S = 660.0
"""For two compilations at a first start."""
TRUTH_VALUES = ["true", "false", "True", "False"]
DEFAULT_GAP_M = load_parameters().values.gap.initial_gap_m
# Argument -> default, description.
ARGUMENTS = {
    "scenario": ("", f"{', '.join(shipped_scenarios())}, or a .yaml file; empty for none"),
    "namespace": ("", "namespace of all nodes"),
    "clock": ("clock", "topic of the clock; a relative name moves with the namespace"),
    "use_sim_time": ("false", "the nodes go by the stamps of messages; only their logs differ"),
    "record": ("false", "whether to record a bag"),
    "fails_launch": ("true", "whether the launch fails when a process of this loop has failed"),
    "bag": (f"bags/run_{datetime.now().astimezone():%Y%m%d_%H%M%S}", "bag folder to create"),
    **{
        name: (str(plain(spec.default)), f"{spec.description}; {spec.allowed}")
        for name, spec in SPECS.items()
        if any(name in of_node for of_node in PARAMETERS.values())
    },
    "initial_gap_m": (str(DEFAULT_GAP_M), "gap at the start in m, as in the parameter set"),
    "leader_length_m": (str(VEHICLE_LENGTH_M), "leader_source vehicle: length of the leader in m"),
    "start_position_m": ("0.0", "where the vehicle starts along the road, in m"),
    **{name: (str(plain(spec.default)), spec.description) for name, spec in NEIGHBOURS.items()},
    **{
        f"{node}_parameters": (str(CONFIG / f"{node}.yaml"), f"parameter file of {node}")
        for node in NODES
    },
}


def take_scenario(context) -> None:
    """Take the values of the scenario for all arguments that are not given.

    Raises:
        ScenarioError: it cannot be read, or asks for what a launch cannot do.
    """
    given = context.launch_configurations
    if not given["scenario"]:
        return
    scenario = load_scenario(given["scenario"])
    if scenario.faults:
        raise ScenarioError(
            f"scenario {scenario.name} has faults; allowed: none here, scripts/run_demo drives it"
        )
    for name in SPECS.keys() & ARGUMENTS.keys():
        given.setdefault(name, str(plain(getattr(scenario, name))))
    for node, values in scenario.node_parameters.items():
        if f"{node}_parameters" in given:
            raise ScenarioError(
                f"scenario {scenario.name} sets parameters of {node}, as {node}_parameters does; "
                "allowed: one of the two"
            )
        folder = tempfile.mkdtemp(prefix="iptm_launch_")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        path = Path(folder) / f"{node}.yaml"
        path.write_text(parameter_file_text(node, values), encoding="utf-8")
        given[f"{node}_parameters"] = str(path)


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
        if process is self.processes[-1]:  # the recorder
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
    return list(spec.choices) or None if spec and not spec.suffixes else None


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the processes."""
    record = LaunchConfiguration("record")
    clock = LaunchConfiguration("clock")
    common = {
        "namespace": LaunchConfiguration("namespace"),
        # rclpy itself subscribes to the second one with use_sim_time.
        "remappings": [("clock", clock), ("/clock", clock)],
        "output": "screen",
    }
    sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    actions = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=description,
            choices=choices_of(name),
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    end = LoopEnd()
    processes = end.processes
    for name, (package, executable) in EXECUTABLES.items():
        parameters = {
            key: ParameterValue(LaunchConfiguration(key), value_type=kind)
            for key, kind in PARAMETERS[name].items()
        }
        parameters["use_sim_time"] = sim_time
        if name == PLANT:
            parameters["start_paused"] = True
        processes.append(
            Node(
                package=package,
                executable=executable,
                name=name,
                parameters=[LaunchConfiguration(f"{name}_parameters"), parameters],
                **common,
            )
        )
    processes.append(
        Node(
            package="iptm_ros",
            executable="recorder",
            name="recorder",
            arguments=[LaunchConfiguration("bag")],
            condition=IfCondition(record),
            **common,
        )
    )
    namespace, recorded = LaunchConfiguration("namespace"), ["'", record, "'.lower() == 'true'"]
    start = Node(
        package="iptm_ros",
        executable="call",
        arguments=[
            PythonExpression(["'/' + '", namespace, "'.strip('/') + '/plant'"]),
            "resume",
            "--connected",
            PythonExpression(
                ["'plant,v2x_bridge,controller' + (',recorder' if ", *recorded, " else '')"]
            ),
            "--timeout-s",
            str(START_TIMEOUT_S),
        ],
        output="screen",
    )
    # Not `Shutdown`, which would end the other vehicles of a launch, too.
    endings = [
        RegisterEventHandler(
            OnProcessExit(target_action=process, on_exit=partial(end.on_exit, process))
        )
        for process in processes
    ]
    endings.append(
        RegisterEventHandler(OnProcessExit(target_action=start, on_exit=end.on_start_signal))
    )
    scenario, *others = actions
    return LaunchDescription(
        [
            scenario,
            OpaqueFunction(function=take_scenario),
            *others,
            OpaqueFunction(function=end.prepare),
            *endings,
            *processes,
            start,
        ]
    )
