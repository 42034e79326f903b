"""Campaigns on a real cluster of worker processes: computed once, resumed, and robust."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import dask
import numpy as np
import pytest
from distributed import LocalCluster

from iptm_core.errors import ScenarioError, StateError
from iptm_studies import cluster as cluster_module
from iptm_studies import execution
from iptm_studies.campaign import Campaign, PlannedRun, plan_campaign
from iptm_studies.cluster import ClusterOptions
from iptm_studies.execution import Outcome, Perform, execute, survey
from iptm_studies.expected_time import ExpectedTimes
from iptm_studies.run_inputs import RunInputs
from iptm_studies.single_run import FinishedRun, perform_run
from iptm_studies.store import ResultStore
from iptm_studies.stored_run import StoredRun
from iptm_studies.worker import _watched, work

WriteFile = Callable[..., Path]

# Dask closes what it opened in the background, after the test that opened it.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

STUDY = """
title: Tiny runs
defaults: {cycle: us06, duration_s: 4, horizon: 3x1+5x5}
cases:
  - name: aging
    run: {strategy: aging}
  - name: the_same
    run: {strategy: aging}
  - name: close
    run: {strategy: aging, overrides: {gap.max_gap_m: 80}}
"""
FAILING = """
  - name: weak_pack
    run: {overrides: {pack.open_circuit_voltage_v: 60, cooling.auxiliary_power_w: 10000}}
"""


@dataclass
class Notes:
    """An observer that remembers."""

    planned_runs: list[str] = field(default_factory=list)
    finished_runs: list[str] = field(default_factory=list)
    failed_runs: dict[str, str] = field(default_factory=dict)
    times_left_s: list[float] = field(default_factory=list)

    def planned(self, run: PlannedRun, expected_s: float) -> None:
        assert expected_s > 0.0
        self.planned_runs.append(run.address)

    def finished(self, run: PlannedRun, expected_s: float, stored: StoredRun) -> None:
        assert expected_s > 0.0
        assert stored.key == run.key
        self.finished_runs.append(run.address)

    def failed(self, run: PlannedRun, expected_s: float, cause: str) -> None:
        assert expected_s > 0.0
        self.failed_runs[run.address] = cause

    def remaining(self, seconds: float) -> None:
        self.times_left_s.append(seconds)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """An existing cluster that several tests share."""
    with (
        dask.config.set(cluster_module.SETTINGS),
        LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as existing,
    ):
        yield existing.scheduler_address


def run_study(
    path: Path, store: ResultStore, options: ClusterOptions, perform: Perform = work
) -> tuple[Outcome, Campaign, Notes]:
    campaign, notes = plan_campaign([path]), Notes()
    outcome = execute(campaign, store, options, notes, perform)
    return outcome, campaign, notes


def test_computed_once_resumed_and_recomputed_where_needed(
    store: ResultStore, study_file: WriteFile, caplog: pytest.LogCaptureFixture
) -> None:
    embedded = ClusterOptions(workers=2)
    path = study_file(STUDY + FAILING)
    outcome, campaign, notes = run_study(path, store, embedded)
    assert (outcome.computed, outcome.found, outcome.failed) == (2, 0, 1)
    assert sorted(notes.finished_runs) == ["mini/aging", "mini/close"]
    assert list(notes.failed_runs) == ["mini/weak_pack"]
    assert "pack cannot supply" in notes.failed_runs["mini/weak_pack"]
    assert notes.times_left_s[-1] == 0.0
    cases = {state.case.name: state for state in campaign.cases()}
    assert cases["aging"].key == cases["the_same"].key
    assert cases["weak_pack"].metrics is None
    assert "pack cannot supply" in cases["weak_pack"].reason

    # The numbers of a worker are those of this process.
    stored = store.load(str(cases["close"].key))
    here = perform_run(next(r.inputs for r in plan_runs(path) if r.address == "mini/close"))
    for name, values in here.trajectory.to_arrays().items():
        np.testing.assert_array_equal(getattr(stored.trajectory, name), values)
    assert stored.decisions is not None
    assert here.decisions is not None
    np.testing.assert_array_equal(stored.decisions.iterations, here.decisions.iterations)

    # The same again: nothing is computed but the failed run, which gets another chance.
    outcome, _, notes = run_study(path, store, embedded)
    assert (outcome.computed, outcome.found, outcome.failed) == (0, 2, 1)

    # Another parameter in one case, another case gone: one run is computed.
    outcome, _, notes = run_study(
        study_file(STUDY.replace("max_gap_m: 80", "max_gap_m: 90")), store, embedded
    )
    assert (outcome.computed, outcome.found) == (1, 1)
    assert notes.finished_runs == ["mini/close"]

    # A damaged entry is computed anew, with a notice.
    store.path_of(str(cases["aging"].key)).write_bytes(b"PAR1 nonsense")
    with caplog.at_level(logging.WARNING):
        outcome, _, notes = run_study(study_file(STUDY), store, embedded)
    assert "computed anew" in caplog.text
    assert (outcome.computed, outcome.found) == (1, 1)
    assert notes.finished_runs == ["mini/aging"]


def plan_runs(path: Path) -> tuple[PlannedRun, ...]:
    return plan_campaign([path]).take()


def test_nothing_to_do_needs_no_cluster(
    store: ResultStore, study_file: WriteFile, stored: Callable[..., StoredRun]
) -> None:
    path = study_file(STUDY)
    for run in plan_runs(path):
        store.save(stored(run.inputs))
    nowhere = ClusterOptions("tcp://127.0.0.1:1")
    outcome, _, notes = run_study(path, store, nowhere)
    assert (outcome.computed, outcome.found, notes.planned_runs) == (0, 2, [])


def test_an_existing_cluster_and_runs_that_die_or_hang(
    store: ResultStore, study_file: WriteFile, address: str, made_run: FinishedRun
) -> None:
    def perform(inputs: RunInputs, key: str) -> FinishedRun:
        gap_m = inputs.parameters.gap.max_gap_m
        if gap_m == 80.0:
            os._exit(1)
        if gap_m == 81.0:
            raise ZeroDivisionError("a bug")
        if gap_m == 82.0:
            raise StateError("the state leads nowhere")
        if gap_m == 83.0:
            with _watched(key, 1.0):
                time.sleep(120.0)
        return made_run

    cases = "".join(
        f"  - name: gap_{gap_m}\n    run: {{overrides: {{gap.max_gap_m: {gap_m}}}}}\n"
        for gap_m in range(80, 86)
    )
    path = study_file(f"title: t\ndefaults: {{duration_s: 5}}\ncases:\n{cases}")
    outcome, campaign, notes = run_study(path, store, ClusterOptions(address), perform)
    assert notes.failed_runs == {
        "mini/gap_80": "its worker process died (out of memory, killed, or a crash in a library)",
        "mini/gap_81": "ZeroDivisionError: a bug",
        "mini/gap_82": "the state leads nowhere",
        "mini/gap_83": "the run hung: no sign of life for 1 s (a solver that never returns)",
    }
    assert sorted(notes.finished_runs) == ["mini/gap_84", "mini/gap_85"]
    assert (outcome.computed, outcome.failed) == (2, 4)
    assert len(campaign.failures) == 4
    # What the store remembers of it.
    again = plan_campaign([path])
    assert len(survey(again, store, ExpectedTimes())) == 4
    reasons = {state.case.name: state.reason for state in again.cases()}
    assert reasons["gap_81"] == "ZeroDivisionError: a bug"
    assert reasons["gap_84"] == ""


def test_other_code_on_the_workers_is_refused(
    store: ResultStore, study_file: WriteFile, address: str
) -> None:
    def perform(inputs: RunInputs, key: str) -> FinishedRun:
        from dataclasses import replace  # noqa: PLC0415 - for the worker

        return work(replace(inputs, fingerprint="0" * 64), key)

    _, _, notes = run_study(study_file(), store, ClusterOptions(address), perform)
    assert len(notes.failed_runs) == 2
    assert all("same version on all machines" in cause for cause in notes.failed_runs.values())


def test_strategies_of_the_best_runs_are_computed_in_the_same_go(
    store: ResultStore, study_file: WriteFile, address: str, made_run: FinishedRun
) -> None:
    text = """
