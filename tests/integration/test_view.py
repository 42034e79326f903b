"""The live view as a real process: beside a replay and beside a run, and never in their way."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import pytest

from iptm_core.trajectory import Trajectory
from iptm_recording.bag_reader import BagReader
from iptm_recording.trajectory_reader import read_trajectory

BAG = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"


class Browser:
    """Follows the events of a page in a thread and keeps their content."""

    def __init__(self, url: str, path: str = "events") -> None:
        self.documents: dict[str, Any] = {}
        self.rows: list[list[float]] = []
        self.plans: list[dict[str, list[float]]] = []
        threading.Thread(target=self._follow, args=(url + path,), daemon=True).start()

    def _follow(self, url: str) -> None:
        kind = ""
        try:
            with urllib.request.urlopen(url, timeout=120.0) as answer:  # noqa: S310
                for line in answer:
                    name, _, text = line.decode().rstrip("\n").partition(": ")
                    if name == "event":
                        kind = text
                    elif name == "data" and kind == "trip":
                        self.rows, self.plans = [], []
                        self.documents.pop("end", None)
                    elif name == "data" and kind in {"rows", "plans"}:
                        getattr(self, kind).extend(json.loads(text))
                    elif name == "data":
                        self.documents[kind] = json.loads(text)
        except OSError:
            pass  # the server has ended

    @property
    def has_ended(self) -> bool:
        return bool(self.documents.get("end", {}).get("ended"))

    def assert_rows_are_those_of(self, driven: Trajectory) -> None:
        names = self.documents["facts"]["columns"]
        by_time = dict(zip(driven.time_s.tolist(), range(len(driven)), strict=True))
        assert self.rows
        for row in self.rows:
            values = dict(zip(names, row, strict=True))
            k = by_time[values["time_s"]]
            for name in ("position_m", "speed_m_s", "leader_speed_m_s", "chiller_heat_w", "gap_m"):
                assert values[name] == getattr(driven, name)[k], (name, values["time_s"])


@pytest.fixture
def view(launcher: Any, wait_until: Callable[..., None]) -> Callable[..., tuple[Any, Browser]]:
    """Start a view and follow its page."""

    def start(*arguments: str) -> tuple[Any, Browser]:
        process = launcher.start_module("iptm_bringup.view", "--against", "none", *arguments)
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
        "iptm_recording.player_cli", BAG, "--rate", "10", "--wait-for-subscribers", "11"
    )
    wait_until(lambda: browser.has_ended, 120.0, "end of the replay")
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


class Terminal:
    """A program that a user started on a terminal."""

    def __init__(self, launcher: Any, module: str, *arguments: str) -> None:
        self._controller, terminal = pty.openpty()
        self._read: list[bytes] = []
        self.popen = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdin=terminal, stdout=terminal, stderr=terminal,
            env=launcher.environment, cwd=launcher.directory, start_new_session=True,
        )  # fmt: skip
        os.close(terminal)
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        with suppress(OSError):  # the program has ended
            while data := os.read(self._controller, 4096):
                self._read.append(data)

    @property
    def text(self) -> str:
        return re.sub(
            r"\x1b\[[0-9;?]*[A-Za-z]|\r", "", b"".join(self._read).decode(errors="replace")
        )

    def close(self) -> None:
        if self.popen.poll() is None:
            os.killpg(self.popen.pid, signal.SIGKILL)
        self.popen.wait()
        os.close(self._controller)


@pytest.fixture
def terminal(launcher: Any) -> Iterator[Callable[..., Terminal]]:
    with ExitStack() as stack:

        def start(module: str, *arguments: str) -> Terminal:
            return stack.enter_context(closing(Terminal(launcher, module, *arguments)))

        yield start


def followed(runner: Terminal, wait_until: Callable[..., None], *paths: str) -> list[Browser]:
    """Return browsers that follow the view of a run, one for each path."""
    address = re.compile(r"live view: (http://[\w.:]+/)")
    wait_until(lambda: address.search(runner.text), 60.0, "address of the page")
    found = address.search(runner.text)
    assert found is not None
    return [Browser(found.group(1), path) for path in paths]


def test_the_page_of_a_run_has_every_tick_and_stays_until_ctrl_c(
    terminal: Callable[..., Terminal], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    """In lock-step, in a namespace, on a terminal: the view outlives the trip, however fast that was."""
    output = tmp_path / "run"
    trip = ["wltc", "--duration-s", "300", "--mode", "lock_step", "--namespace", "car_1"]
    options = ["--view", "--no-picture", "--against", "none", "--output", str(output)]
    runner = terminal("iptm_bringup.run_closed_loop", *trip, *options)
    (browser,) = followed(runner, wait_until, "events")
    wait_until(lambda: browser.has_ended and len(browser.rows) == 301, 180.0, "every tick")
    driven = read_trajectory(output, "car_1")
    browser.assert_rows_are_those_of(driven)
    assert [plan["time_s"][0] for plan in browser.plans] == driven.time_s.tolist()
    assert browser.documents["facts"]["limits"]["max_gap_m"] == 120.0
    assert browser.documents["facts"]["title"].startswith("cycle wltc_class3b, strategy")
    assert browser.documents["road"]["height_m"][0] == 0.0
    wait_until(lambda: "until Ctrl-C" in runner.text, 60.0, "the end of the report")
    assert f"scripts/view {output}" in runner.text.replace("\n", "")
    assert runner.popen.poll() is None
    runner.popen.send_signal(signal.SIGINT)
    assert runner.popen.wait(60.0) == 0
    wait_until(lambda: "closing" in browser.documents, what="the last word of the server")


def test_every_vehicle_of_a_string_can_be_watched(
    terminal: Callable[..., Terminal], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    output = tmp_path / "string"
    trip = ["--vehicles", "2", "--cycle", "wltc_class3b", "--duration-s", "120", "--no-picture"]
    runner = terminal("iptm_bringup.run_string", *trip, "--view", "--output", str(output))
    names = ["car_1", "car_2"]
    paths = [f"events?vehicle={name}" for name in names]
    browsers = dict(zip(names, followed(runner, wait_until, *paths), strict=True))
    for name, browser in browsers.items():
        wait_until(lambda b=browser: b.has_ended and len(b.rows) == 121, 240.0, "every tick")  # type: ignore[misc]
        browser.assert_rows_are_those_of(read_trajectory(output / name, name))
        assert browser.documents["vehicles"] == {"names": names, "shown": name}
        domain = re.search(r"ROS_DOMAIN_ID=(\d+)", runner.text)
        assert domain is not None
        source = f"ROS graph, domain {domain.group(1)}, namespace /{name}, {name}"
        assert browser.documents["facts"]["source"] == source
        assert browser.documents["facts"]["limits"]["max_gap_m"] == 120.0
        names_shown = {status["name"] for status in browser.documents["statuses"]["statuses"]}
        assert f"/{name}/plant: vehicle" in names_shown
        assert all(status.startswith(f"/{name}/") for status in names_shown)
    wait_until(lambda: "until Ctrl-C" in runner.text, 60.0, "the end of the report")
    runner.popen.send_signal(signal.SIGINT)
    assert runner.popen.wait(60.0) == 0


def test_the_view_is_not_counted_as_a_peer(
    launcher: Any, view: Callable[..., tuple[Any, Browser]], peer: Any
) -> None:
    """A plant that waits for one listener must not take a view for it."""
    view("--no-foxglove")
    parameters = {"cycle": "nycc", "duration_s": 5.0, "expected_peers": 1}
    statuses = peer.statuses("/plant")
    launcher.start_node("iptm_plant_sim.node", parameters=parameters)
    name = "/plant/powers"
    peer.wait_until(
        lambda: any(i.node_name == "view" for i in peer.node.get_subscriptions_info_by_topic(name)),
        60.0,
        "the view to listen to the powers",
    )
    seen = len(statuses)
    peer.wait_until(lambda: len(statuses) > seen + 2, what="more reports of the plant")
    assert statuses[-1].message.startswith("waiting for peers on /plant/odometry")


def test_a_bag_is_shown_without_a_graph(
    view: Callable[..., tuple[Any, Browser]], wait_until: Callable[..., None]
) -> None:
    process, browser = view(str(BAG), "--rate", "200")
    wait_until(lambda: browser.has_ended, 60.0, "end of the bag")
    browser.assert_rows_are_those_of(read_trajectory(BAG))
    assert len(browser.rows) == 121
    with BagReader(BAG) as reader:
        assert browser.documents["facts"]["source"] == f"bag {reader.path.name}"
    assert process.stop(signal.SIGTERM) == 0


def test_mistakes_are_told_in_one_line(launcher: Any, tmp_path: Path) -> None:
    for arguments, message in (
        ([str(tmp_path / "none")], "does not exist"),
        (["--screenshot", "x.png"], "allowed: scripts/view BAG"),
        (["--namespace", "1 car"], "1 car"),
        ([str(BAG), "--rate", "-1"], "rate is -1; allowed"),
    ):
        process = launcher.start_module("iptm_bringup.view", "--no-foxglove", *arguments)
        process.assert_refused(message)
