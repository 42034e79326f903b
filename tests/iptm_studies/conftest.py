"""Runs to test with: a hand-made one that costs nothing, and a short real one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iptm_core.decision_record import DecisionSeries
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_studies.run_inputs import RunInputs, resolve_inputs, run_key
from iptm_studies.run_spec import RunSpec
from iptm_studies.single_run import FinishedRun, WallTimes, perform_run
from iptm_studies.store import ResultStore
from iptm_studies.stored_run import StoredRun, stored_run

TICKS = 5


@pytest.fixture(scope="session")
def short_spec() -> RunSpec:
    """A few seconds of a lively cycle."""
    return RunSpec(cycle="us06", slope="small", duration_s=float(TICKS), horizon="3x1+5x5")


@pytest.fixture(scope="session")
def short_inputs(short_spec: RunSpec) -> RunInputs:
    return resolve_inputs(short_spec)


@pytest.fixture(scope="session")
def short_run(short_inputs: RunInputs) -> FinishedRun:
    """The real thing."""
    return perform_run(short_inputs)


def _trajectory(rows: int) -> Trajectory:
    time_s = np.arange(rows, dtype=float)
    columns = {name: 0.01 * index + time_s for index, name in enumerate(TRAJECTORY_COLUMNS)}
    columns |= {
        "time_s": time_s,
        "speed_m_s": np.full(rows, 10.0),
        "position_m": 10.0 * time_s,
        "leader_position_m": 30.0 + 10.0 * time_s,
        "leader_speed_m_s": np.full(rows, 10.0),
        "acceleration_m_s2": np.zeros(rows),
        "compressor_power_w": np.zeros(rows),
        "cell_1_capacity_loss": 1e-3 + 1e-9 * time_s,
        "cell_n_capacity_loss": 1e-3 + 2e-9 * time_s,
        **{
            name: np.full(rows, 303.15)
            for name in TRAJECTORY_COLUMNS
            if name.endswith("temperature_k")
        },
    }
    return Trajectory.from_arrays(columns)


def _decisions(ticks: int) -> DecisionSeries:
    return DecisionSeries(
        time_s=np.arange(float(ticks)),
        status=np.array([0, 0, 1, -1, 2][:ticks]),
        rung=np.array([0, 0, 0, 2, 1][:ticks]),
        iterations=np.array([4, 6, 150, 0, 150][:ticks]),
        solve_time_s=np.array([0.001, 0.002, 0.003, np.nan, 0.004][:ticks]),
        gap_slack_m=np.array([0.0, 0.5, 0.25, np.nan, np.nan][:ticks]),
        speed_slack_m_s=np.zeros(ticks),
        temperature_slack_k=np.full(ticks, np.nan),
        limiter_active=np.array([False, True, False, False, True][:ticks]),
        objective=np.arange(float(ticks)),
        preview_age_s=np.zeros(ticks),
    )


@pytest.fixture(scope="session")
def made_run() -> FinishedRun:
    """A run made by hand, with a bit of everything in its decisions."""
    return FinishedRun(
        _trajectory(TICKS + 1), _decisions(TICKS), None, WallTimes(0.5, 2.0), compiled=True
    )


@pytest.fixture
def store(tmp_path: Path) -> ResultStore:
    return ResultStore(tmp_path / "results")


@pytest.fixture(scope="session")
def stored(made_run: FinishedRun) -> Callable[..., StoredRun]:
    """Give the function that makes a stored run of the hand-made results for a specification."""

    def make(inputs: RunInputs, loss_factor: float = 1.0) -> StoredRun:
        columns = made_run.trajectory.to_arrays()
        for name in ("cell_1_capacity_loss", "cell_n_capacity_loss"):
            columns[name] = 1e-3 + loss_factor * (columns[name] - 1e-3)
        finished = replace(made_run, trajectory=Trajectory.from_arrays(columns))
        return stored_run(run_key(inputs), inputs, finished, "2026-01-01T00:00:00+00:00")

    return make


STUDY = """
title: A test
defaults: {cycle: us06, duration_s: 5, horizon: 3x1+5x5}
cases:
  - name: aging
    run: {strategy: aging}
  - name: reference
    run: {strategy: reference}
"""


@pytest.fixture
def study_file(tmp_path: Path) -> Callable[..., Path]:
    """Give the function that writes a study file."""

    def write(text: str = STUDY, name: str = "mini.yaml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
