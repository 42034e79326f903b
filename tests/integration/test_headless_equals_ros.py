"""The loop of the studies and the three nodes over DDS give the same numbers."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from iptm.studies.run import perform_run
from iptm.studies.run_spec import RunSpec
from iptm.studies.study import planned_run
from iptm_core.decision_record import DecisionSeries, Rung
from iptm_core.declaration import plain
from iptm_core.parameters.model import KM_H_PER_M_S
from iptm_core.settings import LeaderSource
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.trajectory_reader import read_decisions, read_trajectory

TICKS = 120
RUN_TIMEOUT_S = 240.0
# Relative to the range of each quantity over the trip. So far all trips were equal to the last bit; but
# messages carry temperatures in degC, which may cost the last bit of a kelvin, and solvers amplify.
TOLERANCE = 1e-9

IMPERFECT = RunSpec(
    cycle="nycc",
    slope="small",
    duration_s=float(TICKS),
    horizon="15x1",
    parameter_set="textbook_cell",
    overrides=(("body.mass_kg", 1600.0), ("gap.max_gap_m", 80.0)),
    latency_s=2.0,
    dropout_probability=0.3,
    dropout_burst=3,
    noise_std_m_s=1.0,
    seed=11,
)


EMPTY = RunSpec(
    cycle="us06",
    duration_s=float(TICKS),
    horizon="3x1+5x5",
    leader_source=LeaderSource.NONE,
    speed_limits_km_h="0:50, 700:80",
    signals="300:100:40:30",
)
"""An empty road with a line that is closed until 40 s."""


def options_of(spec: RunSpec) -> list[str]:
    """Options of the run over ROS 2 that mean the same."""
    options: dict[str, object] = {
        "cycle": spec.cycle,
        "slope": spec.slope,
        "duration-s": spec.duration_s,
        "parameter-set": spec.parameter_set,
        "overrides": ",".join(f"{key}={value!r}" for key, value in spec.overrides),
        "strategy": spec.strategy.name,
        "horizon": spec.horizon,
        "solver": spec.solver,
        **{
            name.replace("_", "-"): plain(value)
            for group in (spec.bridge_settings(), spec.road)
            for name, value in asdict(group).items()
        },
    }
    return [part for name, value in options.items() for part in (f"--{name}", str(value))]


@pytest.mark.parametrize("spec", [IMPERFECT, EMPTY], ids=["imperfect", "empty"])
def test_headless_run_equals_the_run_over_ros(spec: RunSpec, launcher: Any, tmp_path: Path) -> None:
    """With perfect previews, see `test_string`; with faults, `test_faults_over_ros`."""
    bag = tmp_path / "bag"
    arguments = (*options_of(spec), "--no-picture", "--output", bag)
    runner = launcher.start_module("iptm.runner.run_closed_loop", *arguments)
    headless = perform_run(planned_run(spec))
    assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr

    assert_same_trip(headless.trajectory, read_trajectory(bag))
    assert headless.decisions is not None
    assert_same_decisions(headless.decisions, read_decisions(bag))
    if spec is EMPTY:
        assert_free_road(headless.trajectory, headless.decisions, bag)


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
