"""Identification: the file of the unknowns, the objective by hand, a search that goes on where it stopped."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.flat import neutral_values
from iptm_reproduction.identification import search
from iptm_reproduction.identification.evaluations import (
    HUBER,
    Evaluation,
    EvaluationTable,
    Task,
    deviations,
    huber,
    misfit,
    planned,
)
from iptm_reproduction.identification.search import Scored, Search, Stage
from iptm_reproduction.identification.shipping import (
    composition_text,
    evaluations_text,
    set_text,
)
from iptm_reproduction.identification.spread import determined_numbers, remaining_shares
from iptm_reproduction.identification.unknowns import (
    Unknowns,
    read_unknowns,
    shipped_unknowns,
)
from iptm_reproduction.names import COOLING, REFERENCE, STRATEGY_NAMES, TABLE_FIGURES, TRACTION
from iptm_reproduction.printed import printed_change, printed_value

UNKNOWNS = read_unknowns(shipped_unknowns())


def printed_runs() -> dict[str, dict[str, float]]:
    """The strategy table as if it had been found, changes exact."""
    reference = {figure: printed_value(REFERENCE, figure) or 0.0 for figure in TABLE_FIGURES}
    return {"reference": reference} | {
        name: {
            figure: value * (1.0 + printed_change(f"strategies/{name}", figure))
            for figure, value in reference.items()
        }
        for name in list(STRATEGY_NAMES)[1:]
    }


def test_whatever_the_paper_omits_about_trip_and_gap_is_searched_for_or_settled() -> None:
    stated = {*UNKNOWNS.free.index, *UNKNOWNS.settled.index}
    composition = {key for key in stated if key.startswith("composition.")}
    assert len(composition) == 6
    sources = load_parameters().sources
    chosen = {key for key, source in sources.items() if source.tag.value == "chosen"}
    # Aging moves the resistance by 1e-5 within a trip, the ego vehicle starts at standstill, nothing in the
    # paper's trips makes the service brakes act, and laws that refine the paper's change nothing here.
    neutral = neutral_values()
    without_effect = {
        "cell.resistance_aging_factor",
        "cell.resistance_aging_exponent",
        "gap.initial_gap_m",
        *(key for key in chosen if key.startswith("brakes.")),
        *(key for key in chosen if neutral.get(key) == sources[key].value),
    }
    assert chosen - without_effect <= {key.removeprefix("parameters.") for key in stated}
    # The prior itself is a trip and a model that can be driven.
    start = UNKNOWNS.candidate(UNKNOWNS.start)
    assert start.composition("prior").order[1:3] == ("wltc_class3b", "us06")
    assert start.parameters().limits.max_compressor_power_w == 4500.0


def test_the_weights_of_the_reference_reach_its_strategies_only() -> None:
    candidate = UNKNOWNS.candidate(UNKNOWNS.start)
    changed = replace(candidate, values={**candidate.values, "reference.temperature_weight": 0.3})
    assert planned(changed, "reference").spec.strategy.temperature_weight == 0.3
    assert planned(changed, "aging").spec.strategy.temperature_weight == 0.0
    assert planned(changed, "energy_aging").spec.strategy.energy_weight_1_j == 1e-4


@pytest.mark.parametrize("key", ["composition.height", "parameters.body.mass"])
def test_a_key_that_names_nothing_is_refused(tmp_path: Path, key: str) -> None:
    path = tmp_path / "unknowns.yaml"
    content = shipped_unknowns().read_text(encoding="utf-8")
    path.write_text(content.replace("composition.large_grade", key), encoding="utf-8")
    with pytest.raises(ScenarioError, match=f"unknown number '{key}'"):
        read_unknowns(path)


def test_a_prior_outside_its_bounds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "unknowns.yaml"
    content = shipped_unknowns().read_text(encoding="utf-8")
    path.write_text(content.replace("start: 0.21,", "start: 3.0,"), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"start is 3\.0; allowed: 0.06 to 0.25"):
        read_unknowns(path)


def test_the_misfit_by_hand() -> None:
    runs = printed_runs()
    assert misfit(runs) == pytest.approx(0.0, abs=1e-20), "of the printed table itself"
    assert len(deviations(runs)) == 36
    pair = {name: dict(runs[name]) for name in ("reference", "aging")}
    # Traction of the reference a quarter too high in the logarithm is one tolerance; the other rows stay.
    scale = math.exp(0.25)
    pair["reference"][TRACTION] *= scale
    pair["aging"][TRACTION] *= scale
    # Cooling changes by 9.67 points too little: a quarter of the printed 19.34 % is 4.835 points.
    pair["aging"][COOLING] = pair["reference"][COOLING] * (1.0 - 0.0967)
    found = deviations(pair)
    assert len(found) == 12
    assert found["reference", TRACTION] == pytest.approx(1.0)
    assert found["aging", COOLING] == pytest.approx(2.0)
    # 1 from traction, and 1.5 (2 * 2 - 1.5) = 3.75 from cooling, over twelve numbers.
    assert misfit(pair) == pytest.approx(4.75 / 12.0)
    # Large deviations count linearly and without a kink.
    assert huber(-1.0) == 1.0
    assert huber(HUBER) == pytest.approx(HUBER**2)
    assert huber(3.0) - huber(2.0) == pytest.approx(2.0 * HUBER)


def far_from_optimum(values: Mapping[str, float]) -> float:
    """Distance of the made-up problem's candidate from its optimum."""
    gap_km = values["parameters.gap.max_gap_m"] / 1000.0
    return abs(values["composition.large_grade"] - 0.1) + abs(gap_km - 0.15)


