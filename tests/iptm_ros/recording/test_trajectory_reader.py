"""The trajectory of a run, read out of its bag."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import BagError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.trajectory_reader import (
    leader_remark,
    read_decisions,
    read_trajectory,
    topic_name,
)
from iptm_ros.topics import TICK_TOPICS, TOPICS, Topic

WriteRun = Callable[..., Path]

WITHOUT_ROS = """
import sys

class NoRos:
    def find_spec(self, name, *_):
        top = name.partition(".")[0]
        if top in ("rclpy", "builtin_interfaces") or top.endswith("_msgs"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, NoRos())
from pathlib import Path
from iptm_ros.recording.trajectory_reader import read_trajectory
print(len(read_trajectory(Path(sys.argv[1]))))
"""


def test_a_run_is_read_without_ros(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    bag = write_run(tmp_path / "bag", trajectory)
    command = [sys.executable, "-c", WITHOUT_ROS, str(bag)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.stdout == f"{len(trajectory)}\n", result.stderr


def test_run_comes_back_exactly(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    read = read_trajectory(write_run(tmp_path / "bag", trajectory))
    for name in TRAJECTORY_COLUMNS:
        expected, found = getattr(trajectory, name), getattr(read, name)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, expected, err_msg=name)


def test_lost_message_inside_the_run_is_an_error(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    drop = frozenset({(Topic.PLANT_STATE, 12)})
    bag = write_run(tmp_path / "bag", trajectory, drop=drop)
    with pytest.raises(BagError, match=r"lacks plant/state at 12 s: .* no lost message"):
        read_trajectory(bag)
    counted = {"lost_messages": "{/plant/state: 3}"}
    bag = write_run(tmp_path / "counted", trajectory, drop=drop, custom_data=counted)
    with pytest.raises(BagError, match=r"at 12 s: the recorder counted 3 lost messages"):
        read_trajectory(bag)


def test_ticks_without_a_leader_keep_the_rest(
    trajectory: Trajectory,
    write_run: WriteRun,
    tmp_path: Path,
) -> None:
    """A sensor that is silent for some ticks leaves energies and ageing as they are."""
    silent = [0, 7, 8, len(trajectory) - 1]
    drop = frozenset((Topic.LEADER, row) for row in silent)
    bag = write_run(tmp_path / "bag", trajectory, drop=drop)
    read = read_trajectory(bag)
    np.testing.assert_array_equal(read.time_s, trajectory.time_s)
    np.testing.assert_array_equal(np.flatnonzero(~read.has_leader), silent)
    np.testing.assert_array_equal(read.battery_power_w, trajectory.battery_power_w)
    here = read.has_leader
    np.testing.assert_array_equal(read.gap_m[here], trajectory.gap_m[here])
    assert np.isnan(read.gap_m[~here]).all()
    assert "v2x/leader is missing at 4 ticks from 0 s to 20 s" in leader_remark(read)
    assert leader_remark(trajectory) == ""
    assert "counted 2 lost messages of it" in leader_remark(read, {"/v2x/leader": 2})


def test_namespaces(trajectory: Trajectory, write_run: WriteRun, tmp_path: Path) -> None:
    bag = write_run(tmp_path / "bag", trajectory, namespace="/car_1")
    assert len(read_trajectory(bag)) == len(read_trajectory(bag, "/car_1")) == len(trajectory)
    with pytest.raises(BagError, match="no topic '/car_2/plant/state'"):
        read_trajectory(bag, "car_2")


def test_the_clock_of_a_bag_in_a_namespace_may_be_the_global_one(tmp_path: Path) -> None:
    """So it is in bags of before the clock moved with the namespace."""
    kind = TOPICS[Topic.CLOCK].type_name
    for bag, names, expected in (
        ("old", ["/clock"], "/clock"),
        ("new", ["/car_1/clock"], "/car_1/clock"),
        ("both", ["/clock", "/car_1/clock"], "/car_1/clock"),
    ):
        with BagWriter(tmp_path / bag) as writer:
            for name in names:
                writer.write(writer.add_topic(name, kind), b"\x00\x01\x00\x00" + bytes(8), 0)
        with BagReader(tmp_path / bag) as reader:
            assert topic_name(reader, Topic.CLOCK, "car_1") == expected


def test_missing_topic(small_bag: Path) -> None:
    with pytest.raises(BagError, match=r"no topic 'plant/state'; its topics are: /a, /b"):
        read_trajectory(small_bag)


def test_empty_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for spec in TOPICS.values():
            writer.add_topic("/" + spec.name.lstrip("/"), spec.type_name)
    with pytest.raises(BagError, match="holds no messages"):
        read_trajectory(tmp_path / "bag")


def test_bag_without_a_state(trajectory: Trajectory, write_run: WriteRun, tmp_path: Path) -> None:
    drop = frozenset((Topic.PLANT_STATE, row) for row in range(len(trajectory)))
    bag = write_run(tmp_path / "bag", trajectory, drop=drop)
    with pytest.raises(BagError, match="no message of plant/state; allowed: one or more"):
        read_trajectory(bag)


def test_without_a_leader_the_rest_is_read(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    rows = len(trajectory)
    drop = frozenset((Topic.LEADER, row) for row in range(rows))
    found = read_trajectory(write_run(tmp_path / "bag", trajectory, drop=drop))
    unknown = {"leader_position_m", "leader_speed_m_s"}
    assert found.unknown == dict.fromkeys(unknown, rows)
    for name in set(TRAJECTORY_COLUMNS) - unknown:
        np.testing.assert_array_equal(getattr(found, name), getattr(trajectory, name))


def test_broken_promise_names_bag_and_topic(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    columns = trajectory.to_arrays()
    speed = columns["speed_m_s"].copy()
    speed[7] = -1.5
    bag = write_run(tmp_path / "bag", Trajectory.from_arrays({**columns, "speed_m_s": speed}))
    with pytest.raises(BagError, match=r"bag: plant/state: .*-1\.5"):
        read_trajectory(bag)


def test_decisions(trajectory: Trajectory, write_run: WriteRun, tmp_path: Path) -> None:
    decisions = read_decisions(write_run(tmp_path / "bag", trajectory))
    np.testing.assert_array_equal(decisions.time_s, trajectory.time_s)
    np.testing.assert_array_equal(decisions.iterations, 10 + np.arange(len(trajectory)))
    assert decisions.limiter_active.sum() == 1


def test_a_pause_inside_the_run_is_no_long_tick(
    trajectory: Trajectory, write_run: WriteRun, tmp_path: Path
) -> None:
    """Powers would count for all of it."""
    last = len(trajectory) - 1
    gone = frozenset((topic, row) for topic in (*TICK_TOPICS, Topic.SOLVE) for row in (5, 6, 7))
    paused = {"pauses": "[{after_s: 4.0, until_s: 7.0, passed_over: 30}]"}
    bag = write_run(tmp_path / "inside", trajectory, drop=gone, custom_data=paused)
    with pytest.raises(BagError, match="was paused after 4 s until 7 s"):
        read_trajectory(bag)
    at_the_ends = {
        "pauses": f"[{{after_s: null, until_s: 0.0}}, {{after_s: {last}.0, until_s: null}}]"
    }
    bag = write_run(tmp_path / "outside", trajectory, custom_data=at_the_ends)
    assert len(read_trajectory(bag)) == len(trajectory)
    bag = write_run(tmp_path / "malformed", trajectory, custom_data={"pauses": "[1]"})
    with pytest.raises(BagError, match=r"pauses of the recording are '\[1\]'"):
        read_trajectory(bag)
