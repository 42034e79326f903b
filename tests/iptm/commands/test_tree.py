"""The program `iptm`: one tree of commands, loaded one at a time."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

import iptm
from iptm.commands.tree import all_commands, main

COMMANDS = all_commands()
MOST_LINES = 60
"""A screen and a half of 40 lines."""
HEAVY = {"pandas", "matplotlib", "scipy", "casadi", "pyarrow", "rosbags", "iptm_ros.suite_node"}
HEAVIER = {"bench", "fmu", "judge", "meter", "traffic", "visualize"}
"""Commands whose help needs what they compute with."""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_its_function(name: str) -> None:
    module, _, function = COMMANDS[name].function.partition(":")
    assert callable(getattr(import_module(module), function))


@pytest.mark.parametrize("name", sorted(COMMANDS.keys() - HEAVIER))
def test_help_of_a_command_is_short_and_loads_nothing_heavy(name: str) -> None:
    code = (
        "import contextlib, sys; from iptm.commands.tree import main\n"
        f"with contextlib.suppress(SystemExit): main([{name!r}, '--help'])\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *shown, loaded = done.stdout.splitlines()
    assert shown[0].startswith(f"usage: iptm {name} ")
    assert len(shown) <= MOST_LINES
    assert HEAVY & set(loaded.split()) == set()


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    text = capsys.readouterr().out
    assert [name for name in COMMANDS if f"\n    {name}" not in text] == []
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"iptm {iptm.__version__}\n"


def test_an_unknown_command_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recrod"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("iptm: command 'recrod' is unknown; did you mean 'record'?")


def test_a_command_without_its_libraries_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", sys.argv)
    for name in ("iptm_ros.call", "std_srvs.srv"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "std_srvs", None)
    assert main(["call"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("iptm call: ")
    assert "needed: ROS 2" in line
