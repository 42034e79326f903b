"""A string of vehicles over DDS: each follows the one before, and all of it can be repeated."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.foreign_readers import assert_read_by_all
from tests.integration.page_browser import Terminal, followed

from iptm.commands.run import build_parser, chosen_trip
from iptm_core.decision_record import Rung
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import Command
from iptm_ros.codecs import decode_command
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.trajectory_reader import read_decisions, read_trajectory
from iptm_ros.topics import TOPICS, Topic
from iptm_string.headless import drive_string_in_memory

pytest.importorskip("iptm_view", reason="the extra is not installed")
MODULE = "iptm.commands.run"
TICKS = 40
OPTIONS = ("--cycle", "us06", "--slope", "large", "--duration-s", str(TICKS), "--no-picture")
RUN_TIMEOUT_S = 300.0


def commands_of(bag: Path, vehicle: str) -> list[tuple[int, Command]]:
    """Return stamps and commands; the bytes between the fields of a message mean nothing."""
    with BagReader(bag) as reader:
        topics = [f"/{vehicle}/{Topic.COMMAND.value}"]
        return [decode_command(entry.message) for entry in reader.messages(topics)]


def watched(launcher: Any, wait_until: Callable[..., None], output: Path, vehicles: int) -> None:
    """Drive a string, a browser at the page of each vehicle; compare what they show with the bags."""
    names = [f"car_{place + 1}" for place in range(vehicles)]
    arguments = ("--vehicles", str(vehicles), *OPTIONS, "--view", "--output", str(output))
    with closing(Terminal(launcher, MODULE, *arguments)) as runner:
        paths = [f"events?vehicle={name}" for name in names]
        browsers = dict(zip(names, followed(runner, wait_until, *paths), strict=True))
        for name, browser in browsers.items():
            wait_until(
                lambda b=browser: b.has_ended and len(b.rows) == TICKS + 1,  # type: ignore[misc]
                RUN_TIMEOUT_S,
                "every tick",
            )
            browser.assert_rows_are_those_of(read_trajectory(output / name, name))
            assert browser.documents["vehicles"] == {"names": names, "shown": name}
            domain = re.search(r"ROS_DOMAIN_ID=(\d+)", runner.text)
            assert domain is not None
            source = f"ROS graph, domain {domain.group(1)}, namespace /{name}, {name}"
            assert browser.documents["facts"]["source"] == source
            assert browser.documents["facts"]["limits"]["max_gap_m"] == 120.0
            shown = {status["name"] for status in browser.documents["statuses"]["statuses"]}
            assert f"/{name}/plant: vehicle" in shown
            assert all(status.startswith(f"/{name}/") for status in shown)
        wait_until(lambda: "until Ctrl-C" in runner.text, what="the end of the report")
        assert f"{vehicles} vehicles, {TICKS} s" in runner.text
        assert "Traceback" not in runner.text
        runner.popen.send_signal(signal.SIGINT)
        assert runner.popen.wait(120.0) == 0


@pytest.mark.parametrize("vehicles", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_string_is_that_of_the_loop_without_ros_and_can_be_watched(
    launcher: Any, wait_until: Callable[..., None], tmp_path: Path, vehicles: int
) -> None:
    """To the last bit, so a string can be repeated, and another vehicle behind it changes nothing."""
    output = tmp_path / "run"
    watched(launcher, wait_until, output, vehicles)

    trip = chosen_trip(build_parser().parse_args(list(OPTIONS)))
    model = trip.parameters
    headless = drive_string_in_memory(trip, vehicles)
    ahead = None
    for place, run in enumerate(headless):
        name = f"car_{place + 1}"
        bag = output / name
        there = read_trajectory(bag, name)
        for column in ("position_m", "speed_m_s", "leader_position_m", "compressor_power_w"):
            np.testing.assert_array_equal(getattr(there, column), getattr(run.trajectory, column))
        assert len(commands_of(bag, name)) == TICKS + 1
        assert gap_margins_m(there, model).min() > -1e-3
        assert set(read_decisions(bag, name).rung) == {Rung.OPTIMAL}
        if ahead is not None:
            rear_m = ahead.position_m - VEHICLE_LENGTH_M
            np.testing.assert_array_equal(there.leader_position_m, rear_m)
        ahead = there

    # Each bag has one vehicle, with its own frames, and no bag lacks a message.
    for place in range(vehicles):
        name = f"car_{place + 1}"
        assert_read_by_all(output / name)
        with BagReader(output / name) as reader:
            assert {topic.split("/")[1] for topic in reader.topics} == {name, "diagnostics"}
            counts = {topic: info.message_count for topic, info in reader.topics.items()}
            leaders = [f"/{name}/{Topic.LEADER.value}"]
            frames = {m.message.child_frame_id for m in reader.messages(leaders)}
        assert frames == {f"{name}/leader"}
        for topic in (Topic.CLOCK, Topic.PLANT_STATE, Topic.LEADER, Topic.PLAN, Topic.COMMAND):
            assert counts[f"/{name}/{TOPICS[topic].name}"] == TICKS + 1, topic
    assert (output / "string.png").is_file()


def children_of(pid: int) -> dict[int, str]:
    """Return the names of the processes that a process has started, by their ids."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return {int(each): Path(f"/proc/{each}/comm").read_text().strip() for each in children}


