"""The live view as a real process: beside a replay and beside a run, and never in their way."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.integration.page_browser import Browser, Terminal, followed

from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.trajectory_reader import read_trajectory

BAG = Path(__file__).resolve().parents[4] / "bags" / "example_us06_120s"


@pytest.fixture
def view(launcher: Any, wait_until: Callable[..., None]) -> Callable[..., tuple[Any, Browser]]:
    """Start a view and follow its page."""

    def start(*arguments: str) -> tuple[Any, Browser]:
        process = launcher.start_module("iptm_view.view", "--against", "none", *arguments)
        address = re.compile(r"http://\S+")
        wait_until(lambda: address.search(process.stdout), what="address of the page")
        found = address.search(process.stdout)
        assert found is not None
        return process, Browser(found.group(0))

    return start


def test_a_replay_drives_the_view_as_the_bag_does(
    launcher: Any, view: Callable[..., tuple[Any, Browser]], wait_until: Callable[..., None]
) -> None:
    process, browser = view("--no-foxglove")
    player = launcher.start_module(
        "iptm_bags.player_cli", BAG, "--rate", "60", "--wait-for-subscribers", "9"
    )
    wait_until(lambda: browser.has_ended, what="end of the replay")
    assert player.wait() == 0
    browser.assert_rows_are_those_of(read_trajectory(BAG))
    assert browser.rows[-1][0] == 120.0
    # No node is there to be asked.
    assert browser.documents["facts"]["limits"] is None
    # It runs in a session of its own, so where sessions share the processor that of the session counts.
    session = Path(f"/proc/{process.popen.pid}/autogroup")
    assert os.getpriority(os.PRIO_PROCESS, process.popen.pid) > 0
    assert not session.exists() or int(session.read_text().split()[-1]) > 0
    assert process.stop(signal.SIGINT) == 0


def test_the_page_of_a_run_has_every_tick_and_stays_until_ctrl_c(
    launcher: Any, wait_until: Callable[..., None], tmp_path: Path
) -> None:
    """In lock-step, in a namespace, on a terminal: the view outlives the trip, however fast that was."""
    output = tmp_path / "run"
    trip = ["wltc", "--duration-s", "60", "--mode", "lock_step", "--namespace", "car_1"]
    options = ["--view", "--no-picture", "--against", "none", "--output", str(output)]
    with closing(Terminal(launcher, "iptm.commands.run", *trip, *options)) as runner:
        (browser,) = followed(runner, wait_until, "events")
        # The page has what was heard of the run first, then all of it from its bag.
        wait_until(
            lambda: browser.has_ended and len(browser.rows) == len(browser.plans) == 61,
            180.0,
            "every tick",
        )
        driven = read_trajectory(output, "car_1")
        browser.assert_rows_are_those_of(driven)
        assert [plan["time_s"][0] for plan in browser.plans] == driven.time_s.tolist()
        assert browser.documents["facts"]["limits"]["max_gap_m"] == 120.0
        assert browser.documents["facts"]["title"].startswith("cycle wltc_class3b, strategy")
        assert browser.documents["road"]["height_m"][0] == 0.0
        wait_until(lambda: "until Ctrl-C" in runner.text, what="the end of the report")
        assert f"scripts/iptm view {output}" in runner.text.replace("\n", "")
        assert runner.popen.poll() is None
        runner.popen.send_signal(signal.SIGINT)
        assert runner.popen.wait(120.0) == 0
        wait_until(lambda: "closing" in browser.documents, what="the last word of the server")


def test_a_bag_is_shown_without_a_graph(
    view: Callable[..., tuple[Any, Browser]], wait_until: Callable[..., None]
) -> None:
    process, browser = view(str(BAG), "--rate", "200")
    wait_until(lambda: browser.has_ended, what="end of the bag")
    browser.assert_rows_are_those_of(read_trajectory(BAG))
    assert len(browser.rows) == 121
    with BagReader(BAG) as reader:
        assert browser.documents["facts"]["source"] == f"bag {reader.path.name}"
    assert process.stop(signal.SIGTERM) == 0


def test_mistakes_are_one_line(launcher: Any, tmp_path: Path) -> None:
    """As a process: the view lowers its priority and that of its session."""
    mistakes = {
        (str(tmp_path / "none"),): "does not exist",
        ("--namespace", "1 car"): "1 car",
        (str(BAG), "--rate", "-1"): "rate is -1; allowed",
    }
    started = [
        (launcher.start_module("iptm_view.view", "--no-foxglove", *arguments), message)
        for arguments, message in mistakes.items()
    ]
    for process, message in started:
        assert process.wait() == 2
        (line,) = process.stderr.splitlines()
        assert message in line
