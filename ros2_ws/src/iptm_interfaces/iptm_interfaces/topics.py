"""Every topic of the suite, as data: the one place for names, types, QoS, units and signs.

Names are relative, so that a namespace moves a whole vehicle; only `/clock` and `/diagnostics`
are global. "Named values" are `sensor_msgs/JointState` messages of which only the stamp, `name[]`
and `position[]` are used: a stamped vector of named float64 numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from iptm_interfaces.qos import LATCHED_QOS, STREAM_QOS, describe_qos
from iptm_interfaces.topic_spec import (
    HOST_FRAME,
    LEADER_FRAME,
    PACK_FRAME,
    ROAD_FRAME,
    NamedField,
    Topic,
    TopicSpec,
)

__all__ = [
    "HOST_FRAME",
    "LEADER_FRAME",
    "OBSERVATION_TOPICS",
    "PACK_FRAME",
    "ROAD_FRAME",
    "STATE_TOPICS",
    "TICK_TOPICS",
    "TOPICS",
    "NamedField",
    "Topic",
    "TopicSpec",
    "find_topic",
    "topic_table_markdown",
]


def _fields(**units: str) -> tuple[NamedField, ...]:
    return tuple(NamedField(name, unit) for name, unit in units.items())


_TICK = "every tick (1 s)"

_SPECS = (
    TopicSpec(
        Topic.CLOCK,
        Clock,
        STREAM_QOS,
        "s",
        "-",
        "trip time of the state just published; last message of the plant in a tick",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_ODOMETRY,
        Odometry,
        STREAM_QOS,
        "m, m/s",
        f"{ROAD_FRAME} -> {HOST_FRAME}",
        "host: pose.position.x = distance along the road, twist.linear.x = speed (never negative)",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_ACCELERATION,
        AccelStamped,
        STREAM_QOS,
        "m/s^2",
        HOST_FRAME,
        "accel.linear.x = acceleration actuated over the interval that ended at the stamp, "
        "positive forward",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_BATTERY,
        BatteryState,
        STREAM_QOS,
        "V, A, degC",
        PACK_FRAME,
        "pack voltage and current (negative when discharging, as ROS defines it); "
        "cell_voltage[2], cell_temperature[2] are cell 1 and cell N of a coolant channel",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_CELL_1_TEMPERATURE,
        Temperature,
        STREAM_QOS,
        "degC",
        PACK_FRAME,
        "first cell of a coolant channel (the coolest)",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_CELL_N_TEMPERATURE,
        Temperature,
        STREAM_QOS,
        "degC",
        PACK_FRAME,
        "last cell of a coolant channel (the warmest)",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_COOLANT_INLET_TEMPERATURE,
        Temperature,
        STREAM_QOS,
        "degC",
        PACK_FRAME,
        "coolant entering the pack",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_COOLANT_OUTLET_TEMPERATURE,
        Temperature,
        STREAM_QOS,
        "degC",
        PACK_FRAME,
        "coolant leaving the pack",
        _TICK,
        "plant",
    ),
    TopicSpec(
        Topic.PLANT_POWERS,
        JointState,
        STREAM_QOS,
        "see fields",
        PACK_FRAME,
        "means over the interval that ended at the stamp; traction and battery power positive "
        "when drawn from the pack, chiller heat positive when cooling",
        _TICK,
        "plant",
        _fields(
            traction_power_w="W",
            compressor_power_w="W",
            auxiliary_power_w="W",
            battery_power_w="W",
            chiller_heat_w="W",
        ),
    ),
    TopicSpec(
        Topic.PLANT_CAPACITY_LOSS,
        JointState,
        STREAM_QOS,
        "see fields",
        PACK_FRAME,
        "capacity loss as a fraction of nominal capacity, growing with age",
        _TICK,
        "plant",
        _fields(cell_1_capacity_loss="1", cell_n_capacity_loss="1"),
    ),
    TopicSpec(
        Topic.LEADER,
        Odometry,
        STREAM_QOS,
        "m, m/s",
        f"{ROAD_FRAME} -> {LEADER_FRAME}",
        "preceding vehicle now (range sensor): pose.position.x = rear bumper along the road, "
        "twist.linear.x = speed",
        _TICK,
        "v2x_bridge",
    ),
    TopicSpec(
        Topic.LEADER_PREVIEW,
        JointTrajectory,
        STREAM_QOS,
        "m, m/s",
        ROAD_FRAME,
        "predicted motion of the preceding vehicle: positions [m], velocities [m/s] at "
        "header.stamp + time_from_start; the first point lies at the instant of generation "
        "(time_from_start <= 0); no points: nothing received yet",
        _TICK,
        "v2x_bridge",
        _fields(leader="m, m/s"),
    ),
    TopicSpec(
        Topic.SLOPE,
        Float64MultiArray,
        LATCHED_QOS,
        "m, rad",
        "-",
        "road slope over position, 2 x N: row 0 positions (increasing), row 1 slopes "
        "(positive uphill)",
        "once at start",
        "v2x_bridge",
        _fields(position_m="m", slope_rad="rad"),
    ),
    TopicSpec(
        Topic.COMMAND,
        JointState,
        STREAM_QOS,
        "see fields",
        HOST_FRAME,
        "the decision for the interval that starts at the stamp of the state it answers; last "
        "message of the controller in a tick",
        _TICK,
        "controller",
        _fields(acceleration_m_s2="m/s^2", compressor_power_w="W"),
    ),
    TopicSpec(
        Topic.ACCELERATION_COMMAND,
        Float64,
        STREAM_QOS,
        "m/s^2",
        "-",
        "acceleration of the decision, as a plain scalar for plots",
        _TICK,
        "controller",
    ),
    TopicSpec(
        Topic.COMPRESSOR_POWER_COMMAND,
        Float64,
        STREAM_QOS,
        "W",
        "-",
        "compressor power of the decision, as a plain scalar for plots",
        _TICK,
        "controller",
    ),
    TopicSpec(
        Topic.PLAN,
        JointTrajectory,
        STREAM_QOS,
        "see fields",
        ROAD_FRAME,
        "predicted motion, temperatures and inputs of the host at header.stamp + time_from_start; "
        "the inputs of the last point repeat those of the last interval",
        _TICK,
        "controller",
        _fields(
            position_m="m",
            speed_m_s="m/s",
            cell_1_temperature_k="K",
            cell_n_temperature_k="K",
            acceleration_m_s2="m/s^2",
            compressor_power_w="W",
        ),
    ),
    TopicSpec(
        Topic.SOLVE,
        JointState,
        STREAM_QOS,
        "see fields",
        HOST_FRAME,
        "how the decision came about: solver status, time, iterations, slacks (0 when the limits "
        "hold), fallback rung (0 = solver), limiter (0 or 1), age of the preview",
        _TICK,
        "controller",
        _fields(
            status_code="1",
            solve_time_s="s",
            iterations="1",
            gap_slack_m="m",
            speed_slack_m_s="m/s",
            temperature_slack_k="K",
            objective="1",
            fallback_rung="1",
            limiter_active="1",
            preview_age_s="s",
        ),
    ),
    TopicSpec(
        Topic.DIAGNOSTICS,
        DiagnosticArray,
        STREAM_QOS,
        "-",
        "-",
        "one DiagnosticStatus per node: level, one reason, key values",
        "on change, else 1 Hz",
        "every node",
    ),
)

TOPICS: Mapping[Topic, TopicSpec] = MappingProxyType({spec.topic: spec for spec in _SPECS})
"""The table: specification of every topic by its key."""


STATE_TOPICS = (
    Topic.PLANT_ODOMETRY,
    Topic.PLANT_ACCELERATION,
    Topic.PLANT_CELL_1_TEMPERATURE,
    Topic.PLANT_CELL_N_TEMPERATURE,
    Topic.PLANT_POWERS,
    Topic.PLANT_CAPACITY_LOSS,
)
"""Topics that make up the state of vehicle and pack: a decision depends on all of them."""

OBSERVATION_TOPICS = (
    *STATE_TOPICS,
    Topic.PLANT_COOLANT_INLET_TEMPERATURE,
    Topic.PLANT_COOLANT_OUTLET_TEMPERATURE,
)
"""Topics that make up an observation of the plant: the state and the coolant."""

TICK_TOPICS = (*OBSERVATION_TOPICS, Topic.LEADER)
"""Topics that make up one row of a trajectory."""


def find_topic(name: str, namespace: str = "/") -> TopicSpec | None:
    """Return the specification of a resolved topic name, or None for a foreign topic.

    Args:
        name: absolute name as seen in the graph or in a bag, e.g. `/car_1/plant/odometry`.
        namespace: namespace of the suite, e.g. `/car_1`.
    """
    prefix = "/" + namespace.strip("/")
    prefix = prefix if prefix.endswith("/") else prefix + "/"
    for spec in _SPECS:
        absolute = spec.name if spec.name.startswith("/") else prefix + spec.name
        if absolute == name:
            return spec
    return None


def topic_table_markdown() -> str:
    """Return the table of the README: one row per topic, one table of named fields below it."""
    lines = [
        "| topic | type | QoS | unit | frame | meaning and sign | rate | publisher |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| `{s.name}` | `{s.type_name.replace('/msg/', '/')}` | {describe_qos(s.qos)} | {s.unit} "
        f"| {s.frame} | {s.meaning} | {s.rate} | {s.publisher} |"
        for s in _SPECS
    ]
    lines += ["", "| topic | field | unit |", "|---|---|---|"]
    lines += [f"| `{s.name}` | `{f.name}` | {f.unit} |" for s in _SPECS for f in s.fields]
    return "\n".join(lines) + "\n"
