"""The whole suite behind a leader that is known by radio, and again behind its recorded radio traffic."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from tests.integration.cam_ego import SENDER, free_port

from iptm.runner.replay_check import check_node
from iptm_ros.discovery import reserve_domain
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.compare_bags import compare_bags
from iptm_ros.recording.recorded_topics import TopicSelection

TICKS = 15
DRIVE = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"
RUN_TIMEOUT_S = 120.0
FAULTS = {"loss_probability": 0.2, "link_delay_s": 0.2, "link_jitter_s": 0.1, "sender_seed": 3}
Finish = Callable[[], Path]
Drive = Callable[..., Finish]


@pytest.fixture
def drive(launcher: Any, tmp_path: Path) -> Drive:
    """Start a drive behind the car of a bag by command; with a sender unless packets are given.

    What comes back waits for its end and returns its bag.
    """

    def begin(name: str, recorded: Path | None = None) -> Finish:
        port, bag = free_port(), tmp_path / name
        chosen = {"leader_source": "cam", "cam_port": port, "publish_datagrams": recorded is None}
        if recorded is not None:
            chosen["recorded_packets"] = recorded
        given = [
            part for item in chosen.items() for part in ("--set", "leader.{}={}".format(*item))
        ]
        stack = ExitStack()
        domain = str(stack.enter_context(reserve_domain()))
        runner = launcher.start_module(
            "iptm.commands.run", "--cycle", DRIVE, "--duration-s", str(TICKS),
            "--no-picture", "--domain", domain, *given, "--output", bag
        )  # fmt: skip
        sender = None
        if recorded is None:
            parameters = {"to_port": port, "cycle": DRIVE, **FAULTS}
            arguments = [
                part for item in parameters.items() for part in ("-p", "{}:={}".format(*item))
            ]
            sender = launcher.start_module(
                SENDER, "--ros-args", *arguments, name="sender", ROS_DOMAIN_ID=domain
            )

        def finish() -> Path:
            with stack:
                assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
                if sender is not None:
                    assert sender.stop(signal.SIGINT) == 0
            return bag

        return finish

    return begin


def test_two_drives_by_radio_are_equal_to_the_last_bit(drive: Drive) -> None:
    """At the same time, each in a domain of its own; and the bridge answers their recording as it did."""
    first, second = (finish() for finish in (drive("first"), drive("second")))
    with BagReader(first) as reader:
        assert reader.topics["/v2x/datagrams"].message_count > 8 * TICKS
    for outcome in compare_bags(first, second):
        assert outcome.agrees, outcome.divergence_text() or outcome
    # The check of one node finds the recorded traffic by itself.
    for outcome in check_node(first, "v2x_bridge"):
        assert outcome.agrees, outcome.divergence_text() or outcome


@pytest.mark.slow
def test_a_drive_by_the_recording_of_another_is_equal_to_the_last_bit(drive: Drive) -> None:
    """Without a sender, from the datagrams in the bag: the same previews and the same decisions."""
    first = drive("first")()
    again = drive("again", first)()
    compared = compare_bags(
        first, again, selection=TopicSelection(exclude=("*/datagrams", "/diagnostics"))
    )
    assert {"/v2x/leader_preview", "/controller/command"} <= {outcome.topic for outcome in compared}
    for outcome in compared:
        assert outcome.agrees, outcome.divergence_text() or outcome
