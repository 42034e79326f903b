"""Starts of nodes that cannot succeed: one clear line and an exit code. And starts that only explain."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from rosgraph_msgs.msg import Clock
from tests.integration.controller_ticks import ROAD, SMALL, await_answer, tick_messages
from tests.integration.driven_plant import driven_plant
from tests.integration.node_bench import node_bench
from tests.waiting import wait_until

from iptm_controller.node import ControllerNode
from iptm_ros.codecs import encode_slope
from iptm_ros.topics import Topic
from iptm_v2x_bridge.node import BridgeNode

CONTROLLER = "iptm_controller.node"
PLANT = "iptm_plant_sim.node"
BRIDGE = "iptm_v2x_bridge.node"

# A value out of its range, a combination that cannot be built, a name that does not exist, for each node;
# that every parameter is checked is a matter of the tests of node parameters.
MISTAKES: dict[str, list[tuple[dict[str, object], str]]] = {
    CONTROLLER: [
        ({"tolerance": ".nan"}, "tolerance"),
        ({"horizon": "3by1"}, "horizon '3by1' cannot be read"),
        ({"horizn": "3x1"}, "did you mean 'horizon'?"),
    ],
    PLANT: [
        ({"rate_factor": 0.0}, "parameter rate_factor is 0.0"),
        ({"cycle": "no_such_cycle"}, "unknown driving cycle 'no_such_cycle'"),
        ({"rate_factr": 2.0}, "did you mean 'rate_factor'?"),
        ({"qos_overrides./plant/odometry.publisher.depth": 5}, "QoS of its topics is fixed"),
    ],
    BRIDGE: [
        ({"latency_s": -1.0}, "parameter latency_s is -1.0"),
        ({"cycle": "absent.csv"}, "absent.csv"),
        ({"latnecy_s": 1.0}, "did you mean 'latency_s'?"),
    ],
}


@pytest.mark.parametrize("module", MISTAKES)
def test_user_mistake_is_one_line_and_exit_code_2(refused: Callable[..., str], module: str) -> None:
    for parameters, expected in MISTAKES[module]:
        line = refused(module, parameters=parameters)
        assert line.startswith(f"{module.partition('.')[0]}: ")
        assert expected in line


def test_a_process_ends_with_the_code_of_a_mistake(launcher: Any) -> None:
    process = launcher.start_node(PLANT, parameters={"rate_factor": 0.0})
    assert process.wait() == 2
    assert process.stderr.startswith("iptm_plant_sim: parameter rate_factor is 0.0")
    assert len(process.stderr.splitlines()) == 1


def test_a_cache_that_cannot_be_written_is_gone_around(launcher: Any) -> None:
    (launcher.directory / "file").write_text("in the way")
    cache = launcher.directory / "file" / "cache"
    process = launcher.start_module(CONTROLLER, IPTM_CACHE_DIR=str(cache))
    wait_until(
        lambda: "compiler cache" in process.stderr or not process.is_running,
        what="the line about the cache",
    )
    assert process.is_running, process.stderr
    assert f"{cache}/user_" in process.stderr
    assert "Traceback" not in process.stderr


@pytest.mark.usefixtures("ros_environment")
def test_frames_have_the_prefix_that_is_asked_for() -> None:
    taxi = {"frame_prefix": "taxi"}
    with driven_plant(**taxi) as plant:
        plant.bench.spin_until(lambda: plant.ticks)
        heard = plant.bench.received[Topic.PLANT_ODOMETRY][:1]
    with node_bench(BridgeNode, **taxi) as bench:
        bench.hear({Topic.CLOCK: Clock()})
        heard += bench.received[Topic.LEADER]
    with node_bench(ControllerNode, **SMALL, **taxi) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        bench.hear(tick_messages(0.0))
        await_answer(bench, 0)
        heard += bench.received[Topic.PLAN]
    frames = [(each.header.frame_id, getattr(each, "child_frame_id", "")) for each in heard]
    assert frames == [
        ("taxi/odom", "taxi/base_link"),
        ("taxi/odom", "taxi/leader"),
        ("taxi/odom", ""),
    ]
