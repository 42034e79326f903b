"""The closed loop for a full ROS 2 installation: plant, V2X bridge, controller and, if wanted, the recorder.

    ros2 launch iptm_bringup closed_loop.launch.py cycle:=us06 slope:=large record:=true
    ros2 launch iptm_bringup closed_loop.launch.py namespace:=car_1

The loop ends with the first of its processes that does; other loops of the launch go on.
What no argument names is set in the parameter files.
"""

from datetime import datetime
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from iptm_bringup.scenario import BRIDGE, CONTROLLER, NODES, PLANT, Scenario, names_for
from iptm_core.declaration import parameter_specs, plain
from iptm_core.parameters import load_parameters
from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("iptm_bringup")) / "config" / "nodes"
EXECUTABLES = {
    PLANT: ("iptm_plant_sim", "plant"),
    BRIDGE: ("iptm_v2x_bridge", "bridge"),
    CONTROLLER: ("iptm_controller", "controller"),
}

SPECS = {spec.name: spec for spec in parameter_specs(Scenario)}
# Node -> parameters of it that are arguments here, with their types.
PARAMETERS = {node: {name: SPECS[name].kind for name in names_for(node)} for node in NODES}
PARAMETERS[BRIDGE]["initial_gap_m"] = float

DEFAULT_GAP_M = load_parameters().values.gap.initial_gap_m
# Argument -> default, description.
ARGUMENTS = {
    "namespace": ("", "namespace of all nodes"),
    "clock": ("clock", "topic of the clock; a relative name moves with the namespace"),
    "use_sim_time": ("false", "the nodes go by the stamps of messages; only their logs differ"),
    "record": ("false", "whether to record a bag"),
    "bag": (f"bags/run_{datetime.now().astimezone():%Y%m%d_%H%M%S}", "bag folder to create"),
    **{
        name: (str(plain(spec.default)), f"{spec.description}; {spec.allowed}")
        for name, spec in SPECS.items()
        if any(name in of_node for of_node in PARAMETERS.values())
    },
    "initial_gap_m": (str(DEFAULT_GAP_M), "gap at the start in m, as in the parameter set"),
    **{
        f"{node}_parameters": (str(CONFIG / f"{node}.yaml"), f"parameter file of {node}")
        for node in NODES
    },
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the processes."""
    record = LaunchConfiguration("record")
    # The recorder is a listener more that plant and bridge wait for before the first message.
    peers = ParameterValue(
        PythonExpression(["2 if '", record, "'.lower() == 'true' else 1"]), value_type=int
    )
    clock = LaunchConfiguration("clock")
    common = {
        "namespace": LaunchConfiguration("namespace"),
        # The second is what rclpy itself listens to with use_sim_time.
        "remappings": [("clock", clock), ("/clock", clock)],
        "output": "screen",
    }
    sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    actions = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=description,
            choices=list(SPECS[name].choices) or None if name in SPECS else None,
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    processes = []
    for name, (package, executable) in EXECUTABLES.items():
        parameters = {
            key: ParameterValue(LaunchConfiguration(key), value_type=kind)
            for key, kind in PARAMETERS[name].items()
        }
        parameters["use_sim_time"] = sim_time
        if name != CONTROLLER:
            parameters["expected_peers"] = peers
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
            package="iptm_recording",
            executable="recorder",
            name="recorder",
            arguments=[LaunchConfiguration("bag")],
            condition=IfCondition(record),
            **common,
        )
    )
    # Not `Shutdown`, which would end the other vehicles of a launch, too.
    endings = [
        RegisterEventHandler(
            OnProcessExit(
                target_action=process,
                on_exit=[
                    EmitEvent(event=ShutdownProcess(process_matcher=matches_action(other)))
                    for other in processes
                    if other is not process
                ],
            )
        )
        for process in processes
    ]
    return LaunchDescription([*actions, *endings, *processes])
