"""A recorder killed at a random moment: at most one tick may be missing from what it leaves.

The kill comes in the middle of a tick, wherever vehicle and clock are in the graph. The long version
(`scripts/test -m slow`) kills 100 recorders.
"""

from __future__ import annotations

import random
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from tests.integration.conftest import joined_peer
from tests.integration.recorded_suite import RECORDER, STAMPED, TICK, RecordedSuite, S

from iptm_bags.recover import recover
from iptm_ros.codecs import time_from_ns
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.topics import TOPICS, Topic

MOST_TICKS = 60
CAR = ("-r", "__ns:=/car_9")
CLOCK_ELSEWHERE = ("-r", "clock:=/clock_of_9")
RENAMED = tuple(
    part
    for topic in TOPICS
    if topic is not Topic.DIAGNOSTICS
    for part in ("-r", f"/{topic.value.lstrip('/')}:=/car_9/{topic.value.lstrip('/')}")
)
PLACES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "no namespace": ((), ()),
    "names as of the launch file": (CAR, (*CAR, "-r", "clock:=clock", "-r", "/clock:=clock")),
    "a clock elsewhere": ((*CAR, *CLOCK_ELSEWHERE), (*CAR, *CLOCK_ELSEWHERE)),
    "everything from outside": (CAR, ("--all", "--ros-args", "-r", "clock:=/car_9/clock")),
    "without a namespace": (CAR, RENAMED),
}
"""ROS arguments of the vehicle, and arguments of its recorder, by where they are."""


@pytest.mark.parametrize(
    "seed", [*range(5), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(5, 100))]
)
def test_a_killed_recorder_loses_at_most_one_tick(
    seed: int, launcher: Any, ros_environment: dict[str, str], tmp_path: Path
) -> None:
    place = list(PLACES)[seed % len(PLACES)]
    of_vehicle, of_recorder = PLACES[place]
    rng = random.Random(seed)  # noqa: S311
    last = rng.randrange(2, MOST_TICKS)
    bag = tmp_path / "bag"
    options = of_recorder if of_recorder[:1] == ("--all",) else ("--ros-args", *of_recorder)
    domain = int(ros_environment["ROS_DOMAIN_ID"])
    with joined_peer(domain, "stand_in", *of_vehicle) as peer:
        suite = RecordedSuite(peer)
        recorder = launcher.start_module(RECORDER, bag, *options)
        suite.start("/car_9/recorder" if "__ns:=/car_9" in of_recorder else "/recorder")
        suite.publish(0, TICK)
        suite.drive(range(1, last), bag / "bag_0.mcap")
        suite.publish(last, TICK[: rng.randrange(len(TICK))])
        time.sleep(rng.random() * 0.02)  # somewhere inside of the tick
        recorder.send(signal.SIGKILL)
        recorder.wait()
        names = {topic: suite.name(topic) for topic in TICK}
        slope = suite.name(Topic.SLOPE)
    assert not (bag / "metadata.yaml").exists()
    with BagReader(recover(bag).output) as reader:
        assert reader.topics[slope].is_latched
        assert last - 2 <= reader.end_ns / S <= last  # in the time of the trip
        for topic, name in names.items():
            # Between topics the middleware promises no order, so a log time may be that of the next tick, and
            # so may the time of publication of a message without a stamp; its number identifies its tick.
            ticks = [
                entry.publish_time_ns // S
                if topic in STAMPED
                else int(np.ravel(entry.message.data)[0])
                for entry in reader.messages([name])
            ]
            assert ticks == list(range(len(ticks))), f"{name} has a gap or lacks its first tick"
            assert len(ticks) >= last - 1, f"{name}: {last - len(ticks)} ticks lost"


def test_a_kill_without_a_clock_loses_nothing(launcher: Any, peer: Any, tmp_path: Path) -> None:
    """Two vehicles: none of their clocks is that of the recorder, which warns and does without."""
    cars = ("/car_8", "/car_9")
    states = [peer.node.create_publisher(Temperature, f"{car}/state", 10) for car in cars]
    clocks = [peer.node.create_publisher(Clock, f"{car}/clock", 10) for car in cars]
    recorder = launcher.start_module(RECORDER, tmp_path / "bag", "--all")
    peer.wait_until(
        lambda: all(each.get_subscription_count() for each in (*states, *clocks)),
        what="subscriptions",
    )
    file, ticks = tmp_path / "bag" / "bag_0.mcap", 40
    for tick in range(ticks):
        size = file.stat().st_size
        for state, clock in zip(states, clocks, strict=True):
            state.publish(Temperature(temperature=float(tick)))
            clock.publish(Clock(clock=time_from_ns(tick * S)))
        peer.wait_until(lambda size=size: file.stat().st_size > size, what="growth of the bag")
    warning = "choose one with --ros-args -r clock:=NAME: /car_8/clock, /car_9/clock"
    peer.wait_until(lambda: warning in recorder.stderr, what="the warning")
    recorder.send(signal.SIGKILL)
    recorder.wait()
    with BagReader(recover(tmp_path / "bag").output) as reader:
        for car in cars:
            assert reader.topics[f"{car}/state"].message_count >= ticks - 1
