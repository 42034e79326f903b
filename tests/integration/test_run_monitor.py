"""What the runner knows of who takes part."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from rclpy.node import Node

from iptm.runner.monitor import RunMonitor


def test_a_double_is_seen_whatever_its_topics_are_called(peer: Any) -> None:
    """With faults of topics the bridge publishes to the injector, under other names than usual."""
    context = peer.node.context
    with ExitStack() as stack:

        def take_part(name: str, namespace: str) -> None:
            node = Node(name, namespace=namespace, context=context)
            stack.callback(node.destroy_node)

        monitor = RunMonitor("/car_1", context)
        stack.callback(monitor.destroy_node)
        take_part("v2x_bridge", "/car_1")
        take_part("v2x_bridge", "/car_2")
        assert not monitor.is_doubled("v2x_bridge")
        take_part("v2x_bridge", "/car_1")
        peer.wait_until(lambda: monitor.is_doubled("v2x_bridge"), what="the double")
        assert not monitor.is_doubled("plant")
