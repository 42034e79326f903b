"""The diagnostic status of a node: level, reason, values."""

from __future__ import annotations

from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray

from iptm_ros.diagnostics import (
    DiagnosticsReporter,
    Level,
    build_status,
    find_status,
    status_values,
)
from iptm_ros.node_health import NodeHealth


class Bench:
    """A reporter on a clock that the test moves."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.sent: list[Any] = []
        self.health = NodeHealth(lambda: self.now_s)
        self.changes: list[tuple[Level, str]] = []
        self.reporter = DiagnosticsReporter(
            self.sent.append,
            "/car/node: part",
            steady_time_s=lambda: self.now_s,
            health=self.health,
            now=lambda: Time(sec=1_700_000_000),
            on_change=lambda level, reason: self.changes.append((level, reason)),
        )

    def report(self, level: Level, reason: str, **values: object) -> bool:
        return self.reporter.report(5_000_000_000, level, reason, lambda: values)


def test_first_status_goes_out_at_once() -> None:
    bench = Bench()
    assert bench.report(Level.OK, "running", gap_m=12.3456789, ticks=3, active=True)
    message = bench.sent[0]
    assert message.header.stamp.sec == 1_700_000_000  # as other nodes of ROS stamp theirs
    assert status_values(message.status[0])["trip_time_s"] == "5"
    status = message.status[0]
    assert (status.name, status.message) == ("/car/node: part", "running")
    values = {"gap_m": "12.3457", "ticks": "3", "active": "true"}
    assert values.items() <= status_values(status).items()


def test_same_reason_is_published_once_a_second_whatever_the_tick_rate() -> None:
    bench = Bench()
    for _ in range(1000):
        bench.report(Level.OK, "running", tick=len(bench.sent))
        bench.now_s += 0.0101
    assert len(bench.sent) == pytest.approx(1000 * 0.0101, abs=1)
    assert len(bench.changes) == 1


def test_change_of_reason_or_level_goes_out_at_once() -> None:
    bench = Bench()
    assert bench.report(Level.OK, "running")
    assert bench.report(Level.WARN, "running")
    assert bench.report(Level.WARN, "preview is old")
    assert not bench.report(Level.WARN, "preview is old")
    assert bench.report(Level.OK, "running")
    assert bench.changes == [
        (Level.OK, "running"),
        (Level.WARN, "running"),
        (Level.WARN, "preview is old"),
        (Level.OK, "running"),
    ]


def test_what_a_node_survived_is_told_for_a_short_while() -> None:
    bench = Bench()
    bench.report(Level.OK, "running")
    bench.health.note_refusal("plant/odometry: 99 bytes")
    bench.report(Level.OK, "running")
    bench.report(Level.STALE, "no state arrives")
    bench.health.note_defect("callback of plant/odometry: ValueError")
    bench.report(Level.OK, "running")
    bench.now_s += 10.0
    bench.report(Level.OK, "running")
    assert bench.changes == [
        (Level.OK, "running"),
        (Level.WARN, "messages were refused"),
        (Level.STALE, "no state arrives"),
        (Level.ERROR, "an internal error was caught, see the log"),
        (Level.OK, "running"),
    ]
    values = status_values(bench.sent[-1].status[0])
    assert (values["caught_errors"], values["refused_messages"]) == ("1", "1")


def test_a_second_publisher_is_told_when_both_speak_or_when_it_stays() -> None:
    """A killed process stays in the graph for a while; it is not a duplicate."""
    bench = Bench()
    both = (Level.ERROR, "more than one plant on this graph")
    bench.health.note_contradiction("plant")
    bench.now_s += 1.0
    bench.health.note_publishers("plant", 2)
    bench.report(Level.OK, "running")
    assert bench.changes == [(Level.OK, "running")]
    bench.now_s += 1.0
    bench.health.note_contradiction("plant")
    bench.report(Level.OK, "running")
    assert bench.changes[-1] == both
    bench.now_s += 10.0
    bench.report(Level.OK, "running")
    assert bench.changes[-1] == (Level.OK, "running")
    bench.now_s += 20.0
    bench.report(Level.OK, "running")
    assert bench.changes[-1] == both
    bench.health.note_publishers("plant", 1)
    bench.report(Level.OK, "running")
    assert bench.changes[-1] == (Level.OK, "running")


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "true"), (False, "false"), (1.0, "1"), (float("inf"), "inf"), (7, "7"), ("x", "x")],
)
def test_status_carries_level_and_values_as_text(value: object, text: str) -> None:
    status = build_status("/n", Level.STALE, "x", {"key": value})
    assert (Level(status.level), status_values(status)) == (Level.STALE, {"key": text})


def test_status_of_a_node_is_found_by_its_qualified_name() -> None:
    other = build_status("/car/node_2: part", Level.OK, "b", {})
    mine = build_status("/car/node: part", Level.OK, "a", {})
    message = DiagnosticArray(status=[other, mine])
    assert find_status(message, "/car/node") is mine
    assert find_status(message, "/car/node: part") is mine
    assert find_status(message, "/car") is None


def test_reporter_of_a_node_names_it_in_full(make_node: Any) -> None:
    node = make_node("-r", "__ns:=/car_1")
    reporter = DiagnosticsReporter.of_node(node, "preview")
    for level in Level:
        assert reporter.report(0, level, "a reason for the log", dict)
    assert reporter._name == "/car_1/test_node: preview"
    assert reporter._hardware_id == "car_1"
