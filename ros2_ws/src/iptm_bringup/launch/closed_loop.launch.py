"""The closed loop for a full ROS 2 installation: plant, V2X bridge, controller and, if wanted, the recorder.

    ros2 launch iptm_bringup closed_loop.launch.py cycle:=us06 slope:=large record:=true
    ros2 launch iptm_bringup closed_loop.launch.py namespace:=car_1 clock:=/car_1/clock

Everything ends with the first process that does. What no argument names is set in the parameter files.
"""

from datetime import datetime
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("iptm_bringup")) / "config" / "nodes"

# Node -> package, executable, parameters of it that are arguments here, with their types.
ROAD = {"cycle": str, "slope": str}
MODEL = {"parameter_set": str, "parameter_overrides": str}
NODES = {
    "plant": (
        "iptm_plant_sim",
        "plant",
        {**ROAD, "duration_s": float, **MODEL, "mode": str, "rate_factor": float},
    ),
    "v2x_bridge": (
        "iptm_v2x_bridge",
        "bridge",
        {
            **ROAD,
            "initial_gap_m": float,
            "preview_length_s": float,
            "latency_s": float,
            "dropout_probability": float,
            "noise_std_m_s": float,
            "seed": int,
        },
    ),
    "controller": (
        "iptm_controller",
        "controller",
        {"strategy": str, "horizon": str, "solver": str, **MODEL},
    ),
}

ARGUMENTS = {
    "namespace": ("", "namespace of all nodes"),
    "clock": ("/clock", "topic of the clock; two vehicles in one graph need one each"),
    "use_sim_time": ("false", "the nodes go by the stamps of messages; only their logs differ"),
    "record": ("false", "whether to record a bag"),
    "bag": (f"bags/run_{datetime.now().astimezone():%Y%m%d_%H%M%S}", "bag folder to create"),
    "cycle": ("wltc_class3b", "driving cycle of the leader: a name, or the path of a .csv file"),
    "slope": ("as_designed", "slope of the road: as_designed, flat, small or large"),
    "duration_s": ("0.0", "length of the trip in s, 0 for the whole cycle"),
    "parameter_set": ("paper_calibrated", "parameters of the vehicle: a shipped set or a file"),
    "parameter_overrides": ("", "single model parameters, e.g. 'body.mass_kg=1600'"),
    "mode": ("lock_step", "lock_step or real_time"),
    "rate_factor": ("1.0", "real_time: seconds of trip time per second of wall time"),
    "initial_gap_m": ("15.0", "gap at the start in m, gap.initial_gap_m of the parameter set"),
    "preview_length_s": ("60.0", "how far a prediction of the leader reaches, in s"),
    "latency_s": ("0.0", "delay of a prediction in s"),
    "dropout_probability": ("0.0", "share of the predictions lost"),
    "noise_std_m_s": ("0.0", "standard deviation of the predicted speed in m/s"),
    "seed": ("0", "seed of loss and error"),
    "strategy": ("aging", "cost of the controller"),
    "horizon": ("3x1+5x5", "prediction grid, <steps>x<seconds> parts joined by +"),
    "solver": ("riccati", "solver back end"),
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
    common = {
        "namespace": LaunchConfiguration("namespace"),
        "remappings": [("/clock", LaunchConfiguration("clock"))],
        "output": "screen",
        "on_exit": Shutdown(),
    }
    sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    actions = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    for name, (package, executable, own) in NODES.items():
        parameters = {
            key: ParameterValue(LaunchConfiguration(key), value_type=kind)
            for key, kind in own.items()
        }
        parameters["use_sim_time"] = sim_time
        if name != "controller":
            parameters["expected_peers"] = peers
        actions.append(
            Node(
                package=package,
                executable=executable,
                name=name,
                parameters=[LaunchConfiguration(f"{name}_parameters"), parameters],
                **common,
            )
        )
    recorder = Node(
        package="iptm_recording",
        executable="recorder",
        name="recorder",
        arguments=[LaunchConfiguration("bag")],
        condition=IfCondition(record),
        **common,
    )
    return LaunchDescription([*actions, recorder])
