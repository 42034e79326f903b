"""A vehicle sends its plan by radio to the bridge of the one behind it, each on a clock of its own."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from tests.integration.cam_ego import BRIDGE, SENDER, Ego, free_port
from tests.plant_messages import plant_messages
from tests.table_messages import encode_plan

from iptm_core.decision_record import DecisionRecord, Rung
from iptm_core.state import VehicleState
from iptm_ros.codecs import (
    PlanTrajectory,
    encode_decision_record,
    time_from_s,
)
from iptm_ros.diagnostics import status_values
from iptm_ros.topics import TOPICS, Topic

NS = 10**9
TICKS = 9
NO_PLAN_AT = 6
"""The tick at which the vehicle ahead follows no plan."""
PLAN_S = np.array([0.0, 1.0, 2.0, 3.0, 8.0, 13.0, 18.0, 23.0, 28.0])
GAIN_M_S2 = 0.1
GAP_M = 15.0


class VehicleAhead:
    """Publishes as plant and controller of `car_1`: it gains speed, and plans to continue."""

    PUBLISHED = (Topic.CLOCK, Topic.PLANT_STATE, Topic.SOLVE, Topic.PLAN)

    def __init__(self, peer: Any, record: DecisionRecord) -> None:
        self._peer, self._record = peer, record
        self._publishers = {
            topic: peer.node.create_publisher(
                TOPICS[topic].message_type, f"/car_1/{TOPICS[topic].name}", TOPICS[topic].qos
            )
            for topic in self.PUBLISHED
        }

    def wait_for_listener(self) -> None:
        self._peer.wait_until(
            lambda: all(
                publisher.get_subscription_count() == 1
                for topic, publisher in self._publishers.items()
                if topic is not Topic.CLOCK
            ),
            what="the sender",
        )

    def tick(self, second: int) -> None:
        follows = second != NO_PLAN_AT
        place_m, speed_m_s = 0.5 * GAIN_M_S2 * second**2, GAIN_M_S2 * second
        state = VehicleState(float(second), place_m, speed_m_s, 0.0, 0.0, 298.0, 298.0, 0.0, 0.0)
        message = plant_messages(state)[Topic.PLANT_STATE]
        self._publishers[Topic.PLANT_STATE].publish(message)
        self._publishers[Topic.CLOCK].publish(Clock(clock=time_from_s(float(second))))
        times = second + PLAN_S
        flat = np.full(times.size, 298.0)
        places, speeds = 0.5 * GAIN_M_S2 * times**2, GAIN_M_S2 * times
        plan = PlanTrajectory(times, places, speeds, flat, flat, 0.0 * flat, 0.0 * flat)
        # The record first, and a plan that is not followed, too: neither is to be taken for the other.
        rung = Rung.OPTIMAL if follows else Rung.EMERGENCY_BRAKING
        self._publishers[Topic.SOLVE].publish(
            encode_decision_record(second * NS, replace(self._record, rung=rung))
        )
        self._publishers[Topic.PLAN].publish(encode_plan(plan, second * NS))


@pytest.fixture
def ego(peer: Any) -> Ego:
    return Ego(peer)


def test_the_vehicle_behind_knows_the_plan_of_the_one_ahead(
    launcher: Any, ego: Ego, decision_record: Callable[[int], DecisionRecord]
) -> None:
    """The one ahead has driven all of its ticks before the one behind begins."""
    port = free_port()
    bridge = launcher.start_node(BRIDGE, parameters={"leader_source": "cam", "cam_port": port})
    sender = launcher.start_node(
        SENDER,
        "-r",
        "__ns:=/car_1",
        parameters={"to_port": port, "sent_drive": "ego", "initial_gap_m": GAP_M},
    )
    ego.meet()  # so the bridge has its socket
    ahead = VehicleAhead(ego.peer, decision_record(0))
    statuses = ego.peer.statuses("/car_1/v2x_sender")
    ahead.wait_for_listener()
    for second in range(TICKS):
        ahead.tick(second)
    # All but the stretch before the trip: ten messages a second.
    ego.peer.wait_until(
        lambda: statuses and int(status_values(statuses[-1])["sent"]) >= 10 * (TICKS - 1),
        what="the messages of all ticks",
    )
    for second in range(TICKS):
        preview = ego.tick(float(second), 0.2 * second)
        times = preview.times_s
        # Without a followed plan, the last one sent holds as long as the leader keeps to it.
        told_s = second if second != NO_PLAN_AT else second - 1
        assert times[-1] == pytest.approx(told_s + 28.0, abs=1.0)
        behind_m = GAP_M + 0.5 * GAIN_M_S2 * times**2 - preview.positions_m
        assert behind_m.min() > -0.02
        assert behind_m.max() < 0.75
    values = ego.settled_values()
    assert values["leader_station"] == "4711"
    assert values["predictor"] == "received_path"
    assert values["lost_between_sender_and_bridge"] == "0"
    assert sender.stop(signal.SIGINT) == 0
    assert bridge.stop(signal.SIGINT) == 0