def process_of(runner: int, member: str) -> int:
    """Return the process of a runner whose name begins with a member."""
    (pid,) = (pid for pid, name in children_of(runner).items() if name.startswith(member))
    return pid


def test_a_string_in_real_time_stays_together_when_a_process_was_late(
    launcher: Any, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    output = tmp_path / "run"
    pace = ("--mode", "real_time", "--rate-factor", "5")
    runner = launcher.start_module(
        MODULE, "--vehicles", "2", *OPTIONS, *pace, "--output", output, ROS_DOMAIN_ID=""
    )
    wait_until(lambda: f" of {TICKS} s (" in runner.stdout, RUN_TIMEOUT_S, "the trip")
    first = process_of(runner.popen.pid, "car_1")
    os.kill(first, signal.SIGSTOP)
    time.sleep(5.0 / 5.0)  # five ticks
    os.kill(first, signal.SIGCONT)
    assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
    for name in ("car_1", "car_2"):
        results = json.loads((output / name / "results.json").read_text("utf-8"))
        assert results["wall_time_s"] >= TICKS / 5.0 - 0.5
        run = read_trajectory(output / name, name)
        assert run.time_s[-1] == TICKS
        assert run.gap_m.min() > 0.0
        assert run.speed_m_s.max() > 5.0
        # Ticks are answered in time again, with the plan of the vehicle ahead.
        assert np.mean(read_decisions(output / name, name).rung == Rung.OPTIMAL) > 0.2


@pytest.mark.parametrize("member", ["car_1", "recorder"])
def test_a_member_that_dies_is_named_and_ends_the_string_with_sound_bags(
    launcher: Any, tmp_path: Path, wait_until: Callable[..., None], member: str
) -> None:
    output = tmp_path / "run"
    long = ("--cycle", "comprehensive", "--horizon", "3x1")
    options = ("--vehicles", "2", *long, "--output", output)
    # In a domain of its own, the runner forks: processes have names.
    runner = launcher.start_module(MODULE, *options, ROS_DOMAIN_ID="")

    def recorded() -> int:
        return sum(path.stat().st_size for path in (output / "car_2").glob("*.mcap"))

    wait_until(lambda: " of 10000 s (" in runner.stdout, RUN_TIMEOUT_S, "the trip")
    before = recorded()
    wait_until(lambda: recorded() > before + 1_000_000, RUN_TIMEOUT_S, "messages of car_2")
    processes = children_of(runner.popen.pid)
    os.kill(process_of(runner.popen.pid, member), signal.SIGKILL)
    assert runner.wait(RUN_TIMEOUT_S) == 1, runner.stdout + runner.stderr
    assert re.search(rf"{member}\S* was killed by signal 9 \(SIGKILL\) at ", runner.stderr)
    wait_until(
        lambda: not any(Path(f"/proc/{pid}").exists() for pid in processes), what="their end"
    )
    if member != "recorder":
        assert len(read_trajectory(output / "car_2", "car_2")) > 10


@pytest.mark.parametrize(
    ("module", "parameters", "complaint"),
    [
        ("iptm_v2x_bridge.node", {"leader_source": "vehicle"}, "vehicle_ahead is ''"),
    ],
)
def test_parameters_that_make_no_string_are_refused(
    refused: Callable[..., str], module: str, parameters: dict[str, object], complaint: str
) -> None:
    assert complaint in refused(module, parameters=parameters)
