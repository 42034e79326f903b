"""A trip in memory and its three nodes over DDS give the same numbers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import iptm
from iptm_core.decision_record import DecisionSeries, Rung
from iptm_core.settings import LeaderSource
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_core.units import KM_H_PER_M_S
from iptm_ros.diagnostics import PROCESS, status_values
from iptm_ros.recording.bag_reader import BagReader

TICKS = 120
# Relative to the range of each quantity over the trip. So far all trips were equal to the last bit; but
# messages carry temperatures in degC, which may cost the last bit of a kelvin, and solvers amplify.
TOLERANCE = 1e-9

IMPERFECT = iptm.Trip.of(
    "nycc",
    slope="small",
    duration_s=float(TICKS),
    strategy="aging",
    horizon="15x1",
    vehicle="textbook_cell",
    overrides={"body.mass_kg": 1600.0, "gap.max_gap_m": 80.0},
    controller_overrides={"body.mass_kg": 1500.0},
    latency_s=2.0,
    dropout_probability=0.3,
    dropout_burst=3,
    noise_std_m_s=1.0,
    seed=11,
)
EMPTY = iptm.Trip.of(
    "us06",
    duration_s=float(TICKS),
    strategy={"base": "aging", "aging_weight": 2e9},
    leader_source=LeaderSource.NONE,
    speed_limits_km_h="0:50, 700:80",
    signals="300:100:40:30",
)
"""An empty road with a line that is closed until 40 s."""


PACED = IMPERFECT.changed(pace=60.0)
"""In lock-step at a pace, as a trip is that is watched."""


@pytest.mark.parametrize("trip", [IMPERFECT, EMPTY, PACED], ids=["imperfect", "empty", "paced"])
def test_a_trip_in_memory_equals_the_trip_over_ros(trip: iptm.Trip, tmp_path: Path) -> None:
    """With perfect previews, see `test_string`; with faults, `test_faults_over_ros`."""
    bag = tmp_path / "bag"
    nodes, memory = iptm.drive(trip, over="ros", bag=bag), iptm.drive(trip)
    assert not nodes.problems
    assert nodes.settings == memory.settings
    assert_same_trip(memory.trajectory, nodes.trajectory)
    assert_same_decisions(memory.decisions, nodes.decisions)
    loaded = iptm.load(bag)
    assert loaded.trip == trip
    assert loaded.frame.equals(nodes.frame)
    if trip is EMPTY:
        assert_free_road(memory.trajectory, memory.decisions, bag)


@pytest.mark.parametrize("given", [[], ["--processes"]])
def test_nodes_in_one_process_or_several_drive_the_same_trip(
    tmp_path: Path, given: list[str]
) -> None:
    file, bag = tmp_path / "trip.yaml", tmp_path / "bag"
    file.write_text(iptm.trip_text(IMPERFECT))
    options = [str(file), *given, "--no-picture", "--output", str(bag)]
    command = [sys.executable, "-m", "iptm_core", "iptm.commands.run", *options]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    memory, nodes = iptm.drive(IMPERFECT), iptm.load(bag)
    assert_same_trip(memory.trajectory, nodes.trajectory)
    assert_same_decisions(memory.decisions, nodes.decisions)
    processes: dict[str, set[str]] = {}
    with BagReader(bag) as reader:
        for each in reader.messages(["/diagnostics"]):
            for status in each.message.status:
                name = status.name.partition(":")[0]
                processes.setdefault(name, set()).add(status_values(status)[PROCESS])
    nodes_of = {name: processes[f"/{name}"] for name in ("plant", "v2x_bridge", "controller")}
    assert len({*map(frozenset, nodes_of.values())}) == (len(nodes_of) if given else 1)
    assert processes["/recorder"] not in nodes_of.values()


def assert_free_road(run: Trajectory, decisions: DecisionSeries, bag: Path) -> None:
    """No vehicle is ahead of the ego vehicle, and it drives by plans alone, past the line once it is open."""
    with BagReader(bag) as reader:
        counts = {name: topic.message_count for name, topic in reader.topics.items()}
    assert counts.get("/v2x/leader", 0) == 0
    assert counts["/v2x/road_ahead"] == TICKS + 1
    assert set(decisions.rung) == {Rung.OPTIMAL}
    assert run.position_m[run.time_s <= 40.0].max() <= 300.0
    assert run.position_m[-1] > 800.0
    limits = np.where(run.position_m < 700.0, 50.0, 80.0) / KM_H_PER_M_S
    assert np.all(run.speed_m_s <= limits + 0.01)


def assert_same_trip(here: Trajectory, there: Trajectory) -> None:
    assert len(here) == len(there) == TICKS + 1
    for name in TRAJECTORY_COLUMNS:
        one, other = getattr(here, name), getattr(there, name)
        known = ~np.isnan(one)
        np.testing.assert_array_equal(known, ~np.isnan(other), err_msg=name)
        one, other = one[known], other[known]
        if not known.any():
            continue
        scale = max(float(np.ptp(one)), 1e-3 * float(np.max(np.abs(one))), 1e-12)
        worst = float(np.max(np.abs(one - other))) / scale
        assert worst <= TOLERANCE, f"{name} differs by {worst:g} of its range"


def assert_same_decisions(here: DecisionSeries, there: DecisionSeries) -> None:
    """The controller also answers the last state, which has no subscriber any more."""
    for name in ("status", "rung", "iterations"):
        np.testing.assert_array_equal(
            getattr(there, name)[:TICKS], getattr(here, name), err_msg=name
        )
