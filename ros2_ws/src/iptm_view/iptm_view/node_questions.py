"""Asks the nodes of a run for the parameters that the page can make use of."""

from __future__ import annotations

from typing import Any

from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from iptm_interfaces.topics import BRIDGE, CONTROLLER, PLANT
from iptm_view.run_facts import asked_names


class NodeQuestions:
    """Pending requests for parameters, and the answers so far; never blocks."""

    def __init__(self, node: Node) -> None:
        prefix = node.get_namespace().rstrip("/")
        self._node = Node(
            f"{node.get_name()}_questions",
            namespace=node.get_namespace(),
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self._clients = {
            name: AsyncParameterClient(self._node, f"{prefix}/{name}")
            for name in (PLANT, BRIDGE, CONTROLLER)
        }
        self._futures: dict[str, Any] = {}
        self.answers: dict[str, dict[str, Any]] = {}

    def ask(self) -> bool:
        """Ask the nodes that are present and have not answered; return whether an answer has come."""
        self._executor.spin_once(timeout_sec=0.0)
        is_new = False
        for name, client in self._clients.items():
            if name in self.answers:
                continue
            future = self._futures.get(name)
            if future is None:
                if client.services_are_ready():
                    self._futures[name] = client.get_parameters(asked_names(name))
            elif future.done():
                del self._futures[name]
                response = future.result()
                if response is not None:
                    self.answers[name] = _known(asked_names(name), response.values)
                    is_new = True
        return is_new

    def close(self) -> None:
        """Stop asking."""
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()

    def forget(self) -> None:
        """Forget all answers, as other nodes may come."""
        self.answers.clear()
        self._futures.clear()


def _known(names: list[str], values: list[Any]) -> dict[str, Any]:
    """Return the parameters that are set, by name."""
    found = zip(names, map(parameter_value_to_python, values), strict=False)
    return {name: value for name, value in found if value is not None}
