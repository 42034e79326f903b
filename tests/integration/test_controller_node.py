"""The controller node: what it answers, what it waits for, and what it reports."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import reduce
from typing import Any
from unittest import mock

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from tests.integration.controller_ticks import (
    LINK,
    ROAD,
    SMALL,
    WELL,
    as_measured,
    assert_hears,
    await_answer,
    tick_messages,
)
from tests.integration.node_bench import NodeBench, S, node_bench
from tests.table_messages import encode_leader_preview

from iptm_controller.controller import MpcController
from iptm_controller.node import ControllerNode
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.node_reports import plan_trajectory
from iptm_controller.node_ticks import read_measurements
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.settings import MOST_PREVIEW_STEPS
from iptm_core.state import LeaderPreview, PackReading, SlopePreview
from iptm_ros.codecs import decode_decision_record, decode_plan, encode_slope
from iptm_ros.diagnostics import Level
from iptm_ros.topics import Topic

pytestmark = pytest.mark.usefixtures("ros_environment")


def pure_controller() -> MpcController:
    return ControllerNodeParameters(**SMALL).build_controller()


def newest_record(controller: NodeBench) -> Any:
    return decode_decision_record(controller.received[Topic.SOLVE][-1])


def test_answers_every_tick_as_the_pure_controller_would(fresh: NodeBench) -> None:
    # The road comes once, and maybe after the first state: it is not taken for flat too soon.
    fresh.hear(tick_messages(0.0))
    assert not fresh.received[Topic.COMMAND]
    fresh.hear({Topic.SLOPE: encode_slope(ROAD)})
    pure = pure_controller()
    decision = pure.decide(as_measured(tick_messages(0.0)))
    assert await_answer(fresh, 0) == decision.command
    for tick in range(1, 12):
        messages = tick_messages(float(tick), leader_acceleration_m_s2=0.1 * (tick - 6))
        # The order of arrival does not matter: the state first, last, or in between.
        first = ([], LINK, LINK[:1])[tick % 3]
        fresh.hear(messages, *first, *(topic for topic in messages if topic not in first))
        decision = pure.decide(as_measured(messages))
        assert await_answer(fresh, tick) == decision.command
    assert decision.plan is not None
    assert decision.result is not None
    stamp_ns, plan = decode_plan(fresh.received[Topic.PLAN][-1])
    assert stamp_ns == 11 * S
    for name, values in vars(plan_trajectory(decision.plan)).items():
        np.testing.assert_allclose(getattr(plan, name), values, rtol=0.0, atol=1e-9, err_msg=name)
    record = newest_record(fresh)
    assert record.rung == Rung.OPTIMAL
    assert record.objective == decision.result.objective
    assert record.iterations == decision.result.iterations
    fresh.spin_until(lambda: fresh.values["ticks_optimal"] == "12")
    assert fresh.values["preview"] == "full"


def test_the_state_holds_what_is_measured_of_the_pack() -> None:
    state = tick_messages(0.0)[Topic.PLANT_STATE]
    measured = read_measurements({Topic.PLANT_STATE: state}, ROAD)
    assert measured.pack == PackReading(300.0, 301.0, 9.5e3)
    assert read_measurements({}, ROAD).pack is None


def test_a_preview_larger_than_a_car_needs_is_refused_undecoded(fresh: NodeBench) -> None:
    longest, longer = (foreseen(MOST_PREVIEW_STEPS + more) for more in (1, 30))
    fresh.hear({Topic.SLOPE: encode_slope(ROAD)})
    before = int(fresh.values["refused_messages"])
    with mock.patch("iptm_ros.suite_node.deserialize_message") as decode:
        fresh.hear({Topic.LEADER_PREVIEW: longer})
    decode.assert_not_called()
    fresh.hear({**tick_messages(0.0), Topic.LEADER_PREVIEW: longest})
    await_answer(fresh, 0)
    fresh.spin_until(lambda: int(fresh.values["refused_messages"]) == before + 1)
    assert fresh.values["last_refused_message"].startswith("v2x/leader_preview: 17")


def foreseen(nodes: int) -> PointCloud2:
    """A preview with bounds, from the present on."""
    times_s = np.arange(float(nodes))
    preview = LeaderPreview(times_s, 245.0 + 16.0 * times_s, np.full(nodes, 16.0), times_s)
    return encode_leader_preview(preview, 0)


def test_a_malformed_road_is_taken_as_flat_and_reported(fresh: NodeBench) -> None:
    broken = encode_slope(ROAD)
    broken.data[5] = math.nan
    fresh.hear({Topic.SLOPE: broken})
    messages = tick_messages(0.0)
    fresh.hear(messages)
    flat = SlopePreview(np.zeros(1), np.zeros(1))
    assert await_answer(fresh, 0) == pure_controller().decide(as_measured(messages, flat)).command
    fault = (Level.WARN, "slope message malformed, road taken as flat")
    fresh.spin_until(lambda: fresh.situation == fault)


def test_what_does_not_arrive_is_named_and_done_without() -> None:
    """Ticks of one trip, each with something missing, answered when the time is up."""
    with node_bench(ControllerNode, **{**SMALL, "input_timeout_s": 0.5}) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        pure = pure_controller()

        def tick(time_s: int, *topics: Topic, **left_out: Any) -> None:
            """Send some topics of a tick; the answer is that of the pure controller without the rest."""
            messages = tick_messages(float(time_s))
            bench.hear(messages, *topics)
            measured = replace(as_measured(messages), **left_out)
            assert await_answer(bench, time_s) == pure.decide(measured).command

        def await_values(**expected: str) -> None:
            bench.spin_until(lambda: expected.items() <= bench.values.items())

        nothing = LeaderPreview.empty()
        no_leader = "no measurement of the leader received"
        tick(0, Topic.PLANT_STATE, leader=None, preview=nothing, fault=no_leader)
        record = newest_record(bench)
        assert (record.rung, record.status) == (Rung.STOP, SolveStatus.NOT_POSED)
        assert math.isnan(record.objective)
        await_values(reason=no_leader, solves_not_posed="1")

        no_state = "no plant/state received"
        tick(1, *LINK, state=None, fault=no_state)
        await_values(reason=no_state)

        # Neither a missing nor a malformed preview stops the optimisation.
        tick(2, Topic.PLANT_STATE, Topic.LEADER, preview=nothing)
        await_values(rung="optimal", preview="missing", preview_age_s="nan")
        messages = tick_messages(3.0)
        messages[Topic.LEADER_PREVIEW].width += 1
        bench.hear(messages)
        await_answer(bench, 3)
        await_values(rung="optimal", preview="missing")

        # A preview alone is no tick to answer; it is kept.
        bench.hear(tick_messages(4.0), Topic.LEADER_PREVIEW)
        reports = len(bench.reasons())
        bench.spin_until(lambda: len(bench.reasons()) >= reports + 2)
        assert len(bench.received[Topic.COMMAND]) == 4
        bench.hear(tick_messages(4.0), Topic.PLANT_STATE, Topic.LEADER)
        await_answer(bench, 4)
        await_values(rung="optimal", reason="none", preview="full")


def test_inputs_are_waited_for_in_trip_time_too() -> None:
    """At ten times real time a bridge that is gone must not cost the plant its controller."""
    with node_bench(ControllerNode, **{**SMALL, "input_timeout_s": 6.0}) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        bench.hear(tick_messages(0.0))
        for tick in range(3, 30, 3):
            bench.hear(tick_messages(float(tick)), Topic.PLANT_STATE)
            pause_s = time.monotonic() + 0.03
            bench.spin_until(lambda pause_s=pause_s: time.monotonic() > pause_s)
        assert bench.stamps(Topic.COMMAND) == [0, 9, 18, 27]


@pytest.mark.parametrize(
    ("topic", "field", "value", "complaint", "rung"),
    [
        (Topic.PLANT_STATE, "position.1", math.nan, "plant/state: speed_m_s is nan", Rung.STOP),
        (Topic.PLANT_STATE, "position.4", math.nan, "a cell temperature is not", Rung.OPTIMAL),
        (Topic.PLANT_STATE, "name.0", "a", "plant/state: missing position_m", Rung.STOP),
        (Topic.PLANT_STATE, "position.6", -0.1, "a value of the pack is not", Rung.OPTIMAL),
        (Topic.PLANT_STATE, "position.5", 423.15, "a cell temperature is not", Rung.OPTIMAL),
        (Topic.LEADER, "pose.pose.position.x", math.nan, "v2x/leader", Rung.SHIFTED_PLAN),
    ],
)
def test_malformed_messages_are_answered_and_named_and_forgotten(
    driving: NodeBench, topic: Topic, field: str, value: object, complaint: str, rung: Rung
) -> None:
    messages = tick_messages(503.0)
    *parents, name = field.split(".")
    holder = reduce(getattr, parents, messages[topic])
    if name.isdecimal():
        holder[int(name)] = value
    else:
        setattr(holder, name, value)
    driving.hear(messages)
    assert math.isfinite(await_answer(driving, 503).acceleration_m_s2)
    assert newest_record(driving).rung == rung
    driving.spin_until(
        lambda: complaint in driving.values["reason"] or complaint in str(driving.reasons())
    )
    driving.hear(tick_messages(504.0))
    await_answer(driving, 504)
    assert newest_record(driving).rung == Rung.OPTIMAL


def test_a_new_trip_is_reported_for_three_ticks_and_late_messages_are_counted(
    driving: NodeBench,
) -> None:
    """A plant that was restarted or reset in the middle of a trip begins at 0 again."""
    situations = []
    for tick in range(5):
        driving.hear(tick_messages(float(tick)))
        await_answer(driving, tick)
        situations.append(driving.situation)
    assert situations == [(Level.WARN, "another trip has begun")] * 3 + [WELL, WELL]
    assert_hears(driving, 8)
    answered = driving.stamps(Topic.COMMAND)
    driving.hear(tick_messages(4.0))
    driving.spin_until(lambda: driving.values["late_messages"] == "3")
    assert driving.stamps(Topic.COMMAND) == answered


def test_a_burst_of_foreign_messages_fits_into_the_queues(fresh: NodeBench) -> None:
    """Twenty foreign states overran the ten messages that a subscription kept."""
    depths = {each.topic_name: each.qos_profile.depth for each in fresh.node.subscriptions}
    assert depths["/plant/state"] == 100


def test_the_published_friction_of_the_road_counts_instead_of_the_setting() -> None:
    """On a wet road the controller keeps a longer gap; nonsense is refused, a new value counts at once."""
    with node_bench(ControllerNode, **SMALL) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        commands = []
        for tick, friction in enumerate((0.0, 0.35, math.nan, 1.5, 0.0)):
            bench.hear({Topic.ROAD_FRICTION: Float64(data=friction)})
            # Braking already, so that no bound of the jerk hides what the friction changes.
            bench.hear(tick_messages(float(tick), acceleration_m_s2=-0.35))
            commands.append(await_answer(bench, tick))
            bench.spin_until(lambda: "road_friction" in bench.values)
            expected = 0.35 if tick in {1, 2, 3} else 0.0
            assert bench.node._friction.coefficient == expected  # type: ignore[attr-defined]
        assert commands[1].acceleration_m_s2 < commands[0].acceleration_m_s2 - 0.005
        assert commands[4].acceleration_m_s2 > commands[3].acceleration_m_s2 + 0.005
        bench.spin_until(lambda: bench.values["refused_messages"] == "2")
