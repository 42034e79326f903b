"""Bags are compared message by message and field by field."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from iptm_bags.compare_bags import (
    NumberTolerance,
    TopicComparison,
    compare_bags,
    differences,
    flatten,
)
from iptm_bags.reading import compare
from iptm_core.errors import BagError
from iptm_core.trajectory import Trajectory
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.message_types import standard_typestore
from iptm_ros.recording.recorded_topics import TopicSelection
from iptm_ros.topics import Topic

WriteRun = Callable[..., Path]
TYPES = standard_typestore().types


def changed(run: Trajectory, name: str, row: int, by: float) -> Trajectory:
    columns = run.to_arrays()
    column = columns[name].copy()
    column[row] += by
    return Trajectory.from_arrays({**columns, name: column})


def outcome(comparison: list[TopicComparison], topic: str) -> TopicComparison:
    return next(entry for entry in comparison if entry.topic == topic)


def test_repeated_run_agrees_though_solve_times_differ(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    first = write_run(tmp_path / "a", trajectory, solve_time_s=0.01)
    second = write_run(tmp_path / "b", trajectory, solve_time_s=0.02)
    assert all(entry.agrees for entry in compare_bags(first, second))
    strict = compare_bags(first, second, ignored_fields=())
    assert [entry.topic for entry in strict if not entry.agrees] == ["/controller/solve"]
    solve = outcome(strict, "/controller/solve")
    assert solve.largest == {"solve_time_s": pytest.approx(0.01)}


def test_smallest_change_is_found_at_its_place(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    first = write_run(tmp_path / "a", trajectory)
    step = math.ulp(trajectory.speed_m_s[17])
    second = write_run(tmp_path / "b", changed(trajectory, "speed_m_s", 17, step))
    comparison = compare_bags(first, second)
    for topic, field in (
        ("/plant/state", "speed_m_s"),
        ("/plant/odometry", "twist.twist.linear.x"),
    ):
        found = outcome(comparison, topic)
        assert found.differing == 1
        assert found.first_place == "at 17 s"
        assert [f.path for f in found.first_fields] == [field]
        assert found.largest == {field: step}
    assert sum(not entry.agrees for entry in comparison) == 2


def test_tolerance(trajectory: Trajectory, write_run: WriteRun, tmp_path: Path) -> None:
    first = write_run(tmp_path / "a", trajectory)
    second = write_run(tmp_path / "b", changed(trajectory, "battery_power_w", 3, 1e-6))
    for absolute_w, agrees in ((0.0, False), (0.9e-6, False), (1.1e-6, True)):
        comparison = compare_bags(first, second, tolerance=NumberTolerance(absolute_w))
        assert all(entry.agrees for entry in comparison) is agrees


def test_lost_message_is_one_difference_not_many(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    first = write_run(tmp_path / "a", trajectory)
    second = write_run(tmp_path / "b", trajectory, drop=frozenset({(Topic.LEADER, 4)}))
    leader = outcome(compare_bags(first, second), "/v2x/leader")
    assert (leader.differing, leader.only_first, leader.only_second) == (0, 1, 0)
    assert not leader.agrees


def test_missing_topic_and_other_type(tmp_path: Path, small_bag: Path) -> None:
    with BagWriter(tmp_path / "other") as writer:
        writer.write(writer.add_topic("/a", "std_msgs/msg/Int32"), b"\0\1\0\0" + bytes(4), 0)
    comparison = compare_bags(small_bag, tmp_path / "other")
    assert "type std_msgs/msg/Float64 in one" in outcome(comparison, "/a").remark
    assert outcome(comparison, "/b").only_first == 20


def test_unstamped_messages_are_matched_by_number(
    small_bag: Path, tmp_path: Path, encode: Callable[[float], bytes]
) -> None:
    with BagWriter(tmp_path / "other") as writer:
        a = writer.add_topic("/a", "std_msgs/msg/Float64")
        b = writer.add_topic("/b", "std_msgs/msg/Float64")
        for k in range(20):
            writer.write(a, encode(k if k < 13 else k + 0.5), k)
            writer.write(b, encode(-k), k)
    comparison = compare_bags(small_bag, tmp_path / "other")
    a_outcome = outcome(comparison, "/a")
    assert a_outcome.differing == 7
    assert a_outcome.first_place == "message 14"
    assert a_outcome.largest == {"data": 0.5}
    assert outcome(comparison, "/b").agrees


def test_nothing_to_compare(small_bag: Path) -> None:
    with pytest.raises(BagError, match="no topic left"):
        compare_bags(small_bag, small_bag, selection=TopicSelection(("/nothing",)))


def test_order_of_named_values_is_no_difference() -> None:
    time, header = TYPES["builtin_interfaces/msg/Time"], TYPES["std_msgs/msg/Header"]
    joint_state = TYPES["sensor_msgs/msg/JointState"]

    def named(**values: float) -> Any:
        return joint_state(header(time(1, 2), ""), list(values), list(values.values()), [], [])

    assert dict(flatten(named(a=1.0, b=2.0)))["b"] == 2.0
    assert differences(named(a=1.0, b=2.0), named(b=2.0, a=1.0), NumberTolerance()) == []
    found = differences(named(a=1.0, b=2.0), named(a=1.0, c=2.0), NumberTolerance())
    assert [(f.path, f.first, f.second) for f in found] == [
        ("b", 2.0, "(absent)"),
        ("c", "(absent)", 2.0),
    ]


def test_arrays_of_different_length_and_texts() -> None:
    array, layout = TYPES["std_msgs/msg/Float64MultiArray"], TYPES["std_msgs/msg/MultiArrayLayout"]
    found = differences(
        array(layout([], 0), [1.0, 2.0]), array(layout([], 0), [1.0]), NumberTolerance(9.0)
    )
    assert [f.path for f in found] == ["data.length", "data.1"]
    text = TYPES["std_msgs/msg/String"]
    assert [f.distance for f in differences(text("a"), text("b"), NumberTolerance(9.0))] == [
        math.inf
    ]


@pytest.mark.parametrize(
    ("first", "second", "accepted"),
    [
        (math.nan, math.nan, True),
        (math.nan, 1.0, False),
        (math.inf, math.inf, True),
        (math.inf, 1.0, False),
        (0.0, -0.0, True),
        (100.0, 101.0, True),
        (100.0, 103.0, False),
    ],
)
def test_tolerance_of_special_numbers(first: float, second: float, accepted: bool) -> None:
    assert NumberTolerance(relative=0.02).accepts(first, second) is accepted


def test_command(
    trajectory: Trajectory,
    write_run: WriteRun,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = str(write_run(tmp_path / "a", trajectory))
    second = str(write_run(tmp_path / "b", changed(trajectory, "speed_m_s", 5, 1.0)))
    assert compare(["--exact", first, first]) == 0
    assert "the bags agree" in capsys.readouterr().out
    assert compare(["--exact", first, second]) == 1
    text = capsys.readouterr().out
    assert "/plant/odometry first differs at 5 s:" in text
    assert "twist.twist.linear.x" in text
    assert compare(["--exact", first, second, "--exclude", "plant/odometry", "plant/state"]) == 0
    assert (
        compare(["--exact", first, second, "--ignore", "twist.*", "speed_m_s", "solve_time_s"]) == 0
    )
    assert compare(["--exact", first, second, "--absolute", "1.1"]) == 0
    assert compare(["--exact", first, str(tmp_path / "none")]) == 2
    assert "does not exist" in capsys.readouterr().err
