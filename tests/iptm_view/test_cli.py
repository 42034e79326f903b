"""Mistakes on the command line of the view are told in one line."""

from __future__ import annotations

import pytest

from iptm_view.cli import main


@pytest.mark.parametrize("mistake", [["--params-file", "/nonexistent.yaml"], ["-p", "foo"]])
def test_malformed_ros_arguments_are_one_line(
    mistake: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", "--no-browser", "--ros-args", *mistake]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "allowed" in line
