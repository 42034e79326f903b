"""Reads the parameters of the suite's nodes, so that every recording holds the settings of its run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from iptm_core.declaration import Scalar, parameter_specs
from iptm_core.errors import IptmError
from iptm_core.parameters import to_flat_dict
from iptm_core.settings import ModelSettings
from iptm_ros.recording.run_information import MODEL_KEY
from iptm_ros.topics import TOPICS, Topic

# One topic of each node of the loop; the one that simulates the vehicle comes first.
_KNOWN_BY = (Topic.PLANT_STATE, Topic.LEADER, Topic.COMMAND)
_OF_EVERY_NODE = ("use_sim_time", "qos_overrides.", "start_type_description_service")


class ParameterCollector:
    """Collects the parameters of the nodes that publish the suite's topics, under whatever names.

    Args:
        node: node that asks.
        on_found: called with all parameters so far, by node of the suite, whenever a node has answered.
    """

    def __init__(
        self, node: Node, on_found: Callable[[Mapping[str, Mapping[str, Scalar]]], None]
    ) -> None:
        self._node = node
        self._on_found = on_found
        self._clients: dict[Topic, AsyncParameterClient] = {}
        self._asked: set[Topic] = set()
        self._found: dict[str, dict[str, Scalar]] = {}

    def look(self) -> None:
        """Ask the nodes that have come up; call it a few times a second."""
        for topic in _KNOWN_BY:
            if topic not in self._clients:
                self._find(topic)
            elif topic not in self._asked and self._clients[topic].services_are_ready():
                self._asked.add(topic)
                future = self._clients[topic].list_parameters()
                future.add_done_callback(self._listed(topic))

    def _find(self, topic: Topic) -> None:
        spec = TOPICS[topic]
        for endpoint in self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(spec.name)
        ):
            if endpoint.node_name.startswith("_"):  # found a moment ago, not known by name yet
                continue
            full_name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
            self._clients[topic] = AsyncParameterClient(self._node, full_name)
            return

    def _listed(self, topic: Topic) -> Callable[[Future], None]:
        def ask(future: Future) -> None:
            response = future.result()
            names = [] if response is None else response.result.names
            own = [name for name in names if not name.startswith(_OF_EVERY_NODE)]
            if own:
                answer = self._clients[topic].get_parameters(own)
                answer.add_done_callback(lambda values: self._take(topic, own, values))

        return ask

    def _take(self, topic: Topic, names: list[str], future: Future) -> None:
        response = future.result()
        if response is None or len(response.values) != len(names):
            return
        values = (parameter_value_to_python(value) for value in response.values)
        self._found[TOPICS[topic].publisher] = dict(zip(names, values, strict=True))
        self._on_found(self._found)


def with_model(by_node: Mapping[str, Mapping[str, Scalar]]) -> dict[str, Any]:
    """Return parameters of nodes together with the model's, as bags store them.

    The model belongs to the plant. Where its set cannot be read here (it is a file of another machine),
    the bag names the set and lacks its values.
    """
    plant = by_node.get(TOPICS[_KNOWN_BY[0]].publisher, {})
    names = [spec.name for spec in parameter_specs(ModelSettings)]
    stored: dict[str, Any] = {node: dict(given) for node, given in by_node.items()}
    if not all(name in plant for name in names):
        return stored
    try:
        model = ModelSettings(**{name: str(plant[name]) for name in names}).model()
    except IptmError:
        return stored
    return {MODEL_KEY: to_flat_dict(model.values), **stored}
