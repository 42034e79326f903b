"""The life of a node process, seen from outside: exit codes, signals, what is on stderr."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

PROGRAM = """
import signal, sys
from dataclasses import dataclass
from iptm_core.declaration import parameter
from iptm_core.errors import RouteError
from iptm_ros.parameters import declare_parameters
from iptm_ros.process import run_node
from iptm_ros.suite_node import SuiteNode

@dataclass(frozen=True)
class Parameters:
    behaviour: str = parameter("wait", "what to do")

class Example(SuiteNode):
    def __init__(self):
        super().__init__("example")
        self.behaviour = declare_parameters(self, Parameters).behaviour
        if self.behaviour == "user_error":
            raise RouteError("file x.csv, line 3: speed is -1; allowed: at least 0")
        if self.behaviour == "defect_at_start":
            raise ZeroDivisionError("an unexpected defect")
        self.every(0.01, self.work)

    def work(self):
        print("working", flush=True)
        if self.behaviour == "finish":
            self.finish()
        if self.behaviour == "finish_badly":
            self.finish(exit_code=3)
        if self.behaviour == "defect":
            raise ZeroDivisionError("an unexpected defect")
        if self.behaviour == "shutdown":
            import rclpy
            rclpy.try_shutdown()
        if self.behaviour == "signal_twice":
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)

    def destroy_node(self):
        if self.behaviour == "signal_in_cleanup":
            signal.raise_signal(signal.SIGINT)
        super().destroy_node()
        print("destroyed", flush=True)

sys.exit(run_node(Example))
"""

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Start]:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    path = tmp_path / "example_program.py"
    path.write_text(PROGRAM)
    started: list[subprocess.Popen[str]] = []

    def run(behaviour: str, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, str(path), "--ros-args", "-p", f"behaviour:={behaviour}"]
        process = subprocess.Popen(
            [*command, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            env=environment,
            text=True,
        )
        started.append(process)
        return process

    yield run
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=120.0)
    return process.returncode, out, err


def wait_for_work(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    deadline = time.monotonic() + 120.0
    while "working" not in process.stdout.readline():
        assert time.monotonic() < deadline


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("behaviour", ["wait", "signal_in_cleanup"])
def test_signals_end_the_process_cleanly(
    start: Start, number: signal.Signals, behaviour: str
) -> None:
    process = start(behaviour)
    wait_for_work(process)
    process.send_signal(number)
    code, out, err = finish(process)
    assert (code, err) == (0, "")
    assert "destroyed" in out


@pytest.mark.parametrize(
    ("behaviour", "expected"),
    [("finish", 0), ("finish_badly", 3), ("shutdown", 0), ("signal_twice", 0)],
)
def test_a_node_can_end_itself(start: Start, behaviour: str, expected: int) -> None:
    code, out, err = finish(start(behaviour))
    assert (code, err) == (expected, "")
    assert "destroyed" in out


def test_user_error_is_one_line_and_exit_code_2(start: Start) -> None:
    code, _, err = finish(start("user_error"))
    assert code == 2
    assert err == "example_program: file x.csv, line 3: speed is -1; allowed: at least 0\n"


def test_a_defect_in_a_callback_is_logged_with_its_place_and_ends_nothing(start: Start) -> None:
    process = start("defect")
    for _ in range(3):
        wait_for_work(process)
    process.send_signal(signal.SIGINT)
    code, out, err = finish(process)
    assert code == 0
    assert err.count("Traceback") == 1
    assert "callback of the timer of work failed" in err
    assert "ZeroDivisionError: an unexpected defect" in err
    assert "destroyed" in out


def test_defect_at_start_is_logged_once_with_its_place(start: Start) -> None:
    code, _, err = finish(start("defect_at_start"))
    assert code == 1
    assert err.count("[FATAL]") == 1
    assert "ZeroDivisionError: an unexpected defect" in err
