"""The command line of a node: help that names every parameter, and no silently ignored argument."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from iptm_core.declaration import parameter
from iptm_ros.command_line import node_main
from iptm_ros.suite_node import SuiteNode


@dataclass(frozen=True)
class Parameters:
    limit_s: float = parameter(1.0, "some limit", "s", 0.0, 2.0)
    mode: str = parameter("fast", "how it goes", choices=("fast", "slow"))
    enabled: bool = parameter(default=True, description="whether it goes")


class Example(SuiteNode):
    """Does nothing at all.

    Not even later.
    """

    def __init__(self) -> None:
        raise AssertionError("the node must not be built to explain it")


@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_names_each_parameter(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert node_main("example", Example, Parameters, ["example", option]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("usage: example ")
    assert "Does nothing at all.\n\nNot even later.\n" in shown
    assert "limit_s (default: 1.0 s)\n      some limit; a number from 0 to 2 s" in shown
    assert "mode (default: 'fast')" in shown
    assert "one of fast, slow" in shown
    assert "enabled (default: true)" in shown


def test_help_wins_over_ros_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["example", "--help", "--ros-args", "-p", "limit_s:=9.0"]
    assert node_main("example", Example, Parameters, command) == 0
    assert "usage:" in capsys.readouterr().out


@pytest.mark.parametrize("stray", ["--fast", "-p", "limit_s:=1.0"])
def test_stray_argument_is_refused(stray: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Without --ros-args, ROS would drop a parameter without a word."""
    command = ["example", stray, "--ros-args", "-p", "mode:=slow"]
    assert node_main("example", Example, Parameters, command) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"example: argument {stray!r} is unknown; allowed: --help")
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["--params-file", "/nonexistent.yaml"],
        ["--params-file", "/"],
        ["--params-file"],
        ["-p", "foo"],
        ["-p", "a:=[1,b"],
        ["-p"],
        ["-r", "foo"],
        ["-r", "__ns:=1bad"],
        ["-r", "__node:=a/b"],
        ["--remap"],
        ["--log-level", "nosuch"],
        ["--foo"],
    ],
)
def test_a_mistake_in_the_ros_arguments_is_one_line(
    arguments: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    assert node_main("example", Example, Parameters, ["example", "--ros-args", *arguments]) == 2
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "[rcl]" not in line]
    assert line.startswith("example: ")
    assert "; allowed: -p NAME:=VALUE" in line
    assert " at /" not in line
