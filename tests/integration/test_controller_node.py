"""The controller as a process of its own: what it answers, what it waits for, how it fails and stops."""

from __future__ import annotations

import math
import signal
from dataclasses import replace
from functools import reduce
from itertools import groupby
from typing import Any

import numpy as np
import pytest
from tests.integration.controller_ticks import (
    LINK,
    ROAD,
    SMALL,
    S,
    as_measured,
    tick_messages,
)

from iptm_controller.controller import Controller
from iptm_controller.horizon import Horizon
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.node_reports import plan_trajectory
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.state import LeaderPreview, SlopePreview
from iptm_interfaces.codecs import (
    decode_command,
    decode_decision_record,
    decode_plan,
    encode_slope,
    ns_from_time,
)
from iptm_interfaces.diagnostics import Level, status_values
from iptm_interfaces.topics import STATE_TOPICS, Topic

MODULE = "iptm_controller.node"
ANSWERS = (
    Topic.COMMAND,
    Topic.SOLVE,
    Topic.PLAN,
    Topic.ACCELERATION_COMMAND,
    Topic.COMPRESSOR_POWER_COMMAND,
)


class World:
    """Scripted plant and bridge, and all messages of the controller."""

    def __init__(self, peer: Any) -> None:
        self.peer = peer
        self.heard: dict[Topic, list[Any]] = {topic: [] for topic in ANSWERS}
        self.statuses = peer.statuses("/controller")
        node = peer.node
        self.publishers = {
            topic: node.advertise(topic) for topic in (*STATE_TOPICS, *LINK, Topic.SLOPE)
        }
        for topic in self.heard:
            node.listen(topic, self.heard[topic].append)

    def wait_for_controller(self) -> None:
        self.peer.wait_until(
            lambda: all(p.get_subscription_count() == 1 for p in self.publishers.values())
            and all(self.peer.node.count_publishers(sub.topic_name) >= 1
                    for sub in self.peer.node.subscriptions if "controller" in sub.topic_name)
            and self.statuses,
            60.0,
            "the controller in the graph",
        )  # fmt: skip

    def tell_road(self, road: SlopePreview = ROAD) -> None:
        self.publishers[Topic.SLOPE].publish(encode_slope(road))

    def publish(self, messages: dict[Topic, Any], *topics: Topic) -> None:
        for topic in topics or messages:
            self.publishers[topic].publish(messages[topic])

    def wait_for_answer(self, time_s: float) -> Any:
        """Wait for the command of a stamp and return it."""
        stamp_ns = round(time_s * S)

        def found() -> list[Any]:
            commands = (decode_command(message) for message in self.heard[Topic.COMMAND])
            return [command for stamp, command in commands if stamp == stamp_ns]

        self.peer.wait_until(found, what=f"the answer to {time_s} s")
        return found()[0]

    def wait_for_record(self, time_s: float) -> Any:
        """Wait for the record of the decision of a stamp and return it."""
        stamp_ns = round(time_s * S)

        def found() -> list[Any]:
            return [
                decode_decision_record(message)
                for message in self.heard[Topic.SOLVE]
                if ns_from_time(message.header.stamp) == stamp_ns
            ]

        self.peer.wait_until(found, what=f"the record of {time_s} s")
        return found()[-1]

    def wait_for_reports(self, number: int) -> None:
        wanted = len(self.statuses) + number
        self.peer.wait_until(lambda: len(self.statuses) >= wanted, what="further reports")

    def details(self) -> dict[str, str]:
        """Key values of the newest diagnostics."""
        return status_values(self.statuses[-1])

    def wait_for_details(self, **expected: str) -> None:
        self.peer.wait_until(
            lambda: expected.items() <= self.details().items(), what=f"diagnostics {expected}"
        )


@pytest.fixture
def world(peer: Any) -> World:
    return World(peer)


def start(launcher: Any, world: World, **parameters: object) -> Any:
    process = launcher.start_node(MODULE, parameters={**SMALL, **parameters})
    world.wait_for_controller()
    return process


def pure_controller() -> Controller:
    return ControllerNodeParameters(horizon=str(SMALL["horizon"])).build_controller()


