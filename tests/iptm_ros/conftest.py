"""Fixtures for tests that need a real node, in a ROS domain of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.context import Context

from iptm_ros.discovery import middleware_settings, reserve_domain
from iptm_ros.suite_node import SuiteNode


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a ROS domain for this test and set the environment of it and its processes."""
    with reserve_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
        for name, value in middleware_settings({}).items():
            monkeypatch.setenv(name, value)
        yield number


@pytest.fixture
def make_node(domain: int) -> Iterator[Callable[..., SuiteNode]]:
    """Create nodes with command-line style arguments, e.g. `make_node("-p", "gap_m:=2.0")`."""
    made: list[tuple[SuiteNode, Context]] = []

    def make(*ros_arguments: str, **options: Any) -> SuiteNode:
        context = Context()
        rclpy.init(args=["test", "--ros-args", *ros_arguments], context=context, domain_id=domain)
        node = SuiteNode("test_node", context=context, **options)
        made.append((node, context))
        return node

    yield make
    for node, context in made:
        node.destroy_node()
        context.try_shutdown()
