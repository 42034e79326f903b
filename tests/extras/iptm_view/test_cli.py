"""Mistakes on the command line of the view are reported in one line."""

from __future__ import annotations

import pytest

from iptm_view.view import main


@pytest.mark.parametrize("mistake", [["--params-file", "/nonexistent.yaml"], ["-p", "foo"]])
def test_malformed_ros_arguments_are_one_line(
    mistake: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", "--no-browser", "--ros-args", *mistake]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "allowed" in line


def test_a_bag_is_shown_of_one_vehicle(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["view", "--no-foxglove", "a_bag", "--namespace", "car_1", "--namespace", "/car_2"]
    assert main(command) == 2
    assert (
        capsys.readouterr().err
        == "iptm view: --namespace is car_1, car_2; allowed: one with a bag\n"
    )