title: t
defaults: {duration_s: 5}
cases:
  - {name: "1", labels: {x: 1}, run: {strategy: {base: aging, aging_weight: 1}}}
  - {name: "2", labels: {x: 1}, run: {strategy: {base: aging, aging_weight: 2}}}
  - name: best
    run: {strategy: {best_of: {study: mini, labels: {x: 1}}}, preview: {mode: none}}
"""

    def perform(inputs: RunInputs, key: str) -> FinishedRun:
        del inputs, key
        return made_run

    outcome, _, notes = run_study(study_file(text), store, ClusterOptions(address), perform)
    assert outcome.computed == 3
    assert notes.finished_runs[-1] == "mini/best"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("", 0), "workers is 0"),
        (("", 100_000), "allowed: 1 to 1024"),
        (("tcp://a:1", 2), "leave --workers out"),
    ],
)
def test_bad_cluster_options(arguments: tuple[str, int], complaint: str) -> None:
    with pytest.raises(ScenarioError, match=complaint):
        ClusterOptions(*arguments)


@pytest.mark.parametrize("scheduler", ["tcp://127.0.0.1:1", "nonsense://x:1", "127.0.0.1:no"])
def test_a_scheduler_that_does_not_answer(
    store: ResultStore, study_file: WriteFile, monkeypatch: pytest.MonkeyPatch, scheduler: str
) -> None:
    monkeypatch.setattr(cluster_module, "CONNECT_TIMEOUT_S", 1.0)
    with pytest.raises(ScenarioError, match="does not answer"):
        run_study(study_file(), store, ClusterOptions(scheduler))


def test_a_cluster_without_workers(
    store: ResultStore, study_file: WriteFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(execution, "WAIT_FOR_WORKERS_S", 0.5)
    monkeypatch.setattr(execution, "REFRESH_S", 0.1)
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0") as empty,
        pytest.raises(ScenarioError, match=r"no worker for 0\.5 s"),
    ):
        run_study(study_file(), store, ClusterOptions(empty.scheduler_address))