def test_answers_every_tick_as_the_pure_controller_would(launcher: Any, world: World) -> None:
    process = start(launcher, world)
    # The road comes once, and maybe after the first state: it is not taken for flat too soon.
    world.publish(tick_messages(0.0))
    world.wait_for_reports(2)
    assert not world.heard[Topic.COMMAND]
    world.tell_road()
    pure = pure_controller()
    decision = pure.decide(as_measured(tick_messages(0.0)))
    assert world.wait_for_answer(0.0) == decision.command
    for tick in range(1, 12):
        messages = tick_messages(float(tick), leader_acceleration_m_s2=0.1 * (tick - 6))
        # The order of arrival does not matter: all at once, the link first, the odometry last.
        first = ([], LINK, STATE_TOPICS[1:])[tick % 3]
        world.publish(messages, *first, *(topic for topic in messages if topic not in first))
        decision = pure.decide(as_measured(messages))
        assert world.wait_for_answer(float(tick)) == decision.command
    assert decision.plan is not None
    assert decision.result is not None
    world.peer.wait_until(
        lambda: all(len(world.heard[topic]) == 12 for topic in ANSWERS), what="all answers"
    )
    stamp_ns, plan = decode_plan(world.heard[Topic.PLAN][-1])
    assert stamp_ns == 11 * S
    expected = plan_trajectory(decision.plan)
    for name, values in vars(expected).items():
        np.testing.assert_allclose(getattr(plan, name), values, rtol=0.0, atol=1e-9, err_msg=name)
    assert plan.times_s.size == Horizon.parse(str(SMALL["horizon"])).steps + 1
    record = world.wait_for_record(11.0)
    assert record.rung == Rung.OPTIMAL
    assert record.objective == decision.result.objective
    assert record.iterations == decision.result.iterations
    acceleration = world.heard[Topic.ACCELERATION_COMMAND][-1].data
    power = world.heard[Topic.COMPRESSOR_POWER_COMMAND][-1].data
    assert acceleration == decision.command.acceleration_m_s2
    assert power == decision.command.compressor_power_w
    world.wait_for_details(ticks_optimal="12", rung="optimal", preview="full")
    assert world.details()["machine_code"] == str(pure.backend.compiled).lower()
    assert process.stop(signal.SIGINT) == 0


def test_a_malformed_road_is_taken_as_flat_and_reported(launcher: Any, world: World) -> None:
    start(launcher, world)
    broken = encode_slope(ROAD)
    broken.data[5] = math.nan
    world.publishers[Topic.SLOPE].publish(broken)
    messages = tick_messages(0.0)
    world.publish(messages)
    flat = SlopePreview(np.zeros(1), np.zeros(1))
    expected = pure_controller().decide(as_measured(messages, flat)).command
    assert world.wait_for_answer(0.0) == expected
    fault = (Level.WARN, "slope message malformed, road taken as flat")
    world.peer.wait_until(
        lambda: fault in [(Level(status.level), status.message) for status in world.statuses],
        what="the fault reported",
    )


def test_what_does_not_arrive_is_named_and_done_without(launcher: Any, world: World) -> None:
    """Ticks of one trip, each with something missing, answered when the time is up."""
    start(launcher, world, input_timeout_s=0.5)
    world.tell_road()
    pure = pure_controller()

    def tick(time_s: float, *topics: Topic, **left_out: Any) -> None:
        """Publish some topics of a tick; the answer is that of the pure controller without the rest."""
        messages = tick_messages(time_s)
        world.publish(messages, *topics)
        measured = replace(as_measured(messages), **left_out)
        assert world.wait_for_answer(time_s) == pure.decide(measured).command

    nothing = LeaderPreview.empty()
    no_leader = "no measurement of the leader received"
    tick(0.0, *STATE_TOPICS, leader=None, preview=nothing, fault=no_leader)
    record = world.wait_for_record(0.0)
    assert record.rung == Rung.STOP
    assert record.status == SolveStatus.NOT_POSED
    assert math.isnan(record.objective)
    world.wait_for_details(reason=no_leader, solves_not_posed="1")

    absent = ", ".join(topic.value for topic in STATE_TOPICS[3:])
    no_state = f"no {absent} received"
    tick(1.0, *STATE_TOPICS[:3], Topic.LEADER, state=None, preview=nothing, fault=no_state)
    world.wait_for_details(reason=no_state)

    # Neither a missing nor a malformed preview stops the optimisation.
    tick(2.0, *STATE_TOPICS, Topic.LEADER, preview=nothing)
    world.wait_for_details(rung="optimal", preview="missing", preview_age_s="nan")
    messages = tick_messages(3.0)
    messages[Topic.LEADER_PREVIEW].points[3].velocities = [-1.0]
    world.publish(messages)
    world.wait_for_answer(3.0)
    world.wait_for_details(rung="optimal", preview="missing")

    # There is no tick to answer without a state; earlier messages of the bridge are kept.
    world.publish(tick_messages(4.0), *LINK)
    world.wait_for_reports(2)
    assert len(world.heard[Topic.COMMAND]) == 4
    world.publish(tick_messages(4.0), *STATE_TOPICS)
    world.wait_for_answer(4.0)
    world.wait_for_details(rung="optimal", reason="none", preview="full")


