"""Runs that are started in the same second: each ends with its results or refuses, and nothing is lost."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from iptm_recording.trajectory_reader import read_trajectory

MODULE = "iptm_bringup.run_closed_loop"
TICKS = 10
OPTIONS = ("demo", "--duration-s", str(TICKS), "--no-picture")
RUN_TIMEOUT_S = 120.0


def assert_results_or_refusal(runners: list[Any], root: Path, folders: str, refused: int) -> None:
    """Check that all but some runs have good results in folders of their own; the others report why."""
    codes = [runner.wait(RUN_TIMEOUT_S) for runner in runners]
    texts = [runner.stdout + runner.stderr for runner in runners]
    assert sorted(codes) == [0] * (len(runners) - refused) + [2] * refused, texts
    for code, runner in zip(codes, runners, strict=True):
        assert len(runner.stderr.splitlines()) == (code == 2), runner.stderr
    found = sorted(root.glob(folders))
    assert len(found) == len(runners) - refused
    for folder in found:
        assert json.loads((folder / "results.json").read_text(encoding="utf-8"))["good"]
        assert read_trajectory(folder).time_s[-1] == TICKS


@pytest.mark.parametrize("rounds", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_two_runs_of_the_same_second(launcher: Any, tmp_path: Path, rounds: int) -> None:
    """In domains and folders of their choice both are driven; in one domain or one folder, one of them."""
    for number in range(rounds):
        root = tmp_path / f"free_{number}"
        free = {"IPTM_ROOT": str(root), "ROS_DOMAIN_ID": ""}
        runners = [launcher.start_module(MODULE, *OPTIONS, **free) for _ in range(2)]
        assert_results_or_refusal(runners, root, "bags/*", refused=0)

        root = tmp_path / f"one_domain_{number}"
        runners = [launcher.start_module(MODULE, *OPTIONS, IPTM_ROOT=str(root)) for _ in range(2)]
        assert_results_or_refusal(runners, root, "bags/*", refused=1)
        assert sum("is in use by process" in runner.stderr for runner in runners) == 1

        output = tmp_path / f"one_folder_{number}"
        runners = [
            launcher.start_module(MODULE, *OPTIONS, "--output", output, ROS_DOMAIN_ID="")
            for _ in range(2)
        ]
        assert_results_or_refusal(runners, tmp_path, output.name, refused=1)
        assert sum("exists already" in runner.stderr for runner in runners) == 1


def test_nodes_of_another_trip_in_the_domain_end_the_run_with_the_reason(
    launcher: Any, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    """Nodes that are started by hand hold no lock. Before, the run named a loss of messages that was none."""
    pace = ("--mode", "real_time", "--rate-factor", "5")
    runner = launcher.start_module(MODULE, "demo", *pace, "--output", tmp_path / "run")
    wait_until(lambda: " of 120 s (" in runner.stdout, RUN_TIMEOUT_S, "the begin of the trip")
    trip = {"mode": "real_time", "rate_factor": 1000.0, "duration_s": 1800.0, "expected_peers": 1}
    launcher.start_node("iptm_plant_sim.node", parameters=trip)
    assert runner.wait(RUN_TIMEOUT_S) == 1
    assert " s of a trip of 120 s: nodes of another run take part" in runner.stderr
