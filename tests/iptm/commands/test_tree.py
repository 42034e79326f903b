"""The program `iptm`: one tree of commands, loaded one at a time."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import iptm
from iptm.commands.tree import COMMANDS, main

BAG = Path(__file__).parents[3] / "bags" / "example_us06_120s"


def test_every_command_has_its_module() -> None:
    assert [name for name, each in COMMANDS.items() if find_spec(each.module) is None] == []


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    text = capsys.readouterr().out
    assert [name for name in COMMANDS if f"\n    {name}" not in text] == []
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"iptm {iptm.__version__}\n"


def test_help_and_the_options_of_run_load_nothing_heavy() -> None:
    code = (
        "import sys; from iptm.commands import run, tree; run.build_parser(); tree.build_parser();"
        "print([name for name in ('pandas', 'matplotlib', 'casadi', 'rclpy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_an_unknown_command_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["comapre"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "iptm: command 'comapre' is unknown; did you mean 'compare'?"


def test_bags_are_compared_by_figures_or_message_by_message(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["compare", str(BAG), str(BAG)]) == 0
    assert "the settings do not differ" in capsys.readouterr().out
    assert main(["compare", "--exact", str(BAG), str(BAG)]) == 0
    assert "/plant/state" in capsys.readouterr().out


def test_the_completion_names_commands_options_and_settings(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["completion"]) == 0
    text = capsys.readouterr().out
    for word in ("recover", "--duration-s", "leader.latency_s=", "conditions.faults="):
        assert word in text
    subprocess.run(["bash", "-n"], input=text, text=True, check=True)
