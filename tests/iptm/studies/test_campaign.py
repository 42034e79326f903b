"""The books of a campaign: each run once, and strategies taken from finished runs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from iptm.studies.campaign import Campaign, ExpectedTimes, modelled_s, plan_campaign
from iptm.studies.execution import clock_text
from iptm.studies.run import Run
from iptm.studies.run_spec import RunKind, RunSpec
from iptm.studies.study import Case, planned_run
from iptm.studies.study_loading import read_study
from iptm_core.errors import ScenarioError
from iptm_core.settings import PreviewMode

MakeRun = Callable[..., Run]
WriteFile = Callable[..., Path]

SPEC = RunSpec(cycle="us06")
WEIGHTS = """
title: Weights
defaults: {cycle: us06, duration_s: 5, horizon: 3x1+5x5}
cases:
  - name: "{number}"
    for_each:
      - - labels: {group: a, number: 1}
          run: {strategy: {base: energy_aging, aging_weight: 1.0e7}}
        - labels: {group: a, number: 2}
          run: {strategy: {base: energy_aging, aging_weight: 2.0e7}}
        - labels: {group: a, number: 3}
          run: {strategy: {base: energy_aging, aging_weight: 2.0e7}}
        - labels: {group: b, number: 4}
          run: {strategy: aging}
"""

TABLE = """
title: Table
defaults: {cycle: us06, duration_s: 5, horizon: 3x1+5x5}
cases:
  - name: best
    run: {strategy: {best_of: {study: weights, labels: {group: a}}}}
  - name: best_without_preview
    run:
      strategy: {best_of: {study: weights, labels: {group: a}}}
      preview: {mode: none}
  - name: aging
    run: {strategy: aging}
"""


@pytest.fixture
def campaign(study_file: WriteFile) -> Campaign:
    weights = read_study(study_file(WEIGHTS, "weights.yaml"))
    return Campaign([read_study(study_file(TABLE, "table.yaml"))], [weights])


def states(campaign: Campaign) -> dict[str, Case]:
    return {state.address: state for state in campaign.cases}


def test_each_run_once(campaign: Campaign) -> None:
    runs = campaign.take()
    # Two different weights of group a, and aging, which group b does not add, as it was not requested.
    assert len(runs) == 3
    assert [run.address for run in runs] == ["weights/1", "weights/2", "table/aging"]
    assert campaign.take() == ()


def test_the_best_weights_are_taken(campaign: Campaign, make_run: MakeRun) -> None:
    first, second, aging = campaign.take()
    assert [run.address for run in campaign.later_runs()] == ["table/best_without_preview"]
    campaign.finish(make_run(aging, 1.0))
    campaign.finish(make_run(first, 3.0))
    assert campaign.take() == ()
    waiting = states(campaign)["table/best"]
    assert waiting.best_of is not None
    assert "waits" in states(campaign)["table/best"].reason
    campaign.finish(make_run(second, 2.0))
    (new,) = campaign.take()
    assert new.address == "table/best_without_preview"
    assert new.spec.strategy.aging_weight == 2e7
    assert new.spec.preview_mode is PreviewMode.NONE
    found = states(campaign)
    assert found["table/best"].key == second.key, "the best run itself, not computed again"
    assert found["table/best"].reason == ""
    assert found["table/best"].metrics is not None
    assert found["table/best_without_preview"].reason == "not computed"
    assert campaign.later_runs() == ()


def test_a_failed_candidate_is_passed_over(campaign: Campaign, make_run: MakeRun) -> None:
    first, second, _ = campaign.take()
    campaign.fail(second.key, "broke off")
    campaign.finish(make_run(first, 3.0))
    (new,) = campaign.take()
    assert new.spec.strategy.aging_weight == 1e7
    assert list(campaign.failures.values()) == ["broke off"]


def test_without_any_candidate_the_case_is_left_out(campaign: Campaign) -> None:
    first, second, _ = campaign.take()
    campaign.fail(first.key, "a")
    campaign.fail(second.key, "b")
    assert campaign.take() == ()
    assert set(campaign.left_out) == {"table/best", "table/best_without_preview"}
    assert "failed" in states(campaign)["table/best"].reason


def test_runs_that_break_hard_limits_come_last(campaign: Campaign, make_run: MakeRun) -> None:
    first, second, _ = campaign.take()
    broken = make_run(first, 0.1)
    columns = broken.trajectory.to_arrays()
    columns["leader_position_m"] = columns["position_m"] - 1.0
    crashed = replace(broken, trajectory=type(broken.trajectory).from_arrays(columns))
    campaign.finish(crashed)
    campaign.finish(make_run(second, 2.0))
    (new,) = campaign.take()
    assert new.spec.strategy.aging_weight == 2e7


def test_an_unknown_figure_to_choose_by(study_file: WriteFile, make_run: MakeRun) -> None:
    table = TABLE.replace("labels: {group: a}}", "labels: {group: a}, lowest: beauty}")
    campaign = Campaign(
        [read_study(study_file(table, "table.yaml"))],
        [read_study(study_file(WEIGHTS, "weights.yaml"))],
    )
    first, second, _ = campaign.take()
    campaign.finish(make_run(first, 1.0))
    with pytest.raises(ScenarioError, match="no figure 'beauty'"):
        campaign.finish(make_run(second, 1.0))


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        (TABLE.replace("study: weights", "study: heights"), "unknown study 'heights'"),
        (TABLE.replace("group: a", "group: z"), "allowed: labels of cases"),
        (
            TABLE.replace("study: weights, labels: {group: a}", "study: table"),
            "state their strategy",
        ),
        (TABLE.replace("cycle: us06", "cycle: us07"), "table/best: unknown driving cycle"),
        (
            TABLE.replace("mode: none", "mode: none}\n      overrides: {a.b: 1"),
            "unknown parameter 'a.b'",
        ),
    ],
)
def test_what_cannot_be_planned_is_refused_at_once(
    study_file: WriteFile, table: str, complaint: str
) -> None:
    weights = read_study(study_file(WEIGHTS, "weights.yaml"))
    study = read_study(study_file(table, "table.yaml"))
    with pytest.raises(ScenarioError, match=complaint):
        Campaign([study], [weights])


def test_studies_bring_those_they_depend_on(study_file: WriteFile) -> None:
    campaign = plan_campaign(["strategies"])
    assert [study.name for study in campaign.studies] == ["strategies"]
    # Sixteen weights, one of them printed twice, and the two strategies without weights.
    assert len(campaign.keys) == 17
    with pytest.raises(ScenarioError, match="no study 'weights'"):
        plan_campaign([study_file(TABLE, "table.yaml")])


def test_experience_corrects_each_kind_by_itself() -> None:
    times, inputs = ExpectedTimes(), planned_run(SPEC)
    whole = planned_run(replace(SPEC, kind=RunKind.WHOLE_TRIP))
    assert times.of(inputs) == modelled_s(SPEC, inputs.ticks) < times.of(whole)
    before = times.of(whole)
    times.learn(SPEC, 1000, 3.0 * modelled_s(SPEC, 1000))
    assert times.of(inputs) == pytest.approx(3.0 * modelled_s(SPEC, inputs.ticks))
    assert times.of(whole) == before


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (89.4, "89 s"), (200.0, "3:20 min"), (5399.0, "89:59 min"), (5460.0, "1:31 h")],
)
def test_clock_text(seconds: float, text: str) -> None:
    assert clock_text(seconds) == text