def made_up(task: Task) -> Evaluation:
    """Instead of a trip: the printed table where grade and gap have certain values, worse elsewhere."""
    inputs, values = task
    away = far_from_optimum(values)
    name = inputs.spec.strategy.name
    factor = math.exp(5.0 * away) * (1.0 if name == "reference" else 1.0 + away)
    figures = {key: value * factor for key, value in printed_runs()[name].items()}
    return Evaluation(inputs.key, name, dict(values), figures, 0.0)


TINY = Unknowns(
    UNKNOWNS.order,
    UNKNOWNS.first_slope,
    UNKNOWNS.base_set,
    pd.DataFrame(
        {
            "unit": ["1", "m"],
            "low": [0.05, 80.0],
            "high": [0.2, 200.0],
            "start": [0.15, 120.0],
            "spread": 0.3,
            "reason": "for the test",
        },
        index=["composition.large_grade", "parameters.gap.max_gap_m"],
    ),
    UNKNOWNS.settled.iloc[:0],
    {},
)
STAGES = (
    Stage("reference", ("reference",), 4, 4),
    Stage("pair", ("reference", "aging"), 2, 4, 0.3),
    Stage("table", tuple(STRATEGY_NAMES), 0, 2),
)


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    made = lambda _task, waiting, _workers: ((task, made_up(task)) for task in waiting)  # noqa: E731
    monkeypatch.setattr(search, "perform_all", made)


def searched(table: EvaluationTable) -> tuple[list[Scored], list[str]]:
    """The candidates of a search, and what it reported."""
    lines: list[str] = []

    def report(line: str, **_look: Any) -> None:
        lines.append(line)

    return Search(TINY, table, 1, report).run(STAGES), lines


def test_a_search_finds_the_optimum_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    found, reported = searched(EvaluationTable(tmp_path / "whole"))
    assert far_from_optimum(found[0].candidate.values) < 0.06
    assert far_from_optimum(TINY.candidate(TINY.start).values) == pytest.approx(0.08)
    assert set(found[0].runs) == set(STRATEGY_NAMES)
    assert reported[0] == "stage reference: 17 candidates, 17 runs"
    assert reported[1].startswith("[1] reference, 0 s, at ")
    assert any(line.startswith("pair: ") and ", best " in line for line in reported)

    # The same search, cut off: half of the table is there, its last line cut in the middle.
    lines = (tmp_path / "whole").read_text(encoding="utf-8").splitlines(keepends=True)
    half = len(lines) // 2
    (tmp_path / "cut").write_text("".join(lines[:half]) + lines[half][:40], encoding="utf-8")
    table = EvaluationTable(tmp_path / "cut")
    assert len(table.entries) == half
    again, rest = searched(table)
    assert sum(line.startswith("[") for line in rest) == len(lines) - half
    assert [entry.score for entry in again] == [entry.score for entry in found]
    assert len(EvaluationTable(tmp_path / "cut").entries) == len(lines)


def test_what_is_shipped_reads_back_as_the_candidate(tmp_path: Path) -> None:
    table = EvaluationTable(tmp_path / "table")
    best = searched(table)[0][0]
    path = tmp_path / "mine.yaml"
    path.write_text(set_text(best.candidate), encoding="utf-8")
    loaded = load_parameters(path)
    assert loaded.values == best.candidate.parameters()
    assert "identified between 80 and 200" in loaded.sources["gap.max_gap_m"].note
    grade = f"large_grade: {best.candidate.values['composition.large_grade']:g}"
    assert grade in composition_text(best.candidate)
    rows = evaluations_text(table, TINY).splitlines()
    head = "misfit,strategies,composition.large_grade,parameters.gap.max_gap_m,deviation.reference."
    assert rows[0].startswith(head)
    assert rows[0].count("deviation.") == 12
    assert np.all(np.diff([float(row.split(",")[0]) for row in rows[1:]]) >= 0.0)


def test_a_number_without_influence_keeps_its_prior_and_one_with_influence_does_not() -> None:
    steps = np.random.default_rng(3).normal(size=(40, 3))
    # One row falls by 4 tolerances per standard deviation of the first number, the second matters little, the
    # third not at all.
    rows = steps @ np.array([[-4.0, 0.0], [0.0, 0.5], [0.0, 0.0]])
    left = remaining_shares(steps, rows)
    assert left[0] == pytest.approx(1.0 / math.sqrt(17.0), rel=0.05)
    assert left[1] == pytest.approx(1.0 / math.sqrt(1.25), rel=0.05)
    assert left[2] == pytest.approx(1.0, rel=0.01)
    # Two numbers that act alike cannot be separated.
    assert np.all(remaining_shares(steps[:, :2], steps[:, :2] @ np.array([[5.0], [5.0]])) > 0.6)
    # A few evaluations determine nothing that they did not vary.
    few = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    left = remaining_shares(few, few @ np.array([[3.0], [3.0]]))
    assert left[0] < 0.5
    assert left[1] == pytest.approx(1.0)


def test_the_shipped_numbers_lie_within_their_bounds_and_are_among_the_good_fits() -> None:
    numbers = determined_numbers().numbers
    assert numbers["key"].tolist() == list(UNKNOWNS.free.index)
    assert numbers["value"].between(numbers["lowest"], numbers["highest"]).all()
    assert numbers["value"].between(numbers["low"], numbers["high"]).all()
    assert numbers["share"].between(0.0, 1.0, inclusive="right").all()
