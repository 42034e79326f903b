"""Runs that are started in the same second: each ends with its results or refuses, and nothing is lost."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from iptm_ros.recording.trajectory_reader import read_trajectory

MODULE = "iptm.commands.run"
TICKS = 10
OPTIONS = ("demo", "--duration-s", str(TICKS), "--no-picture")
LONG_ENOUGH = ("--set", "conditions.pace=2")
"""Two runs of one domain overlap, however late the second one starts."""
RUN_TIMEOUT_S = 120.0


@pytest.mark.parametrize("rounds", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_four_runs_of_the_same_second(launcher: Any, tmp_path: Path, rounds: int) -> None:
    """Of two runs in one domain, or in one folder, one is driven; the other is refused in one line."""
    for number in range(rounds):
        root, output = tmp_path / f"root_{number}", tmp_path / f"folder_{number}"
        any_domain = ("--output", output)
        runners = [
            *(
                launcher.start_module(MODULE, *OPTIONS, *LONG_ENOUGH, IPTM_ROOT=str(root))
                for _ in range(2)
            ),
            *(
                launcher.start_module(MODULE, *OPTIONS, *any_domain, ROS_DOMAIN_ID="")
                for _ in range(2)
            ),
        ]
        codes = [runner.wait(RUN_TIMEOUT_S) for runner in runners]
        texts = [runner.stdout + runner.stderr for runner in runners]
        for pair, reason in ((slice(2), "is in use by process"), (slice(2, 4), "exists already")):
            assert sorted(codes[pair]) == [0, 2], texts
            (refused,) = [runner for runner in runners[pair] if runner.popen.returncode == 2]
            (line,) = refused.stderr.splitlines()
            assert reason in line
        assert all(not runner.stderr for runner in runners if runner.popen.returncode == 0)
        for folder in (*root.glob("bags/*"), output):
            assert json.loads((folder / "results.json").read_text(encoding="utf-8"))["good"]
            assert read_trajectory(folder).time_s[-1] == TICKS


def test_nodes_of_another_trip_in_the_domain_end_the_run_with_the_reason(
    launcher: Any, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    """Nodes that are started by hand hold no lock. Before, the run named a loss of messages that was none."""
    pace = ("--mode", "real_time", "--rate-factor", "5")
    runner = launcher.start_module(MODULE, "demo", *pace, "--output", tmp_path / "run")
    wait_until(lambda: " of 120 s (" in runner.stdout, RUN_TIMEOUT_S, "the begin of the trip")
    trip = {"mode": "real_time", "rate_factor": 200.0, "duration_s": 1800.0}
    launcher.start_node("iptm_plant_sim.node", parameters=trip)
    assert runner.wait(RUN_TIMEOUT_S) == 1
    assert " s of a trip of 120 s: nodes of another run take part" in runner.stderr
