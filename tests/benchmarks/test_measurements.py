"""Each measurement on the smallest input that makes sense."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest
from benchmarks import closed_loop_equivalence, closed_loop_speed, node_scaling, ros_change
from benchmarks.deadline_under_load import busy_processes, paced
from benchmarks.harness import machine_description, timed

from iptm_controller.controller import Controller
from iptm_core.errors import ScenarioError


def test_sleeping_takes_wall_time_only() -> None:
    _, elapsed = timed(lambda: time.sleep(0.02))
    assert elapsed.wall_s >= 0.02
    assert elapsed.processor_s < elapsed.wall_s


def test_the_machine_is_described_without_its_name() -> None:
    description = machine_description()
    assert int(description["cores"]) >= 1
    assert not any("/" in value for key, value in description.items() if key == "processor")


def test_shares_of_the_loop_add_up_and_nothing_stays_patched() -> None:
    original = Controller.decide
    numbers = closed_loop_speed.measure("nycc", "2x1+1x5", "aging", "riccati", 8.0)
    assert Controller.decide is original
    assert numbers["ticks"] == 8
    assert sum(numbers["processor_share"].values()) == pytest.approx(1.0)
    assert sum(numbers["statuses"].values()) == 8


def test_both_solvers_drive_the_same_trip() -> None:
    numbers = closed_loop_equivalence.measure("us06", "2x1+1x5", "aging", 20.0)
    assert len(numbers["rows"]) == len(closed_loop_equivalence.KEYS)
    assert numbers["largest_relative_change"] < 1e-2


def test_growth_with_nodes_is_fitted() -> None:
    numbers = node_scaling.measure(("2x1", "4x1"), ("riccati",), 2)
    assert [row["nodes"] for row in numbers["rows"]] == [2, 4]
    assert math.isfinite(numbers["fits"]["riccati"]["per_node_us"])


def test_a_paced_loop_counts_its_ticks() -> None:
    numbers = paced(3, 0.01, 5.0, 0)
    assert numbers["ticks"] == sum(numbers["statuses"].values()) == 3
    assert 0 <= numbers["overruns"] <= 3


def test_busy_processes_end_with_their_context() -> None:
    with busy_processes(1):
        pass


def test_a_change_is_measured_against_a_checkout(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="set up"):
        ros_change.measure(str(tmp_path))
