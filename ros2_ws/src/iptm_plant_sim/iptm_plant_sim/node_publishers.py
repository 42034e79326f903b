"""Publishers of the plant: the messages of one state, in the order that the other nodes rely on."""

from __future__ import annotations

from collections.abc import Mapping

from rosgraph_msgs.msg import Clock

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.charge import at_charge, pack_capacity_ah
from iptm_core.state import FullChannelState
from iptm_interfaces.codecs import (
    BatteryReading,
    encode_acceleration,
    encode_battery,
    encode_capacity_loss,
    encode_ego_odometry,
    encode_powers,
    encode_safety,
    encode_temperature,
    time_from_ns,
    time_from_s,
)
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import OBSERVATION_TOPICS, PEER_TOPICS, STATE_TOPICS, Topic
from iptm_plant_sim.integrator import cell_voltage_v
from iptm_plant_sim.plant_step import PlantStep


class PlantPublishers:
    """All publishers of the plant but the diagnostics."""

    def __init__(self, node: SuiteNode, parameters: ModelParameters) -> None:
        self._parameters = parameters
        self._frame_prefix = node.frame_prefix
        self._publishers = {
            topic: node.advertise(topic)
            for topic in (*OBSERVATION_TOPICS, Topic.PLANT_SAFETY, Topic.CLOCK)
        }

    def missing_subscribers(
        self, expected_peers: int, others: Mapping[Topic, int]
    ) -> tuple[str, ...]:
        """Names of the topics that not everyone expected listens to yet.

        Args:
            expected_peers: subscribers of odometry and clock to wait for; 0 does not wait.
            others: further subscribers of these two.
        """
        if expected_peers == 0:
            return ()
        # A command depends on the whole state, so each topic needs a subscriber.
        needed = dict.fromkeys(STATE_TOPICS, 1)
        needed |= {topic: expected_peers + others[topic] for topic in PEER_TOPICS}
        return tuple(
            self._publishers[topic].topic_name
            for topic, count in needed.items()
            if self._publishers[topic].get_subscription_count() < count
        )

    def publish(self, step: PlantStep) -> None:
        """Publish one state: the clock last, the odometry last but one."""
        state, prefix = step.state, self._frame_prefix
        for topic, temperature_k in (
            (Topic.PLANT_CELL_1_TEMPERATURE, state.cell_1_temperature_k),
            (Topic.PLANT_CELL_N_TEMPERATURE, state.cell_n_temperature_k),
            (Topic.PLANT_COOLANT_INLET_TEMPERATURE, step.coolant_inlet_temperature_k),
            (Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, step.coolant_outlet_temperature_k),
        ):
            self._publishers[topic].publish(
                encode_temperature.data(prefix, state.time_s, temperature_k)
            )
        self._publishers[Topic.PLANT_BATTERY].publish(encode_battery(self._reading(step)))
        for topic, data in (
            (Topic.PLANT_POWERS, encode_powers.data(prefix, state.time_s, step.powers)),
            (Topic.PLANT_SAFETY, encode_safety.data(prefix, state.time_s, step.safety)),
            (Topic.PLANT_CAPACITY_LOSS, encode_capacity_loss.data(prefix, state)),
            (Topic.PLANT_ACCELERATION, encode_acceleration.data(prefix, state)),
            (Topic.PLANT_ODOMETRY, encode_ego_odometry.data(prefix, state)),
        ):
            self._publishers[topic].publish(data)
        self._publishers[Topic.CLOCK].publish(Clock(clock=time_from_s(state.time_s)))

    def publish_time(self, time_ns: int) -> None:
        """Publish a time between two ticks."""
        self._publishers[Topic.CLOCK].publish(Clock(clock=time_from_ns(time_ns)))

    def _reading(self, step: PlantStep) -> BatteryReading:
        state = step.state
        losses = (state.cell_1_capacity_loss, state.cell_n_capacity_loss)
        temperatures_k = (state.cell_1_temperature_k, state.cell_n_temperature_k)
        voltages_v = (step.cell_1_voltage_v, step.cell_n_voltage_v)
        if isinstance(state, FullChannelState):
            cells = state.cells
            losses = tuple(cells.capacity_losses.tolist())
            temperatures_k = tuple(cells.temperatures_k.tolist())
            voltages_v = tuple(
                cell_voltage_v(
                    step.cell_current_a,
                    cells.temperatures_k,
                    cells.capacity_losses,
                    at_charge(self._parameters, state.state_of_charge),
                ).tolist()
            )
        capacity_ah = pack_capacity_ah(self._parameters, sum(losses) / len(losses))
        return BatteryReading(
            time_s=state.time_s,
            pack_voltage_v=step.pack_voltage_v,
            pack_current_a=step.pack_current_a,
            cell_voltages_v=voltages_v,
            cell_temperatures_k=temperatures_k,
            charge_ah=state.state_of_charge * capacity_ah,
            capacity_ah=capacity_ah,
            design_capacity_ah=pack_capacity_ah(self._parameters, 0.0),
        )
