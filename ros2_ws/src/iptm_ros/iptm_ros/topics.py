"""Every topic of the suite, as data: the one place for names, types, QoS, units and signs.

Names are relative, so that a namespace moves a whole vehicle with its clock; only `/diagnostics` is
global. Without a namespace the clock is `/clock`, to which nodes with `use_sim_time` listen. "Named
values" are `sensor_msgs/JointState` messages of which only the stamp, `name[]` and `position[]` are
used: a stamped vector of named float64 numbers. "Tables" are `sensor_msgs/PointCloud2` messages of one row of
points with a float64 field per column, see `iptm_ros.codecs.motion`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from iptm_core.decision_record import DrivingMode
from iptm_ros.message_types import (
    AccelStamped,
    BatteryState,
    Clock,
    DiagnosticArray,
    Float64,
    Float64MultiArray,
    JointState,
    Odometry,
    PointCloud2,
    String,
    Temperature,
    UInt8MultiArray,
    type_name,
)

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

PLANT = "plant"
BRIDGE = "v2x_bridge"
CONTROLLER = "controller"
VEHICLE = "vehicle_interface"
"""In a car it takes the place of the plant."""

MAP_FRAME = "map"
"""The world, one for all vehicles: x east, y north, z up, origin where the first one starts (REP 105)."""
ROAD_FRAME = "odom"
"""The road pulled straight: origin at the ego vehicle's start, x in metres travelled."""
EGO_FRAME = "base_link"
"""Body of the ego vehicle: origin on the road below the front bumper, x forward, y left, z up."""
LEADER_FRAME = "leader"
"""Body of the preceding vehicle: origin on the road below its rear bumper, axes as for the ego vehicle."""
PACK_FRAME = "battery_pack"
"""The battery pack, fixed in the ego vehicle: named by the battery, coolant and degradation messages."""


_MODES = ", ".join(f"{mode.number:g} {mode.value}" for mode in DrivingMode)


class Topic(Enum):
    """Key of a topic; the value is its name."""

    __hash__ = object.__hash__  # a key of dozens of look-ups a tick

    CLOCK = "clock"
    DIAGNOSTICS = "/diagnostics"
    PLANT_STATE = "plant/state"
    PLANT_ODOMETRY = "plant/odometry"
    PLANT_ACCELERATION = "plant/acceleration"
    PLANT_BATTERY = "plant/battery"
    PLANT_CELL_1_TEMPERATURE = "plant/cell_1_temperature"
    PLANT_CELL_N_TEMPERATURE = "plant/cell_n_temperature"
    PLANT_COOLANT_INLET_TEMPERATURE = "plant/coolant_inlet_temperature"
    PLANT_COOLANT_OUTLET_TEMPERATURE = "plant/coolant_outlet_temperature"
    RANGE_TRACKS = "sensor/tracks"
    ROAD_FRICTION = "sensor/road_friction"
    ENGAGEMENT = "vehicle/engagement"
    ARRIVAL_COST = "vehicle/arrival_cost"
    LEADER = "v2x/leader"
    LEADER_SAMPLES = "v2x/leader_samples"
    LEADER_PREVIEW = "v2x/leader_preview"
    ROAD_AHEAD = "v2x/road_ahead"
    SLOPE = "v2x/slope"
    DATAGRAMS = "v2x/datagrams"
    COMMAND = "controller/command"
    PLAN = "controller/plan"
    SOLVE = "controller/solve"
    VISUAL_ROAD = "visual/road"
    VISUAL_PLAN = "visual/plan"
    VISUAL_LEADER_PREVIEW = "visual/leader_preview"
    VISUAL_LEADER_BOUND = "visual/leader_bound"
    VISUAL_SCENE = "visual/scene"


