"""The controller and the trips of the plant: a new one is reported, and no burst hides the present state."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests.integration.controller_ticks import ROAD, SMALL, tick_messages
from tests.integration.node_bench import NodeBench, node_bench

from iptm_controller.node import ControllerNode
from iptm_interfaces.codecs import encode_slope
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.suite_node import LEAST_HISTORY
from iptm_interfaces.topics import STATE_TOPICS, Topic

pytestmark = pytest.mark.usefixtures("ros_environment")


@pytest.fixture
def controller() -> Iterator[NodeBench]:
    with node_bench(ControllerNode, **SMALL) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        yield bench


def situation_at(controller: NodeBench, tick: int) -> tuple[Level, str]:
    """Return the report after the answer to a tick."""
    controller.hear(tick_messages(float(tick)))
    # After a slow decision the controller looks for newer ticks before it answers.
    controller.spin_until(lambda: controller.stamps(Topic.COMMAND)[-1:] == [tick])
    return controller.situation


def test_another_trip_is_told_for_three_ticks(controller: NodeBench) -> None:
    """A plant that was restarted or reset in the middle of a trip begins at 0 again."""
    well = (Level.OK, "optimal plans")
    assert [situation_at(controller, tick) for tick in (500, 501)] == [well, well]
    situations = [situation_at(controller, tick) for tick in range(5)]
    assert situations == [(Level.WARN, "another trip has begun")] * 3 + [well, well]


def test_the_burst_of_a_stranger_fits_into_the_queues(controller: NodeBench) -> None:
    """Twenty foreign odometries overran the ten messages that a subscription kept."""
    depths = {
        subscription.topic_name: subscription.qos_profile.depth
        for subscription in controller.node.subscriptions
    }
    for topic in STATE_TOPICS:
        assert depths[f"/{topic.value}"] >= LEAST_HISTORY