MALFORMED: list[tuple[Topic, str, object, str, Rung]] = [
    (Topic.PLANT_ODOMETRY, "twist.twist.linear.x", math.nan, "plant/odometry", Rung.STOP),
    (Topic.PLANT_CELL_1_TEMPERATURE, "temperature", math.nan, "cell_1_temperature", Rung.STOP),
    (Topic.PLANT_POWERS, "name", ["a", "b", "c", "d", "e"], "plant/powers", Rung.STOP),
    (Topic.PLANT_CAPACITY_LOSS, "position", [-0.1, 1e-3], "plant/capacity_loss", Rung.STOP),
    (
        Topic.PLANT_CELL_N_TEMPERATURE,
        "temperature",
        150.0,
        "cell_n_temperature_k",
        Rung.SHIFTED_PLAN,
    ),
    (Topic.LEADER, "pose.pose.position.x", math.nan, "v2x/leader", Rung.SHIFTED_PLAN),
]


def test_malformed_messages_are_answered_and_named_and_forgotten(
    launcher: Any, world: World
) -> None:
    process = start(launcher, world)
    world.tell_road()
    for row, (topic, field, value, complaint, rung) in enumerate(MALFORMED):
        time_s = 2.0 * row
        world.publish(tick_messages(time_s))
        world.wait_for_answer(time_s)
        assert world.wait_for_record(time_s).rung == Rung.OPTIMAL
        messages = tick_messages(time_s + 1.0)
        *parents, name = field.split(".")
        setattr(reduce(getattr, parents, messages[topic]), name, value)
        world.publish(messages)
        command = world.wait_for_answer(time_s + 1.0)
        assert math.isfinite(command.acceleration_m_s2)
        assert world.wait_for_record(time_s + 1.0).rung == rung, complaint
        world.peer.wait_until(
            lambda complaint=complaint: complaint in world.details().get("reason", ""),
            what=f"'{complaint}' in the diagnostics",
        )
    assert process.is_running
    assert "Traceback" not in process.stderr


def test_new_trips_and_repeated_messages(launcher: Any, world: World) -> None:
    """A new trip is answered by the same process; what comes late or again is counted, not answered."""
    process = start(launcher, world)
    world.tell_road()
    for time_s in (500.0, 501.0, 0.0, 5.0, 6.0):
        world.publish(tick_messages(time_s))
        world.wait_for_answer(time_s)
        assert world.wait_for_record(time_s).rung == Rung.OPTIMAL
    world.publish(tick_messages(5.0))
    world.wait_for_details(late_messages="8")
    assert len(world.heard[Topic.COMMAND]) == 5
    assert process.stop(signal.SIGTERM) == 0


def test_a_limit_broken_for_long_is_a_warning_once(launcher: Any, world: World) -> None:
    start(launcher, world, temperature_warning_s=2.5)
    world.tell_road()

    def tick(time_s: float, cell_k: float) -> None:
        world.publish(tick_messages(time_s, cell_n_temperature_k=cell_k))
        world.wait_for_answer(time_s)

    well = (Level.OK, "optimal plans")
    broken = (Level.WARN, "plans break limits of temperature")
    hot = (Level.WARN, f"{broken[1]}, cell above its highest temperature for long")

    def status_reports() -> list[tuple[Level, str]]:
        """Every situation reported since the first answer, repetitions left out."""
        states = [(Level(status.level), status.message) for status in world.statuses]
        return [state for state, _ in groupby(states[states.index(broken) :])]

    for time_s in range(5):
        tick(float(time_s), 320.0)
    for time_s in range(5, 8):
        tick(float(time_s), 308.5)
    world.wait_for_details(cell_above_limit_s="0", ticks_optimal="8")
    assert status_reports() == [broken, hot, well]
