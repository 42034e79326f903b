"""The start of a trip: it waits for the nodes that are named, and no first message is lost."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from iptm_ros.connections import Meeting
from iptm_ros.diagnostics import PROCESS, status_values
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic

S = 10**9
TICKS = 10
RUN = "iptm.commands.run"
TRIP = ("--cycle", "nycc", "--duration-s", str(TICKS), "--horizon", "3x1", "--no-picture")
LONG = ("--cycle", "comprehensive", "--horizon", "3x1", "--no-picture")
"""10,000 s: it cannot end before its observer is there."""
RUN_TIMEOUT_S = 180.0
MANY = [pytest.param(number, marks=pytest.mark.slow) for number in range(1, 20)]
NODES = ("plant", "v2x_bridge", "controller", "recorder")


def _work() -> None:
    while True:
        pass


@contextmanager
def busy_machine() -> Iterator[None]:
    """Keep every core busy with something else."""
    workers = [
        multiprocessing.Process(target=_work, daemon=True) for _ in range(os.cpu_count() or 2)
    ]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        for worker in workers:
            worker.kill()
            worker.join()


def stamps_of(bag: Path) -> dict[str, Counter[int | None]]:
    """How often each stamp is there, by topic of a tick."""
    apart = (Topic.SLOPE, Topic.DIAGNOSTICS)
    names = [f"/{topic.value}" for topic in TOPICS if topic not in apart]
    found: dict[str, Counter[int | None]] = {}
    with BagReader(bag) as reader:
        for raw in reader.raw_messages([name for name in names if name in reader.topics]):
            is_stamped = not raw.topic.endswith("_command")  # plain numbers
            stamp_ns = read_stamp_ns(raw.data) if is_stamped else raw.log_time_ns
            found.setdefault(raw.topic, Counter())[stamp_ns] += 1
    return found


@pytest.mark.parametrize("number", [0, *MANY])
def test_no_message_of_a_trip_is_lost_or_doubled(
    launcher: Any, tmp_path: Path, number: int
) -> None:
    # Beside other tests the machine is busy enough, and they would starve.
    with busy_machine() if number else nullcontext():
        runner = launcher.start_module(RUN, *TRIP, "--output", tmp_path / "bag")
        assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
    every = dict.fromkeys((tick * S for tick in range(TICKS + 1)), 1)
    found = stamps_of(tmp_path / "bag")
    assert len(found) > 10
    for topic, stamps in found.items():
        assert stamps == every, (topic, number)


@pytest.mark.parametrize("number", [0, *MANY])
def test_a_run_whose_node_is_killed_ends(
    launcher: Any, peer: Any, tmp_path: Path, number: int
) -> None:
    """At the start or under way: with an error that names it, and never by waiting for it."""
    killed = NODES[number % len(NODES)]
    statuses = peer.statuses(f"/{killed}")
    runner = launcher.start_module(RUN, *LONG, "--output", tmp_path / "bag")
    peer.wait_until(lambda: len(statuses) > number // len(NODES), RUN_TIMEOUT_S, f"{killed}")
    os.kill(int(status_values(statuses[-1])[PROCESS]), signal.SIGKILL)
    assert runner.wait(RUN_TIMEOUT_S) == 1, runner.stdout + runner.stderr
    assert f"{killed} " in runner.stderr
    assert "killed" in runner.stderr.lower()


def test_a_meeting_is_complete_when_both_sides_have_found_each_other(peer: Any) -> None:
    context = peer.node.context
    speaker, listener = (SuiteNode(name, context=context) for name in ("speaker", "listener"))
    for node in (speaker, listener):
        peer.executor.add_node(node)
    meeting = Meeting(peer.node, ("/speaker", "/listener"))
    assert meeting.absent == ("/speaker", "/listener")
    peer.wait_until(lambda: not meeting.absent, what="reports")
    assert meeting.is_complete  # they share no topic
    speaker.advertise(Topic.CLOCK)
    listener.listen(Topic.CLOCK, lambda _: None)
    listener.listen(Topic.COMMAND, lambda _: None)
    pair = {"/clock": frozenset({"/listener"})}
    peer.wait_until(lambda: speaker.connections.present.publishes.items() >= pair.items())
    peer.wait_until(lambda: meeting.deaf_to(["/controller/command"]) == ("/listener",))
    peer.wait_until(lambda: meeting.is_complete)
    assert listener.connections.present.hears["/clock"] == {"/speaker"}
    for node in (speaker, listener):
        peer.executor.remove_node(node)
        node.destroy_node()
