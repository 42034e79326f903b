"""The controller as a process of its own: what it answers, what it waits for, how it fails and stops."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from iptm_controller.controller import Controller, Decision, Measurements
from iptm_controller.horizon import Horizon
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.node_reports import plan_trajectory
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.state import IntervalPowers, LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_interfaces.codecs import (
    decode_command,
    decode_decision_record,
    decode_leader,
    decode_leader_preview,
    decode_plan,
    decode_vehicle_state,
    empty_leader_preview,
    encode_acceleration,
    encode_capacity_loss,
    encode_host_odometry,
    encode_leader,
    encode_leader_preview,
    encode_powers,
    encode_slope,
    encode_temperature,
    ns_from_time,
)
from iptm_interfaces.diagnostics import Level, find_status, level_of, status_values
from iptm_interfaces.topics import Topic

MODULE = "iptm_controller.node"
S = 1_000_000_000
ROAD = SlopePreview(np.arange(0.0, 3000.0, 10.0), 0.04 * np.sin(np.arange(300) / 9.0))
STATE = (
    Topic.PLANT_ODOMETRY,
    Topic.PLANT_ACCELERATION,
    Topic.PLANT_CELL_1_TEMPERATURE,
    Topic.PLANT_CELL_N_TEMPERATURE,
    Topic.PLANT_POWERS,
    Topic.PLANT_CAPACITY_LOSS,
)
LINK = (Topic.LEADER, Topic.LEADER_PREVIEW)
ANSWERS = (
    Topic.COMMAND,
    Topic.SOLVE,
    Topic.PLAN,
    Topic.ACCELERATION_COMMAND,
    Topic.COMPRESSOR_POWER_COMMAND,
)
SMALL: dict[str, object] = {"horizon": "2x1+2x5", "input_timeout_s": 60.0}
"""A small problem, and no time limit that a busy machine could break; tests of the limit set their own."""


@pytest.fixture(scope="module", autouse=True)
def compile_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IPTM_CACHE_DIR", str(tmp_path_factory.mktemp("compiled")))
        yield


def tick_messages(
    time_s: float, leader_acceleration_m_s2: float = -0.3, **changes: float
) -> dict[Topic, Any]:
    """Everything that plant and bridge say at one tick."""
    state = replace(
        VehicleState(time_s, 200.0 + 15.0 * time_s, 15.0, 0.1, 300.0, 307.0, 308.5, 1e-3, 1e-3),
        **changes,
    )
    ahead = np.arange(61.0)
    speeds = np.maximum(16.0 + leader_acceleration_m_s2 * ahead, 0.0)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    leader = LeaderState(time_s, state.position_m + 45.0, 16.0)
    preview = LeaderPreview(time_s, time_s + ahead, leader.position_m + moved, speeds)
    powers = IntervalPowers(9e3, state.compressor_power_w, 200.0, 9.5e3, 100.0)
    return {
        Topic.PLANT_ODOMETRY: encode_host_odometry(state),
        Topic.PLANT_ACCELERATION: encode_acceleration(state),
        Topic.PLANT_CELL_1_TEMPERATURE: encode_temperature(time_s, state.cell_1_temperature_k),
        Topic.PLANT_CELL_N_TEMPERATURE: encode_temperature(time_s, state.cell_n_temperature_k),
        Topic.PLANT_POWERS: encode_powers(time_s, powers),
        Topic.PLANT_CAPACITY_LOSS: encode_capacity_loss(state),
        Topic.LEADER: encode_leader(leader),
        Topic.LEADER_PREVIEW: encode_leader_preview(preview, round(time_s * S)),
    }


def as_measured(messages: dict[Topic, Any], road: SlopePreview = ROAD) -> Measurements:
    """What the node makes of them."""
    return Measurements(
        decode_vehicle_state(messages),
        decode_leader(messages[Topic.LEADER]),
        decode_leader_preview(messages[Topic.LEADER_PREVIEW])[1],
        road,
    )


class World:
    """Plant and bridge as a script, and all that the controller says."""

    def __init__(self, peer: Any) -> None:
        self.peer = peer
        self.heard: dict[Topic, list[Any]] = {topic: [] for topic in (*ANSWERS, Topic.DIAGNOSTICS)}
        self.order: list[Topic] = []
        node = peer.node
        self.publishers = {topic: node.advertise(topic) for topic in (*STATE, *LINK, Topic.SLOPE)}
        for topic in self.heard:
            node.listen(topic, lambda message, topic=topic: self._on(topic, message))

    def _on(self, topic: Topic, message: Any) -> None:
        self.heard[topic].append(message)
        self.order.append(topic)

    def wait_for_controller(self) -> None:
        self.peer.wait_until(
            lambda: all(p.get_subscription_count() == 1 for p in self.publishers.values())
            and all(self.peer.node.count_publishers(sub.topic_name) >= 1
                    for sub in self.peer.node.subscriptions if "controller" in sub.topic_name)
            and self.heard[Topic.DIAGNOSTICS],
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

    def wait_for_report(self, time_s: float) -> Any:
        """Wait for the report on the command of a stamp and return it."""
        stamp_ns = round(time_s * S)

        def found() -> list[Any]:
            return [
                decode_decision_record(message)
                for message in self.heard[Topic.SOLVE]
                if ns_from_time(message.header.stamp) == stamp_ns
            ]

        self.peer.wait_until(found, what=f"the report on {time_s} s")
        return found()[-1]

    def situations(self) -> list[tuple[Level, str]]:
        found = [find_status(message, "/controller") for message in self.heard[Topic.DIAGNOSTICS]]
        return [(level_of(status), status.message) for status in found if status is not None]

    def details(self) -> dict[str, str]:
        """Key values of the newest diagnostics."""
        status = find_status(self.heard[Topic.DIAGNOSTICS][-1], "/controller")
        assert status is not None
        return status_values(status)

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
    world.tell_road()
    pure = pure_controller()
    decision: Decision | None = None
    for tick in range(12):
        messages = tick_messages(float(tick), leader_acceleration_m_s2=0.1 * (tick - 6))
        world.publish(messages)
        decision = pure.decide(as_measured(messages))
        assert world.wait_for_answer(float(tick)) == decision.command
    assert decision is not None
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
    report = world.wait_for_report(11.0)
    assert report.rung == Rung.OPTIMAL
    assert report.objective == decision.result.objective
    assert report.iterations == decision.result.iterations
    acceleration = world.heard[Topic.ACCELERATION_COMMAND][-1].data
    power = world.heard[Topic.COMPRESSOR_POWER_COMMAND][-1].data
    assert acceleration == decision.command.acceleration_m_s2
    assert power == decision.command.compressor_power_w
    world.wait_for_details(ticks_optimal="12", rung="optimal", preview="full")
    assert world.details()["machine_code"] == str(pure.backend.compiled).lower()
    assert process.stop(signal.SIGINT) == 0
    assert "Traceback" not in process.stderr


@pytest.mark.parametrize("order", ["link first", "odometry last"])
def test_order_of_arrival_does_not_matter(launcher: Any, world: World, order: str) -> None:
    start(launcher, world)
    world.tell_road()
    messages = tick_messages(0.0)
    topics = [*LINK, *STATE] if order == "link first" else [*reversed(STATE), *LINK]
    world.publish(messages, *topics[1:], topics[0])
    expected = pure_controller().decide(as_measured(messages)).command
    assert world.wait_for_answer(0.0) == expected


def test_waits_for_the_road_before_its_first_answer(launcher: Any, world: World) -> None:
    """The road comes once, and maybe after the first state: it is not taken for flat too soon."""
    start(launcher, world)
    messages = tick_messages(0.0)
    world.publish(messages)
    heard = len(world.heard[Topic.DIAGNOSTICS])
    world.peer.wait_until(
        lambda: len(world.heard[Topic.DIAGNOSTICS]) >= heard + 2, what="two more reports"
    )
    assert not world.heard[Topic.COMMAND]
    world.tell_road()
    expected = pure_controller().decide(as_measured(messages)).command
    assert world.wait_for_answer(0.0) == expected


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
    world.peer.wait_until(
        lambda: (Level.WARN, "slope message malformed, road taken as flat") in world.situations(),
        what="the fault reported",
    )


def test_a_missing_leader_is_answered_when_the_time_is_up(launcher: Any, world: World) -> None:
    start(launcher, world, input_timeout_s=0.5)
    world.tell_road()
    messages = tick_messages(0.0)
    world.publish(messages, *STATE)
    command = world.wait_for_answer(0.0)
    assert command.acceleration_m_s2 <= 0.1
    report = world.wait_for_report(0.0)
    assert report.rung == Rung.STOP
    assert report.status is SolveStatus.NOT_POSED
    assert math.isnan(report.objective)
    world.wait_for_details(reason="no measurement of the leader received", solves_not_posed="1")
    # The next complete tick is an ordinary one.
    following = tick_messages(1.0)
    world.publish(following)
    world.wait_for_answer(1.0)
    world.wait_for_details(rung="optimal", reason="none")


def test_a_missing_part_of_the_state_is_named(launcher: Any, world: World) -> None:
    start(launcher, world, input_timeout_s=0.5)
    world.tell_road()
    messages = tick_messages(0.0)
    world.publish(messages, *STATE[:3], *LINK)
    command = world.wait_for_answer(0.0)
    assert vars(command) == {"acceleration_m_s2": 0.0, "compressor_power_w": 0.0}
    world.wait_for_details(reason="no cell_n_temperature, powers, capacity_loss received")


def test_a_missing_preview_is_no_reason_to_stop_optimising(launcher: Any, world: World) -> None:
    start(launcher, world, input_timeout_s=0.5)
    world.tell_road()
    messages = tick_messages(0.0)
    world.publish(messages, *STATE, Topic.LEADER)
    measured = replace(as_measured(messages), preview=empty_leader_preview())
    assert world.wait_for_answer(0.0) == pure_controller().decide(measured).command
    world.wait_for_details(rung="optimal", preview="missing", preview_age_s="nan")


def test_a_leader_ahead_of_its_state_is_kept(launcher: Any, world: World) -> None:
    """There is no tick to answer without a state; what the bridge said before is not thrown away."""
    start(launcher, world, input_timeout_s=0.05)
    world.tell_road()
    messages = tick_messages(0.0)
    world.publish(messages, *LINK)
    heard = len(world.heard[Topic.DIAGNOSTICS])
    world.peer.wait_until(
        lambda: len(world.heard[Topic.DIAGNOSTICS]) >= heard + 2, what="two more reports"
    )
    assert not world.heard[Topic.COMMAND]
    world.publish(messages, *STATE)
    world.wait_for_answer(0.0)


def nan_speed(messages: dict[Topic, Any]) -> None:
    messages[Topic.PLANT_ODOMETRY].twist.twist.linear.x = math.nan


def nan_temperature(messages: dict[Topic, Any]) -> None:
    messages[Topic.PLANT_CELL_1_TEMPERATURE].temperature = math.nan


def wrong_names(messages: dict[Topic, Any]) -> None:
    messages[Topic.PLANT_POWERS].name = ["a", "b", "c", "d", "e"]


def negative_loss(messages: dict[Topic, Any]) -> None:
    messages[Topic.PLANT_CAPACITY_LOSS].position[0] = -0.1


def hot_cell(messages: dict[Topic, Any]) -> None:
    messages[Topic.PLANT_CELL_N_TEMPERATURE].temperature = 150.0


def nan_leader(messages: dict[Topic, Any]) -> None:
    messages[Topic.LEADER].pose.pose.position.x = math.nan


MALFORMED = {
    nan_speed: ("plant/odometry", Rung.STOP),
    nan_temperature: ("plant/cell_1_temperature", Rung.STOP),
    wrong_names: ("plant/powers", Rung.STOP),
    negative_loss: ("plant/capacity_loss", Rung.STOP),
    hot_cell: ("measured cell_n_temperature_k", Rung.STOP),
    nan_leader: ("v2x/leader", Rung.SHIFTED_PLAN),
}


def test_malformed_messages_are_answered_and_named_and_forgotten(
    launcher: Any, world: World
) -> None:
    process = start(launcher, world)
    world.tell_road()
    time_s = 0.0
    for spoil, (complaint, rung) in MALFORMED.items():
        world.publish(tick_messages(time_s))
        world.wait_for_answer(time_s)
        assert world.wait_for_report(time_s).rung == Rung.OPTIMAL
        messages = tick_messages(time_s + 1.0)
        spoil(messages)
        world.publish(messages)
        command = world.wait_for_answer(time_s + 1.0)
        assert math.isfinite(command.acceleration_m_s2)
        assert world.wait_for_report(time_s + 1.0).rung == rung, spoil.__name__
        world.peer.wait_until(
            lambda complaint=complaint: complaint in world.details().get("reason", ""),
            what=f"'{complaint}' in the diagnostics",
        )
        time_s += 2.0
    assert process.is_running
    assert "Traceback" not in process.stderr


def test_a_malformed_preview_is_replaced_when_the_time_is_up(launcher: Any, world: World) -> None:
    start(launcher, world, input_timeout_s=0.5)
    world.tell_road()
    messages = tick_messages(0.0)
    messages[Topic.LEADER_PREVIEW].points[3].velocities = [-1.0]
    world.publish(messages)
    world.wait_for_answer(0.0)
    world.wait_for_details(rung="optimal", preview="missing")


def test_a_new_trip_is_answered_by_the_same_process(launcher: Any, world: World) -> None:
    start(launcher, world)
    world.tell_road()
    for time_s in (500.0, 501.0, 0.0, 1.0):
        world.publish(tick_messages(time_s))
        world.wait_for_answer(time_s)
        assert world.wait_for_report(time_s).rung == Rung.OPTIMAL


def test_late_and_repeated_messages_are_counted_and_not_answered_again(
    launcher: Any, world: World
) -> None:
    start(launcher, world)
    world.tell_road()
    for time_s in (5.0, 6.0):
        world.publish(tick_messages(time_s))
        world.wait_for_answer(time_s)
    world.publish(tick_messages(5.0))
    world.wait_for_details(late_messages="8")
    assert len(world.heard[Topic.COMMAND]) == 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stops_cleanly_even_when_the_signal_comes_twice(
    launcher: Any, world: World, number: signal.Signals
) -> None:
    process = start(launcher, world)
    process.send(number)
    process.send(number)
    assert process.wait() == 0
    assert "Traceback" not in process.stderr
