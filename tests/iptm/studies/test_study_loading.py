"""Study files: what they mean, and what is refused."""

from collections.abc import Callable
from pathlib import Path

import pytest

from iptm.studies.run_spec import RunKind
from iptm.studies.study import Selection
from iptm.studies.study_loading import load_study, read_study
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import ScenarioError
from iptm_core.settings import PreviewMode

WriteFile = Callable[..., Path]


def test_a_case_for_each_combination(study_file: WriteFile) -> None:
    study = read_study(
        study_file(
            """
title: Grids
about: Two axes,
  multiplied.
defaults: {strategy: reference, preview: {seed: 3}, overrides: {body.mass_kg: 1500}}
cases:
  - name: "{n}/{kind}"
    labels: {group: a}
    for_each:
      - - {labels: {n: 3}}
        - {labels: {n: 5}, run: {overrides: {gap.max_gap_m: 80}}}
      - - {labels: {kind: quiet}}
        - {labels: {kind: noisy}, run: {preview: {noise_std_m_s: 1}, strategy: aging}}
    run: {horizon: "{n}x1+5x5"}
"""
        )
    )
    assert study.about == "Two axes, multiplied."
    assert [case.name for case in study.cases] == ["3/quiet", "3/noisy", "5/quiet", "5/noisy"]
    first, last = study.cases[0], study.cases[-1]
    assert first.labels == {"group": "a", "n": 3, "kind": "quiet"}
    assert first.spec.horizon == "3x1+5x5"
    assert first.spec.strategy == STRATEGIES["reference"]
    assert first.spec.overrides == (("body.mass_kg", 1500.0),)
    assert last.spec.overrides == (("body.mass_kg", 1500.0), ("gap.max_gap_m", 80.0))
    assert (last.spec.seed, last.spec.noise_std_m_s) == (3, 1.0)
    assert last.spec.strategy == STRATEGIES["aging"]


def test_settings_of_all_kinds(study_file: WriteFile, tmp_path: Path) -> None:
    text = """
title: All
cases:
  - name: all
    run:
      kind: whole_trip
      cycle: own.csv
      slope: flat
      duration_s: 30
      parameter_set: own.yaml
      strategy: {base: energy_aging, energy_weight_1_j: 1e-4, aging_weight: 5e8}
      horizon: 3x1+5x5
      solver: {name: ipopt, tolerance: 1e-6, max_iterations: 50}
      preview: {mode: none, length_s: null}
      tick_s: 0.5
      plant_step_s: 0.1
"""
    (case,) = read_study(study_file(text)).cases
    spec = case.spec
    assert spec.kind is RunKind.WHOLE_TRIP
    assert spec.cycle == str(tmp_path / "own.csv"), "files are looked up beside the study"
    assert spec.parameter_set == str(tmp_path / "own.yaml")
    assert (spec.strategy.energy_weight_1_j, spec.strategy.aging_weight) == (1e-4, 5e8)
    assert spec.max_iterations == 50
    assert spec.preview_length_s is None
    assert spec.preview_mode is PreviewMode.NONE


def test_a_strategy_taken_from_another_study(study_file: WriteFile) -> None:
    text = """
title: Best
cases:
  - name: best
    labels: {s: energy_aging}
    run:
      strategy: {best_of: {study: weighting, labels: {strategy: "{s}"}, lowest: cooling_energy}}
"""
    (case,) = read_study(study_file(text)).cases
    assert case.best_of == Selection("weighting", {"strategy": "energy_aging"}, "cooling_energy")


def test_the_short_trip_changes_only_the_trip() -> None:
    study = load_study("omitted_parameters")
    short = study.shortened(duration_s=30.0)
    assert [case.labels for case in short.cases] == [case.labels for case in study.cases]
    for case, before in zip(short.cases, study.cases, strict=True):
        assert case.spec.duration_s == 30.0
        assert case.spec.overrides == before.spec.overrides