@dataclass(frozen=True)
class TopicSpec:
    """What a topic promises.

    Attributes:
        topic: key; `topic.value` is the name.
        message_type: message class.
        publisher: node that publishes it.
        frame: header frame, or `-`.
        unit: unit of the content, or `see fields` for named values.
        meaning: content and sign convention.
        fields: names and units of named values and columns of tables, in published order.
        latched: whether late subscribers still get the last message.
        kept: whether late subscribers still get the last messages of a stream.
        rate: when it is published.
        on_request: published only if a parameter requests it; no node waits for it.
    """

    topic: Topic
    message_type: type[Any]
    publisher: str
    frame: str
    unit: str
    meaning: str
    fields: Mapping[str, str] = field(default_factory=dict)
    latched: bool = False
    kept: bool = False
    rate: str = "every tick (1 s)"
    on_request: bool = False

    @property
    def name(self) -> str:
        """Topic name as given to the node (relative unless global)."""
        return self.topic.value

    @property
    def qos(self) -> QoSProfile:
        """Profile requested by subscribers, and offered by the publisher unless it keeps a stream."""
        from iptm_ros import publishers  # noqa: PLC0415  readers of bags do without ROS

        if self.latched:
            return publishers.LATCHED_QOS
        return publishers.RAW_QOS if self.on_request else publishers.STREAM_QOS

    @property
    def offered_qos(self) -> QoSProfile:
        """Profile offered by the publisher; who must not miss the beginning of a stream requests it, too."""
        from iptm_ros import publishers  # noqa: PLC0415  readers of bags do without ROS

        if not self.kept:
            return self.qos
        return publishers.KEPT_RAW_QOS if self.on_request else publishers.KEPT_STREAM_QOS

    @property
    def type_name(self) -> str:
        """Message type as ROS tools print it, e.g. `nav_msgs/msg/Odometry`."""
        return type_name(self.message_type)


