"""Runs to test with: a hand-made one that costs nothing, and a short real one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from iptm.studies import cli
from iptm.studies.campaign import Campaign, admit
from iptm.studies.execution import ProgressDisplay
from iptm.studies.run import Run, perform_run
from iptm.studies.run_spec import RunSpec
from iptm.studies.store import ResultStore
from iptm.studies.study import Case, planned_run
from iptm.studies.workers import Failed
from iptm_core.decision_record import DecisionSeries
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

TICKS = 5


@pytest.fixture(scope="session")
def short_spec() -> RunSpec:
    """A few seconds of a lively cycle."""
    return RunSpec(cycle="us06", slope="small", duration_s=float(TICKS), horizon="3x1+5x5")


@pytest.fixture(scope="session")
def short_inputs(short_spec: RunSpec) -> Case:
    return planned_run(short_spec)


@pytest.fixture(scope="session")
def short_run(short_inputs: Case) -> Run:
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
        "service_braking_s": np.zeros(rows),
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
        objective=np.full(ticks, np.nan),
        preview_age_s=np.zeros(ticks),
        cell_1_marginal_cost_1_k=np.full(ticks, 1.5),
        cell_n_marginal_cost_1_k=np.full(ticks, 4.5),
        aging_rate_1_s=np.full(ticks, 8e-10),
        aging_sensitivity_1_k=np.full(ticks, 0.024),
        temperature_decay_time_s=np.full(ticks, 400.0),
        trusted_preview_s=np.full(ticks, 60.0),
        command_delay_s=np.zeros(ticks),
        brake_share=np.ones(ticks),
        solve_wall_time_s=np.full(ticks, 0.005),
        status=np.array([0, 0, 1, -1, 2][:ticks]),
        rung=np.array([0, 0, 0, 2, 1][:ticks]),
        iterations=np.array([4, 6, 150, 0, 150][:ticks]),
        solve_time_s=np.array([0.001, 0.002, 0.003, 0.0, 0.004][:ticks]),
        gap_slack_m=np.array([0.0, 0.5, 0.25, np.nan, np.nan][:ticks]),
        speed_slack_m_s=np.zeros(ticks),
        temperature_slack_k=np.full(ticks, np.nan),
        limiter_active=np.array([False, True, False, False, True][:ticks]),
    )


@pytest.fixture(scope="session")
def make_run() -> Callable[..., Run]:
    """Give the function that makes up a run of a specification, with a bit of everything in it."""

    def make(inputs: Case, loss_factor: float = 1.0) -> Run:
        columns = _trajectory(TICKS + 1).to_arrays()
        for name in ("cell_1_capacity_loss", "cell_n_capacity_loss"):
            columns[name] = 1e-3 + loss_factor * (columns[name] - 1e-3)
        return Run(
            key=inputs.key,
            spec=inputs.spec,
            parameters=inputs.parameters,
            trajectory=Trajectory.from_arrays(columns),
            decisions=_decisions(TICKS),
            whole_trip=None,
            wall_time_s=2.5,
            compiled=True,
            finished_at_utc="2026-01-01T00:00:00+00:00",
            git_revision="unknown",
            versions={"python": "3.11"},
            fingerprint=inputs.fingerprint,
        )

    return make


@pytest.fixture(scope="session")
def made_run(make_run: Callable[..., Run], short_inputs: Case) -> Run:
    return make_run(short_inputs)


@pytest.fixture(scope="session")
def assert_same() -> Callable[..., None]:
    """Give the function that compares two runs bit for bit, but for the times that solves took."""

    def compare(one: Run, other: Run) -> None:
        for name, values in one.trajectory.to_arrays().items():
            np.testing.assert_array_equal(values, getattr(other.trajectory, name), name)
        for name in set(vars(one.decisions)) - {"solve_time_s", "solve_wall_time_s"}:
            values = getattr(one.decisions, name)
            np.testing.assert_array_equal(values, getattr(other.decisions, name), name)

    return compare


@pytest.fixture
def store(tmp_path: Path) -> ResultStore:
    return ResultStore(tmp_path / "results")


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


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch, make_run: Callable[..., Run]) -> None:
    """Runs that are computed here, at once; those of the reference fail."""

    def execute_here(
        campaign: Campaign, store: ResultStore, workers: int, display: ProgressDisplay
    ) -> int:
        del workers
        missing = admit(campaign, store)
        found = campaign.finished
        for inputs in missing:
            display.planned(inputs, 1.0)
            if inputs.spec.strategy.name == "reference":
                campaign.fail(inputs.key, "it went nowhere")
                store.note_failure(inputs.key, "it went nowhere")
                display.ended(inputs, Failed("it went nowhere"))
                continue
            run = make_run(inputs)
            store.save(run)
            campaign.finish(run)
            display.ended(inputs, run)
        display.remaining(0.0)
        return campaign.finished - found

    monkeypatch.setattr(cli, "execute", execute_here)
