"""The whole suite behind a leader that is known by radio."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from tests.integration.cam_ego import SENDER, free_port

from iptm.commands.tree import all_commands
from iptm_bags.compare_bags import compare_bags
from iptm_ros.discovery import reserve_domain
from iptm_ros.recording.bag_reader import BagReader

TICKS = 15
DRIVE = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"
RUN_TIMEOUT_S = 120.0
FAULTS = {"loss_probability": 0.2, "link_delay_s": 0.2, "link_jitter_s": 0.1, "sender_seed": 3}
Finish = Callable[[], Path]
Drive = Callable[[str], Finish]


@pytest.fixture
def drive(launcher: Any, tmp_path: Path) -> Drive:
    """Start a drive behind the car of a bag; what comes back waits for its end and returns its bag."""

    def begin(name: str) -> Finish:
        port, bag = free_port(), tmp_path / name
        stack = ExitStack()
        domain = str(stack.enter_context(reserve_domain()))
        settings = ("leader_source=cam", f"cam_port={port}", "publish_datagrams=true")
        runner = launcher.start_module(
            "iptm.commands.run", "--cycle", DRIVE, "--duration-s", str(TICKS),
            "--no-picture", "--domain", domain, "--output", bag,
            *(part for each in settings for part in ("--set", f"leader.{each}")),
        )  # fmt: skip
        parameters = {"to_port": port, "cycle": DRIVE, **FAULTS}
        sender = launcher.start_module(
            SENDER, "--ros-args",
            *(part for item in parameters.items() for part in ("-p", "{}:={}".format(*item))),
            name="sender", ROS_DOMAIN_ID=domain,
        )  # fmt: skip

        def finish() -> Path:
            with stack:
                assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
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
    # The check of one node, of an extra, finds the recorded traffic by itself.
    if check := all_commands().get("check"):
        assert check.load()(["v2x_bridge", str(first)]) == 0
