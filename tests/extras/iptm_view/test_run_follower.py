"""From messages to the page: the numbers are those of the bag, in whatever order they arrive."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message, serialize_message
from tests.plant_messages import plant_messages
from tests.table_messages import encode_leader_preview, encode_plan

from iptm_core.errors import BagError
from iptm_core.metrics.constraints import GAP_TOLERANCE_M, gap_margins_m
from iptm_core.state import LeaderPreview, SafetyRecord, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_ros.codecs import (
    PlanTrajectory,
)
from iptm_ros.codecs.cdr import time_from_s
from iptm_ros.diagnostics import TRIP_TIME, Level
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.recording.trajectory_reader import read_decisions
from iptm_ros.topics import TOPICS, Topic, topic_of
from iptm_view.page_feed import Cursor, PageFeed
from iptm_view.page_row import PAGE_COLUMNS, plan_ahead
from iptm_view.run_facts import RunFacts, facts_of_nodes
from iptm_view.run_follower import RunFollower
from iptm_view.sources import BagSource

CELSIUS = 273.15
SPECS = {topic_of("/", topic): spec for topic, spec in TOPICS.items()}


def documents(feed: PageFeed) -> dict[str, Any]:
    """Everything sent to a browser: documents by kind, rows as arrays by column."""
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    found = {event.kind: json.loads(event.text) for event in events}
    table = np.array(found.get("rows", []), dtype=np.float64).reshape(-1, len(PAGE_COLUMNS))
    return {**found, "rows": dict(zip(PAGE_COLUMNS, table.T, strict=True))}


def shown(bag: Path) -> dict[str, Any]:
    feed = PageFeed()
    with BagSource(bag) as source:
        source.load(feed, source.facts)
    return documents(feed)


@pytest.fixture(scope="module")
def page(bag: Path) -> dict[str, Any]:
    return shown(bag)


def test_every_value_on_the_page_is_that_of_the_bag(
    page: dict[str, Any], driven: Trajectory, bag: Path
) -> None:
    rows, decisions = page["rows"], read_decisions(bag)
    parameters, _ = read_model_parameters(bag)
    expected = {
        **{name: getattr(driven, name) for name in PAGE_COLUMNS if hasattr(driven, name)},
        "min_gap_m": driven.gap_m - gap_margins_m(driven, parameters),
        "cell_n_temperature_c": driven.cell_n_temperature_k - CELSIUS,
        "cell_1_temperature_c": driven.cell_1_temperature_k - CELSIUS,
        "coolant_inlet_temperature_c": driven.coolant_inlet_temperature_k - CELSIUS,
        "coolant_outlet_temperature_c": driven.coolant_outlet_temperature_k - CELSIUS,
        "capacity_loss": driven.cell_1_capacity_loss + driven.cell_n_capacity_loss,
        "status_code": decisions.status,
        "solve_time_s": decisions.solve_time_s,
        "iterations": decisions.iterations,
        "fallback_rung": decisions.rung,
        "limiter_active": decisions.limiter_active,
        "preview_age_s": decisions.preview_age_s,
    }
    assert set(expected) == set(PAGE_COLUMNS)
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, rtol=1e-13, atol=1e-12, err_msg=name)


def test_limits_plan_road_and_trip_are_those_of_the_run(
    page: dict[str, Any], driven: Trajectory
) -> None:
    limits = page["facts"]["limits"]
    assert limits["max_gap_m"] == 120.0
    assert limits["max_temperature_c"] == pytest.approx(40.0)
    assert page["facts"]["title"].startswith("cycle us06, strategy aging_cost_to_go")
    assert limits["gap_tolerance_m"] == GAP_TOLERANCE_M
    assert page["facts"]["duration_s"] == 120.0
    # Each plan begins with the state that it answers, and looks ahead of it.
    assert [plan["time_s"][0] for plan in page["plans"]] == driven.time_s.tolist()
    plan = page["plans"][-1]
    assert plan["speed_m_s"][0] == pytest.approx(driven.speed_m_s[-1])
    assert plan["gap_m"][0] == pytest.approx(driven.gap_m[-1])
    assert plan["time_s"][-1] > 140.0
    road = page["road"]
    height_m = np.interp([0.0, 1500.0], road["position_m"], road["height_m"])
    assert height_m[0] == 0.0
    assert abs(height_m[1]) > 0.1
    assert page["end"]["ended"] is True
    assert {"/plant: vehicle", "/controller: optimal control"} <= {
        status["name"] for status in page["statuses"]["statuses"]
    }


def test_the_gap_ahead_ends_with_the_preview_and_the_smallest_is_less_by_its_bounds() -> None:
    times_s, flat = np.arange(5.0), np.full(5, 300.0)
    plan = PlanTrajectory(times_s, 10.0 * times_s, np.full(5, 10.0), flat, flat, flat, flat)
    known_s, bounds_m = times_s[:3], np.array([0.0, 1.0, 2.0])
    preview = LeaderPreview(known_s, 30.0 + 10.0 * known_s, np.full(3, 10.0), bounds_m)
    ahead = plan_ahead(
        {
            Topic.PLAN: bytes(serialize_message(encode_plan(plan, 0))),
            Topic.LEADER_PREVIEW: bytes(serialize_message(encode_leader_preview(preview, 0))),
        }
    )
    unknown = [np.nan, np.nan]
    np.testing.assert_allclose(ahead["gap_m"], [30.0, 30.0, 30.0, *unknown])
    np.testing.assert_allclose(ahead["smallest_gap_m"], [30.0, 29.0, 28.0, *unknown])


def test_order_and_duplicates_within_a_tick_do_not_matter(bag: Path, page: dict[str, Any]) -> None:
    generator = random.Random(7)  # noqa: S311
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    with BagReader(bag) as reader:
        messages = [(SPECS.get(raw.topic), raw) for raw in reader.raw_messages()]
    by_tick: dict[int, list[Any]] = {}
    for spec, raw in messages:
        by_tick.setdefault(raw.log_time_ns, []).append((spec, raw))
    for tick in sorted(by_tick):
        heard = by_tick[tick] + by_tick[tick][:3]
        generator.shuffle(heard)
        for spec, raw in heard:
            follower.take(spec.topic, raw.data)
        follower.show()
    rows = documents(feed)["rows"]
    for name in set(PAGE_COLUMNS) - {"min_gap_m"}:
        np.testing.assert_array_equal(rows[name], page["rows"][name], err_msg=name)


def test_a_fast_run_costs_no_more_than_it_shows(bag: Path) -> None:
    """What came between two looks is not decoded: only the newest ticks are shown."""
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    with BagReader(bag) as reader:
        for raw in reader.raw_messages():
            spec = SPECS.get(raw.topic)
            if spec is not None and raw.log_time_ns <= 40 * 10**9:
                follower.take(spec.topic, raw.data)
    assert follower.show(2) == 2
    assert documents(feed)["rows"]["time_s"].tolist() == [39.0, 40.0]
    assert follower.show(2) == 0


@pytest.mark.parametrize("lost_s", [{40, 41}, set(range(30, 60)), set(range(100, 121))])
def test_a_tick_without_a_command_counts(bag: Path, page: dict[str, Any], lost_s: set[int]) -> None:
    """The plant stops for want of commands; its rows match the bag, with a gap in the decisions."""
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    controller = {Topic.SOLVE, Topic.COMMAND, Topic.PLAN}
    with BagReader(bag) as reader:
        for raw in reader.raw_messages():
            spec = SPECS[raw.topic]
            lost = spec.topic in controller and raw.log_time_ns // 10**9 in lost_s
            if not lost:
                follower.take(spec.topic, raw.data)
            follower.show()
    follower.show(incomplete=True)
    rows = documents(feed)["rows"]
    undecided = {int(time_s) for time_s in rows["time_s"][np.isnan(rows["fallback_rung"])]}
    assert undecided == lost_s
    for name in ("time_s", "battery_power_w", "gap_m"):
        np.testing.assert_array_equal(rows[name], page["rows"][name], err_msg=name)


def test_the_same_trip_again_begins_a_new_page(bag: Path) -> None:
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    with BagReader(bag) as reader:
        messages = [(SPECS.get(raw.topic), raw.data) for raw in reader.raw_messages()]
    for _ in range(2):
        for spec, data in messages:
            follower.take(spec.topic, data)
            follower.show()
    assert documents(feed)["rows"]["time_s"].tolist() == [float(k) for k in range(121)]


def test_broken_messages_are_named_and_leave_a_hole(bag: Path) -> None:
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    with BagReader(bag) as reader:
        messages = [(SPECS.get(raw.topic), raw) for raw in reader.raw_messages()]
    for spec, raw in messages:
        data = raw.data
        if spec.topic is Topic.LEADER:
            message = deserialize_message(data, spec.message_type)
            message.pose.pose.position.x = math.nan
            data = serialize_message(message)
        follower.take(spec.topic, data)
    follower.show()
    found = documents(feed)
    assert np.isnan(found["rows"]["leader_position_m"]).all()
    assert np.isfinite(found["rows"]["cell_n_temperature_c"]).all()
    (fault,) = found["statuses"]["faults"]
    assert TOPICS[Topic.LEADER].name in fault


def test_braking_of_the_safety_monitor_is_part_of_its_row(bag: Path) -> None:
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    state = VehicleState(3.0, *[0.0] * 8)
    safety = SafetyRecord(0.25, 4.0, 1.0)
    braking = plant_messages(state, safety=safety)[Topic.PLANT_STATE]
    with BagReader(bag) as reader:
        for raw in reader.raw_messages():
            spec, data = SPECS[raw.topic], raw.data
            if spec.topic is Topic.PLANT_STATE and raw.publish_time_ns == 3 * 10**9:
                data = serialize_message(braking)
            follower.take(spec.topic, data)
            follower.show()
    braking_s = documents(feed)["rows"]["service_braking_s"]
    assert braking_s[3] == 0.25
    assert not np.delete(braking_s, 3).any()  # a trip without braking


def test_changes_of_the_diagnostics_are_events_of_the_trip() -> None:
    feed = PageFeed()
    follower = RunFollower(feed, RunFacts("test"))
    received = [
        (0.0, Level.WARN, "waiting for peers"),
        (1.0, Level.OK, "optimal plans"),
        (2.0, Level.OK, "other plans"),
        (5.0, Level.WARN, "no preview"),
        (6.0, Level.WARN, "no preview"),
        (7.0, Level.ERROR, "no state"),
        (9.0, Level.OK, "optimal plans"),
    ]
    for time_s, level, reason in received:
        status = DiagnosticStatus(name="/controller: plans", level=level.value, message=reason)
        status.values = [KeyValue(key=TRIP_TIME, value=str(time_s))]
        message = DiagnosticArray(status=[status])
        message.header.stamp = time_from_s(1.8e9)  # of the node's clock
        follower.take(Topic.DIAGNOSTICS, serialize_message(message))
    assert [tuple(event.values()) for event in documents(feed)["events"]] == [
        (time_s, "/controller: plans", level.name, reason)
        for time_s, level, reason in received
        if time_s in {1.0, 5.0, 7.0, 9.0}
    ]


@pytest.mark.parametrize("namespace", [None, "", "/"])
def test_a_bag_without_a_namespace_needs_none(bag: Path, namespace: str | None) -> None:
    with BagSource(bag, namespace=namespace) as source:
        source.load(feed := PageFeed(), source.facts)
    assert feed.row_count == 121


def test_a_bag_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="does not exist"):
        BagSource(tmp_path / "none")


def test_what_the_nodes_do_not_tell_is_left_out_and_said() -> None:
    unknown = facts_of_nodes("graph", {})
    assert unknown.document()["limits"] is None
    assert "limits are left out" in unknown.document()["notes"][0]
    assert unknown.trip_settings() is None
    known = facts_of_nodes(
        "graph",
        {
            "plant": {
                "cycle": "nycc", "slope": "none", "duration_s": 30.0, "period_s": 0.5,
                "parameter_set": "paper_calibrated", "overrides": "gap.max_gap_m=80",
            }
        },
    )  # fmt: skip
    assert known.document()["limits"]["max_gap_m"] == 80.0
    settings = known.trip_settings()
    assert settings is not None
    assert "nycc" in settings
    assert "period_s: 0.5" in settings
    # A leader known from messages drives something else: no reference car can follow it.
    nodes = {**(known.nodes or {}), "v2x_bridge": {"leader_source": "cam"}}
    assert facts_of_nodes("graph", nodes).trip_settings() is None