CASE = "title: t\ncases:\n  - name: a\n    run: {%s}\n"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "holds nothing; allowed: a mapping"),
        ("title: t\n", "'cases' is missing"),
        ("title: t\ncases: []\n", r"cases is \[\]; allowed: a list with at least one"),
        ("title: t\ncases: [{}]\n", "case 1: 'name' is missing"),
        ("title: t\ncases: [{name: a}, {name: a}]\n", "case name 'a' occurs more than once"),
        ("title: t\ncase: []\ncases: [{name: a}]\n", "unknown key 'case'; did you mean 'cases'"),
        ("title: t\ncases: [{name: a, lables: {}}]\n", "did you mean 'labels'"),
        (
            "title: t\ncases: [{name: a, labels: {x: [1]}}]\n",
            r"labels: x is \[1\]; allowed: a text",
        ),
        ("title: t\ncases: [{name: a, for_each: {x: 1}}]\n", "for_each is .*; allowed: a list"),
        ("title: t\ncases: [{name: a, for_each: [[]]}]\n", r"for_each 1 is \[\]; allowed: a list"),
        ("title: t\ncases: [{name: a, for_each: [[{label: {}}]]}]\n", "1, point 1: unknown key"),
        ("title: t\ncases: [{name: '{x}'}]\n", r"\{x\} in '\{x\}' is not a label; allowed: none"),
        (
            "title: t\ncases: [{name: a, labels: {x: 1}, for_each: [[{labels: {x: 2}}]]}]\n",
            "label 'x' is given twice",
        ),
        ("title: t\ndefaults: {horizn: 15x1}\ncases: [{name: a}]\n", "did you mean 'horizon'"),
        (CASE % "horizon: 15s", "'15s' cannot be read"),
        (CASE % "strategy: agng", "strategy is 'agng'"),
        (CASE % "strategy: {aging_weight: 1}", "'base' is missing"),
        (
            CASE % "strategy: {base: aging, aging_weight: much}",
            "aging_weight is 'much'; allowed: a n",
        ),
        (CASE % "strategy: {base: aging, weight: 1}", "strategy: unknown key 'weight'"),
        (CASE % "strategy: {base: aging, aging_weight: -1}", "1e15"),
        (CASE % "strategy: {base: aging, aging_weight: 0}", "every weight is zero"),
        (CASE % "strategy: {best_of: weighting}", "best_of holds 'weighting'; allowed: a mapping"),
        (CASE % "strategy: {best_of: {}}", "'study' is missing"),
        (CASE % "strategy: {best_of: {study: x, smallest: y}}", "unknown key 'smallest'"),
        (CASE % "strategy: {best_of: {study: x}, base: aging}", "unknown key 'base'"),
        (CASE % "duration_s: 0", "duration_s is 0.0; allowed: one tick"),
        (CASE % "tick_s: .nan", "tick_s is nan"),
        (CASE % "kind: open_loop", "kind is 'open_loop'.* allowed: one of closed_loop"),
        (
            CASE % "solver: {max_iterations: 1.5}",
            "max_iterations is 1.5 .*; allowed: a whole number",
        ),
        (
            CASE % "preview: {noise: 1}",
            "preview: unknown key 'noise'; did you mean 'noise_std_m_s'",
        ),
        (CASE % "preview: {mode: some}", "mode is 'some'.* full, none"),
        (CASE % "preview: {preview_mode: none}", "unknown key 'preview_mode'.* mode"),
        (CASE % "overrides: {gap.max_gap_m: wide}", "gap.max_gap_m is 'wide'; allowed: a number"),
    ],
)
def test_bad_files_are_refused(study_file: WriteFile, text: str, complaint: str) -> None:
    path = study_file(text)
    with pytest.raises(ScenarioError, match=complaint) as caught:
        read_study(path)
    assert str(path) in str(caught.value) or "study mini" in str(caught.value)


def test_too_many_cases(study_file: WriteFile) -> None:
    axis = "[" + ", ".join(f"{{labels: {{l%s: {number}}}}}" for number in range(101)) + "]"
    axes = ", ".join(axis.replace("%s", str(number)) for number in (1, 2))
    path = study_file(f"title: t\ncases: [{{name: '{{l1}}/{{l2}}', for_each: [{axes}]}}]\n")
    with pytest.raises(ScenarioError, match="10201 cases; allowed: 10000"):
        read_study(path)


def test_a_product_of_axes_is_refused_before_it_is_multiplied_out(study_file: WriteFile) -> None:
    axes = [
        "[" + ", ".join(f"{{labels: {{l{axis}: {k}}}}}" for k in range(60)) + "]"
        for axis in range(5)
    ]
    path = study_file(f"title: t\ncases: [{{name: n, for_each: [{', '.join(axes)}]}}]\n")
    with pytest.raises(ScenarioError, match="777600000 cases; allowed: 10000"):
        read_study(path)


def test_unknown_studies(tmp_path: Path, study_file: WriteFile) -> None:
    with pytest.raises(ScenarioError, match="did you mean 'strategies'"):
        load_study("strategys")
    with pytest.raises(ScenarioError, match="no such file"):
        load_study(tmp_path / "none.yaml")
    with pytest.raises(ScenarioError, match="file name is the study's name"):
        read_study(study_file(name="a b.yaml"))
