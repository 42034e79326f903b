"""Signs of life of a node: heard while it lives, and missed soon after its end."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from rclpy.executors import SingleThreadedExecutor

from iptm_ros import node_health
from iptm_ros.node_health import CHECK_PERIOD_S, SILENT_S, HeartbeatWatch
from iptm_ros.suite_node import SuiteNode

PATIENCE_S = 120.0


def test_a_node_is_heard_until_its_end(make_node: Callable[..., SuiteNode]) -> None:
    node, watching = make_node(), make_node()
    watch = HeartbeatWatch(watching, ["test_node", "another"])
    executor = SingleThreadedExecutor(context=watching.context)
    executor.add_node(watching)

    def wait_for(silent: tuple[str, ...]) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while (found := watch.silent()) != silent:
            assert time.monotonic() < until_s, found
            executor.spin_once(CHECK_PERIOD_S)

    wait_for(("test_node", "another"))
    node.show_life()
    wait_for(("another",))
    node.destroy_node()
    wait_for(("test_node", "another"))


def test_only_time_in_which_the_watching_process_ran_counts(
    make_node: Callable[..., SuiteNode], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [10.0]
    monkeypatch.setattr(node_health.time, "monotonic", lambda: now_s[0])
    watch = HeartbeatWatch(make_node(), ["controller"])
    message = node_health.Header(frame_id="controller")
    watch._on_beat(message)
    now_s[0] += 5.0
    assert watch.silent() == ()
    checks = 0
    while not watch.silent():
        now_s[0] += CHECK_PERIOD_S
        checks += 1
    # Of the 5 s two periods count.
    assert checks == pytest.approx(SILENT_S / CHECK_PERIOD_S - 2, abs=1)