# fmt: off
_SPECS = (
    TopicSpec(
        Topic.CLOCK, Clock, PLANT, "-", "s",
        "trip time of the state just published; last message of the plant in a tick",
    ),
    TopicSpec(
        Topic.PLANT_STATE, JointState, PLANT, EGO_FRAME, "see fields",
        "the whole state at the stamp, which the nodes of the suite read and figures are computed from: "
        "distance along the road, speed (never negative), first and last cell of a coolant channel, losses "
        "as fractions of nominal capacity; of the interval that ended at the stamp, acceleration (positive "
        "forward), mean powers (traction and battery positive when drawn from the pack, chiller heat when "
        "cooling, battery heat when made in the cells; a negative compressor power is a heater's), how "
        "long the safety monitor braked, the "
        "smallest gap measured inside (NaN for none), the share of the requested deceleration that the "
        "brakes deliver, and the command carried out: 0 the answer to the state before, 1 an earlier one, "
        "2 the controlled stop for want of one. From compressor_power_w on, NaN is a value that is not "
        "measured; from state_of_charge on, it may be left out as well",
        {
            "position_m": "m", "speed_m_s": "m/s", "acceleration_m_s2": "m/s^2", "compressor_power_w": "W",
            "cell_1_temperature_k": "K", "cell_n_temperature_k": "K",
            "cell_1_capacity_loss": "1", "cell_n_capacity_loss": "1", "state_of_charge": "1",
            "traction_power_w": "W", "auxiliary_power_w": "W", "battery_power_w": "W", "chiller_heat_w": "W",
            "coolant_inlet_temperature_k": "K", "coolant_outlet_temperature_k": "K",
            "service_braking_s": "s", "smallest_gap_m": "m", "brake_share": "1", "battery_heat_w": "W",
            "command_source": "1",
        },
    ),
    TopicSpec(
        Topic.PLANT_ODOMETRY, Odometry, PLANT, f"{ROAD_FRAME} -> {EGO_FRAME}", "m, m/s",
        "for other tools, as the further topics of the plant: pose.position.x = distance along the road, "
        "twist.linear.x = speed; exact values of a simulation, so all covariances are 0",
    ),
    TopicSpec(
        Topic.PLANT_ACCELERATION, AccelStamped, PLANT, EGO_FRAME, "m/s^2",
        "accel.linear.x = acceleration actuated over the interval that ended at the stamp, "
        "positive forward",
    ),
    TopicSpec(
        Topic.PLANT_BATTERY, BatteryState, PLANT, PACK_FRAME, "V, A, degC",
        "pack voltage and current (negative when discharging, as ROS defines it); "
        "cell_voltage, cell_temperature: cell 1 and cell N of a coolant channel; all its cells where "
        "the plant has them (thermal_model full_channel); percentage is the state of charge (0 to 1), "
        "charge and capacity are in Ah, at present",
    ),
    TopicSpec(
        Topic.PLANT_CELL_1_TEMPERATURE, Temperature, PLANT, PACK_FRAME, "degC",
        "first cell of a coolant channel (the coolest)",
    ),
    TopicSpec(
        Topic.PLANT_CELL_N_TEMPERATURE, Temperature, PLANT, PACK_FRAME, "degC",
        "last cell of a coolant channel (the warmest)",
    ),
    TopicSpec(
        Topic.PLANT_COOLANT_INLET_TEMPERATURE, Temperature, PLANT, PACK_FRAME, "degC",
        "coolant entering the pack",
    ),
    TopicSpec(
        Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, Temperature, PLANT, PACK_FRAME, "degC",
        "coolant leaving the pack",
    ),
    TopicSpec(
        Topic.RANGE_TRACKS, PointCloud2, PLANT, EGO_FRAME, "m, m/s",
        "vehicles ahead as a range sensor (radar, camera) measures them, from any node: a point per vehicle "
        "with the fields x and y (float32 or float64, from the front bumper, y to the left) and vx (its "
        "speed less the own); further fields are ignored; no points: nothing in range",
        {"x": "m", "y": "m", "vx": "m/s"}, rate="as the sensor measures", on_request=True,
    ),
    TopicSpec(
        Topic.ROAD_FRICTION, Float64, "the user's", "-", "1",
        "coefficient of friction of the road as a rain sensor, a weather service or the brakes show it: "
        "about 0.9 dry, 0.35 wet, 0.2 snow, 0.1 ice; 0: not known. The controller keeps its distance for it, "
        "in comfort, instead of for road_friction for 60 s of wall time",
        rate="on change, and at least every minute", on_request=True,
    ),
    TopicSpec(
        Topic.ENGAGEMENT, JointState, VEHICLE, EGO_FRAME, "see fields",
        f"who drives a car: mode {_MODES}; pedals, buttons and "
        "the fault flag of the vehicle, 0 or 1 (NaN: not known); acceleration requested at present",
        {
            "mode": "1", "brake_pressed": "1", "accelerator_pressed": "1", "enable_button": "1",
            "cancel_button": "1", "vehicle_fault": "1", "requested_acceleration_m_s2": "m/s^2",
        },
        rate="on change, else every tick", on_request=True,
    ),
    TopicSpec(
        Topic.ARRIVAL_COST, String, "the user's", "-", "EUR, EUR/kWh",
        "cost of the temperature of the pack on arrival, from a plan of the hours after the trip: JSON with "
        "the settings arrival_cost_eur and electricity_eur_kwh of the controller, in place of its own from "
        "the next tick on; the last one counts, also when its publisher has ended",
        latched=True, rate="on change", on_request=True,
    ),
    TopicSpec(
        Topic.LEADER, Odometry, BRIDGE, f"{ROAD_FRAME} -> {LEADER_FRAME}", "m, m/s",
        "preceding vehicle now (range sensor), none where no vehicle is ahead: pose.position.x = rear bumper "
        "along the road, twist.linear.x = speed; covariances are not estimated (0)",
    ),
    TopicSpec(
        Topic.LEADER_SAMPLES, PointCloud2, BRIDGE, ROAD_FRAME, "see fields",
        "preceding vehicle as the range sensor measures it in the interval that begins at header.stamp, for "
        "the safety monitor; no rows: a free road",
        {"time_s": "s", "position_m": "m", "speed_m_s": "m/s"}, kept=True,
    ),
    TopicSpec(
        Topic.LEADER_PREVIEW, PointCloud2, BRIDGE, ROAD_FRAME, "see fields",
        "predicted motion of the preceding vehicle at trip times; the first row lies at the instant of "
        "generation, at header.stamp or before; no rows: nothing received yet; bound_m: how far the vehicle "
        "may be behind these positions (99 % bound), left out where the motion is known",
        {"time_s": "s", "position_m": "m", "speed_m_s": "m/s", "bound_m": "m"},
    ),
    TopicSpec(
        Topic.ROAD_AHEAD, JointState, BRIDGE, ROAD_FRAME, "m, m/s, s",
        "what the road allows the ego, vehicles apart: a bound per name[], at position[] m with velocity[] "
        "m/s until trip time effort[] s: speed_limit from there on (the first one before it, too); stop (a "
        "closed line), not passed by the front before; lead_vehicle: v2x/leader has a "
        "message of this stamp. No names: nothing is known",
        {"lead_vehicle": "-", "speed_limit": "m/s", "stop": "s"},
    ),
    TopicSpec(
        Topic.SLOPE, Float64MultiArray, BRIDGE, "-", "m, rad",
        "road slope over position, 2 x N: row 0 positions (increasing), row 1 slopes "
        "(positive uphill)",
        {"position_m": "m", "slope_rad": "rad"}, latched=True, rate="once at start",
    ),
    TopicSpec(
        Topic.DATAGRAMS, UInt8MultiArray, BRIDGE, "-", "-",
        "data = a datagram as it came from the radio; layout.dim[0].label = when it was received, ns of "
        "TimestampIts; behind the datagrams of a tick the mark of its end",
        kept=True, rate="with publish_datagrams", on_request=True,
    ),
    TopicSpec(
        Topic.COMMAND, JointState, CONTROLLER, EGO_FRAME, "see fields",
        "the decision for the interval that starts at the stamp of the state it answers; last "
        "message of the controller in a tick; a negative compressor power is a heater's",
        {"acceleration_m_s2": "m/s^2", "compressor_power_w": "W"},
    ),
    TopicSpec(
        Topic.PLAN, PointCloud2, CONTROLLER, ROAD_FRAME, "see fields",
        "predicted motion, temperatures and inputs of the ego vehicle at trip times; the inputs of the last "
        "row repeat the last interval; no rows: the command follows no plan",
        {
            "time_s": "s", "position_m": "m", "speed_m_s": "m/s",
            "cell_1_temperature_k": "K", "cell_n_temperature_k": "K",
            "acceleration_m_s2": "m/s^2", "compressor_power_w": "W",
        },
        kept=True,
    ),
    TopicSpec(
        Topic.SOLVE, JointState, CONTROLLER, EGO_FRAME, "see fields",
        "how the decision came about: solver status, processor time, iterations, slacks (0 when the limits "
        "hold), fallback rung (0 = solver), limiter (0 or 1), age of the preview; marginal cost of a "
        "kelvin of both cells at the end of the horizon and its factors; how far ahead the preview is "
        "trusted, what is observed of the actuators, and the wall time of the solve",
        {
            "status_code": "1", "solve_time_s": "s", "iterations": "1",
            "gap_slack_m": "m", "speed_slack_m_s": "m/s", "temperature_slack_k": "K",
            "objective": "1", "fallback_rung": "1", "limiter_active": "1", "preview_age_s": "s",
            "cell_1_marginal_cost_1_k": "1/K", "cell_n_marginal_cost_1_k": "1/K", "aging_rate_1_s": "1/s",
            "aging_sensitivity_1_k": "1/K", "temperature_decay_time_s": "s",
            "trusted_preview_s": "s", "command_delay_s": "s", "brake_share": "1",
            "solve_wall_time_s": "s",
        },
    ),
    TopicSpec(
        Topic.DIAGNOSTICS, DiagnosticArray, "every node", "-", "-",
        "one DiagnosticStatus per node: level, one reason, key values; stamped by the node's clock, the trip "
        "time is the value trip_time_s", rate="on change, else 1 Hz",
    ),
)
# fmt: on

TOPICS: Mapping[Topic, TopicSpec] = MappingProxyType({spec.topic: spec for spec in _SPECS})
"""The table: specification of every topic of a run by its key."""


TICK_TOPICS = (Topic.PLANT_STATE, Topic.LEADER)
"""Topics that make up one row of a trajectory."""


def topic_of(vehicle: str, topic: Topic) -> str:
    """Return the absolute name of a topic of a vehicle: `/car_1/clock`."""
    prefix = "/" + vehicle.strip("/")
    return topic.value if topic.value.startswith("/") else f"{prefix.rstrip('/')}/{topic.value}"


def frame_in(prefix: str, frame: str) -> str:
    """Return the name of a frame of a vehicle in the graph: `car_1/odom` with prefix `car_1`.

    Empty frames and `map` stay, and a name that has the prefix is kept.
    """
    prefix = prefix.strip("/")
    if not prefix or frame in {"", MAP_FRAME} or frame.startswith(f"{prefix}/"):
        return frame
    return f"{prefix}/{frame}"


def full_name(namespace: str, name: str) -> str:
    """Return the full name of a node, or of a topic relative to its namespace."""
    return f"{namespace.rstrip('/')}/{name}"
