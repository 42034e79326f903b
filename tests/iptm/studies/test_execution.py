"""Campaigns in worker processes: computed once, resumed, and robust."""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from iptm.studies.campaign import Campaign, plan_campaign, survey
from iptm.studies.execution import execute
from iptm.studies.run import Run, perform_run
from iptm.studies.store import ResultStore
from iptm.studies.study import Case
from iptm.studies.workers import Failed, OnProgress, worker_count
from iptm_core.errors import ScenarioError, StateError

WriteFile = Callable[..., Path]
MakeRun = Callable[..., Run]
WORKERS = 2
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


class Notes:
    """A display that remembers."""

    def __init__(self) -> None:
        self.planned_runs: list[str] = []
        self.finished_runs: list[str] = []
        self.failed_runs: dict[str, str] = {}
        self.times_left_s: list[float] = []

    def planned(self, inputs: Case, expected_s: float) -> None:
        assert expected_s > 0.0
        self.planned_runs.append(inputs.address)

    def ended(self, inputs: Case, outcome: Run | Failed) -> None:
        if isinstance(outcome, Failed):
            self.failed_runs[inputs.address] = outcome.cause
        else:
            assert outcome.key == inputs.key
            self.finished_runs.append(inputs.address)

    def remaining(self, seconds: float) -> None:
        self.times_left_s.append(seconds)


def run_study(
    path: Path, store: ResultStore, *how: Callable[..., object]
) -> tuple[tuple[int, int, int], Campaign, Notes]:
    campaign, notes = plan_campaign([path]), Notes()
    computed = execute(campaign, store, WORKERS, notes, *how)
    found, failed = campaign.finished - computed, len(campaign.failures)
    # Runs computed, found and failed.
    return (computed, found, failed), campaign, notes


def test_computed_once_resumed_and_recomputed_where_needed(
    store: ResultStore,
    study_file: WriteFile,
    assert_same: Callable[[Run, Run], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = study_file(STUDY + FAILING)
    totals, campaign, notes = run_study(path, store)
    assert totals == (2, 0, 1)
    assert sorted(notes.finished_runs) == ["mini/aging", "mini/late"]
    assert list(notes.failed_runs) == ["mini/weak_pack"]
    assert "pack cannot supply" in notes.failed_runs["mini/weak_pack"]
    assert notes.times_left_s[-1] == 0.0
    cases = {state.name: state for state in campaign.cases}
    assert cases["aging"].key == cases["the_same"].key
    assert cases["weak_pack"].metrics is None
    assert "pack cannot supply" in cases["weak_pack"].reason

    # The numbers of another process are those of this one.
    inputs = {inputs.address: inputs for inputs in plan_campaign([path]).take()}
    assert_same(store.load(str(cases["late"].key)), perform_run(inputs["mini/late"]))

    # The same again: nothing is computed but the failed run, which gets another chance.
    totals, _, notes = run_study(path, store)
    assert totals == (0, 2, 1)

    # Another setting in one case, another case gone: one run is computed.
    changed = study_file(STUDY.replace("latency_s: 1", "latency_s: 2"))
    totals, _, notes = run_study(changed, store)
    assert totals == (1, 1, 0)
    assert notes.finished_runs == ["mini/late"]

    # A damaged entry is recomputed, with a notice.
    store.path_of(str(cases["aging"].key)).write_bytes(b"PAR1 nonsense")
    with caplog.at_level(logging.WARNING):
        totals, _, notes = run_study(study_file(STUDY), store)
    assert "recomputed" in caplog.text
    assert totals == (1, 1, 0)
    assert notes.finished_runs == ["mini/aging"]


def misbehave(inputs: Case, on_progress: OnProgress) -> Run:
    """Die, fail, hang or drive, by the largest gap."""
    gap_m = inputs.parameters.gap.max_gap_m
    if gap_m == 80.0:
        os._exit(1)
    if gap_m == 81.0:
        raise ZeroDivisionError("a bug")
    if gap_m == 82.0:
        raise StateError("the state leads nowhere")
    if gap_m == 83.0:
        time.sleep(120.0)
    return perform_run(inputs, on_progress)


def test_runs_that_die_or_hang(store: ResultStore, study_file: WriteFile) -> None:
    cases = "".join(
        f"  - name: gap_{gap_m}\n    run: {{overrides: {{gap.max_gap_m: {gap_m}}}}}\n"
        for gap_m in range(80, 86)
    )
    defaults = "{cycle: us06, duration_s: 3, horizon: 3x1+5x5}"
    path = study_file(f"title: t\ndefaults: {defaults}\ncases:\n{cases}")
    totals, campaign, notes = run_study(path, store, misbehave, lambda _: 30.0)
    assert notes.failed_runs == {
        "mini/gap_80": "its process died (out of memory, killed, or a crash in a library)",
        "mini/gap_81": "ZeroDivisionError: a bug",
        "mini/gap_82": "the state leads nowhere",
        "mini/gap_83": "the run hung: no progress for 30 s (a solver that never returns)",
    }
    assert sorted(notes.finished_runs) == ["mini/gap_84", "mini/gap_85"]
    assert totals == (2, 0, 4)
    assert campaign.failures == notes.failed_runs
    # What the store remembers of it.
    again = plan_campaign([path])
    assert len(survey(again, store)) == 4
    reasons = {state.name: state.reason for state in again.cases}
    assert reasons["gap_81"] == "ZeroDivisionError: a bug"
    assert reasons["gap_84"] == ""


def test_strategies_of_the_best_runs_are_computed_in_the_same_go(
    store: ResultStore, study_file: WriteFile
) -> None:
    text = """
title: t
defaults: {cycle: us06, duration_s: 3, horizon: 3x1+5x5}
cases:
  - {name: "1", labels: {x: 1}, run: {strategy: {base: aging, aging_weight: 1.0e+8}}}
  - {name: "2", labels: {x: 1}, run: {strategy: {base: aging, aging_weight: 2.0e+8}}}
  - name: best
    run: {strategy: {best_of: {study: mini, labels: {x: 1}}}, preview: {mode: none}}
"""
    totals, _, notes = run_study(study_file(text), store)
    assert totals == (3, 0, 0)
    assert notes.finished_runs[-1] == "mini/best"


@pytest.mark.parametrize(
    ("workers", "complaint"), [(0, "workers is 0"), (100_000, "allowed: 1 to 1024")]
)
def test_a_number_of_workers_out_of_range(workers: int, complaint: str) -> None:
    with pytest.raises(ScenarioError, match=complaint):
        worker_count(workers)
