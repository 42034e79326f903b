"""Runs with a node of the user's: figures come from what it publishes, and what is missing is named."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.benchmark.foreign import of_class
from studies.benchmark.judge import ROWS
from studies.benchmark.library import both_judges

import iptm
from iptm_bags.bag_info import result_tables
from iptm_ros.recording.bag_reader import BagReader

MODULE = "iptm.commands.run"
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
ROAD = {"cycle": "us06", "slope": "small"}
OPTIONS = (
    "--cycle", "us06", "--slope", "small", "--duration-s", "20", "--no-picture", "--against", "reference"
)  # fmt: skip
RUN_TIMEOUT_S = 180.0


@pytest.mark.parametrize(
    "node", ["controller", "plant", pytest.param("v2x_bridge", marks=pytest.mark.slow)]
)
def test_a_run_waits_for_a_node_of_the_users_and_reports_its_figures(
    launcher: Any, tmp_path: Path, wait_until: Callable[..., None], node: str
) -> None:
    output = tmp_path / "run"
    runner = launcher.start_module(MODULE, *OPTIONS, "--without", node, "--output", output)
    wait_until(
        lambda: f"waiting for your own {node}" in runner.stdout, RUN_TIMEOUT_S, "the introduction"
    )
    example = EXAMPLES / f"own_{node}.py"
    if example.exists():
        launcher.start(f"own_{node}", sys.executable, example)
    else:
        launcher.start_node("iptm_v2x_bridge.node", parameters=ROAD)
    assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    summary = results["summary"]
    assert f"own {node}" in results["run"]
    assert ("aging_cost_to_go" in results["run"]) is (node != "controller")
    assert summary["energy_kwh"] > 0.0
    assert summary["consumption_kwh_per_100_km"] > 0.0
    assert (summary["decisions"] > 0.0) is (node != "controller")
    # What a plant of the user's does cannot be compared with the reference on the plant of the suite.
    assert ("aging_saved_percent" in summary) is (node != "plant")
    # The bag gives figures, too.
    with BagReader(output) as reader:
        assert result_tables(reader)[0].row_count > 20
    if node == "controller":
        assert_as_the_class_in_python(iptm.load(output))


def assert_as_the_class_in_python(recorded: iptm.Run) -> None:
    """The law of the example in memory: the same rows, and both judges of the benchmark read the bag."""
    law = of_class(EXAMPLES / "benchmark" / "follower.py", "Follower")
    driven = iptm.simulate("us06", slope="small", duration_s=20.0, controller=law)
    rows = recorded.trajectory.to_arrays()
    for name in ROWS:
        own = getattr(driven.trajectory, name)
        np.testing.assert_allclose(rows[name], own, rtol=1e-6, atol=1e-6, err_msg=name)
    found, by_library = both_judges(recorded, iptm.Trip.of("us06", slope="small", duration_s=20.0))
    # A thousandth of the cost is a tenth of a point.
    assert found.eur == pytest.approx(by_library.eur, rel=1e-3)


def test_a_node_of_the_users_and_faults_are_refused(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    scenario = tmp_path / "faulty.yaml"
    scenario.write_text("conditions: {faults: [{kind: preview_lost, start_s: 5, duration_s: 5}]}\n")
    line = refused(MODULE, scenario, "--without", "plant", "--output", tmp_path / "run")
    assert "--without is plant for a trip with faults" in line
