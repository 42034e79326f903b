"""Campaigns on a real cluster of worker processes: computed once, resumed, and robust."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import dask
import pytest
from distributed import LocalCluster

from iptm_core.errors import ScenarioError, StateError
from iptm_studies import cluster as cluster_module
from iptm_studies.campaign import Campaign, plan_campaign
from iptm_studies.cluster import ClusterOptions, progress_watched, work
from iptm_studies.execution import execute, survey
from iptm_studies.run import Run, perform_run
from iptm_studies.run_inputs import RunInputs
from iptm_studies.store import ResultStore

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
  - name: late
    run: {strategy: aging, preview: {latency_s: 1}}
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

    def planned(self, inputs: RunInputs, expected_s: float) -> None:
        assert expected_s > 0.0
        self.planned_runs.append(inputs.address)

    def finished(self, inputs: RunInputs, run: Run) -> None:
        assert run.key == inputs.key
        self.finished_runs.append(inputs.address)

    def failed(self, inputs: RunInputs, cause: str) -> None:
        self.failed_runs[inputs.address] = cause

    def remaining(self, seconds: float) -> None:
        self.times_left_s.append(seconds)


@pytest.fixture(scope="module")
def existing() -> Iterator[ClusterOptions]:
    """An existing cluster that the tests share; an embedded one is that of the command's own test."""
    with (
        dask.config.set(cluster_module.SETTINGS),
        LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as cluster,
    ):
        yield ClusterOptions(cluster.scheduler_address)


def run_study(
    path: Path,
    store: ResultStore,
    options: ClusterOptions,
    perform: Callable[[RunInputs], Run] = work,
) -> tuple[tuple[int, int, int], Campaign, Notes]:
    campaign, notes = plan_campaign([path]), Notes()
    computed = execute(campaign, store, options, notes, perform)
    found, failed = campaign.finished - computed, len(campaign.failures)
    # Runs computed, found and failed.
    return (computed, found, failed), campaign, notes


def test_computed_once_resumed_and_recomputed_where_needed(
    store: ResultStore,
    study_file: WriteFile,
    existing: ClusterOptions,
    assert_same: Callable[[Run, Run], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = study_file(STUDY + FAILING)
    totals, campaign, notes = run_study(path, store, existing)
    assert totals == (2, 0, 1)
    assert sorted(notes.finished_runs) == ["mini/aging", "mini/late"]
    assert list(notes.failed_runs) == ["mini/weak_pack"]
    assert "pack cannot supply" in notes.failed_runs["mini/weak_pack"]
    assert notes.times_left_s[-1] == 0.0
    cases = {state.case.name: state for state in campaign.cases}
    assert cases["aging"].key == cases["the_same"].key
    assert cases["weak_pack"].metrics is None
    assert "pack cannot supply" in cases["weak_pack"].reason

    # The numbers of a worker are those of this process.
    inputs = {inputs.address: inputs for inputs in plan_campaign([path]).take()}
    assert_same(store.load(str(cases["late"].key)), perform_run(inputs["mini/late"]))

    # The same again: nothing is computed but the failed run, which gets another chance.
    totals, _, notes = run_study(path, store, existing)
    assert totals == (0, 2, 1)

    # Another setting in one case, another case gone: one run is computed.
    changed = study_file(STUDY.replace("latency_s: 1", "latency_s: 2"))
    totals, _, notes = run_study(changed, store, existing)
    assert totals == (1, 1, 0)
    assert notes.finished_runs == ["mini/late"]

    # A damaged entry is recomputed, with a notice.
    store.path_of(str(cases["aging"].key)).write_bytes(b"PAR1 nonsense")
    with caplog.at_level(logging.WARNING):
        totals, _, notes = run_study(study_file(STUDY), store, existing)
    assert "recomputed" in caplog.text
    assert totals == (1, 1, 0)
    assert notes.finished_runs == ["mini/aging"]


def test_nothing_to_do_needs_no_cluster(
    store: ResultStore, study_file: WriteFile, make_run: Callable[..., Run]
) -> None:
    path = study_file(STUDY)
    for inputs in plan_campaign([path]).take():
        store.save(make_run(inputs))
    nowhere = ClusterOptions("tcp://127.0.0.1:1")
    totals, _, notes = run_study(path, store, nowhere)
    assert (totals, notes.planned_runs) == ((0, 2, 0), [])


def test_runs_that_die_or_hang(
    store: ResultStore, study_file: WriteFile, existing: ClusterOptions, made_run: Run
) -> None:
    def perform(inputs: RunInputs) -> Run:
        gap_m = inputs.parameters.gap.max_gap_m
        if gap_m == 80.0:
            os._exit(1)
        if gap_m == 81.0:
            raise ZeroDivisionError("a bug")
        if gap_m == 82.0:
            raise StateError("the state leads nowhere")
        if gap_m == 83.0:
            with progress_watched(inputs.key, 1.0):
                time.sleep(120.0)
        return replace(made_run, key=inputs.key)

    cases = "".join(
        f"  - name: gap_{gap_m}\n    run: {{overrides: {{gap.max_gap_m: {gap_m}}}}}\n"
        for gap_m in range(80, 86)
    )
    path = study_file(f"title: t\ndefaults: {{duration_s: 5}}\ncases:\n{cases}")
    totals, campaign, notes = run_study(path, store, existing, perform)
    assert notes.failed_runs == {
        "mini/gap_80": "its worker process died (out of memory, killed, or a crash in a library)",
        "mini/gap_81": "ZeroDivisionError: a bug",
        "mini/gap_82": "the state leads nowhere",
        "mini/gap_83": "the run hung: no progress for 1 s (a solver that never returns)",
    }
    assert sorted(notes.finished_runs) == ["mini/gap_84", "mini/gap_85"]
    assert totals == (2, 0, 4)
    assert campaign.failures == notes.failed_runs
    # What the store remembers of it.
    again = plan_campaign([path])
    assert len(survey(again, store)) == 4
    reasons = {state.case.name: state.reason for state in again.cases}
    assert reasons["gap_81"] == "ZeroDivisionError: a bug"
    assert reasons["gap_84"] == ""


def test_other_code_on_the_workers_is_refused(
    store: ResultStore, study_file: WriteFile, existing: ClusterOptions
) -> None:
    def perform(inputs: RunInputs) -> Run:
        return work(replace(inputs, fingerprint="0" * 64))

    _, _, notes = run_study(study_file(), store, existing, perform)
    assert len(notes.failed_runs) == 2
    assert all("same versions on all machines" in cause for cause in notes.failed_runs.values())


def test_strategies_of_the_best_runs_are_computed_in_the_same_go(
    store: ResultStore, study_file: WriteFile, existing: ClusterOptions, made_run: Run
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

    def perform(inputs: RunInputs) -> Run:
        return replace(made_run, key=inputs.key)

    totals, _, notes = run_study(study_file(text), store, existing, perform)
    assert totals == (3, 0, 0)
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
    monkeypatch.setattr(cluster_module, "WAIT_FOR_WORKERS_S", 0.5)
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0") as empty,
        pytest.raises(ScenarioError, match=r"no worker for 0\.5 s"),
    ):
        run_study(study_file(), store, ClusterOptions(empty.scheduler_address))
