"""What is listed of a bag."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from iptm_bags.reading import info as main
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_core.trajectory import Trajectory
from iptm_ros.recording.run_information import collect_run_information


def test_run_of_the_suite(
    trajectory: Trajectory,
    write_run: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    parameters = {"model": to_flat_dict(load_parameters().values)}
    information = collect_run_information(scenario="hills", seed=5, parameters=parameters)
    bag = write_run(tmp_path / "bag", trajectory, custom_data=information.to_custom_data())
    assert main([str(bag), "--parameters"]) == 0
    text = capsys.readouterr().out
    for expected in ("hills", "/plant/odometry", "Cooling energy", "solve time (ms)", "max_gap_m"):
        assert expected in text
    assert "default parameter set" not in text


def test_foreign_bag_and_several_bags(small_bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(small_bag), str(small_bag)]) == 0
    text = capsys.readouterr().out
    assert text.count("small: topics") == 2
    assert "no figures of the run" in text


def test_missing_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "none")]) == 2
    assert "does not exist" in capsys.readouterr().err
