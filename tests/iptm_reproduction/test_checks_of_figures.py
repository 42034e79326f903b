"""Checks on figures of runs, against numbers made by hand: held, in sign only, not held."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from tests.iptm_reproduction.made_store import made_claim

from iptm_reproduction.names import (
    CELL_1,
    CELL_N,
    COOLING,
    DEGRADATION,
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    TRACTION,
    VICE,
    change_text,
    expanded,
    name_of,
    names_of,
    relative_change,
)
from iptm_reproduction.printed import Finding, Verdict
from iptm_reproduction.results import Results

REPRODUCED, SIGN_ONLY, NOT, UNTESTED = Verdict
GAP = "mean_gap"


def results(runs: Mapping[str, float], figure: str = GAP) -> Results:
    """Runs with one figure; no check of this file looks into their trajectories."""
    return Results({address: {figure: number} for address, number in runs.items()})


def series(*values: float) -> Results:
    """Runs on horizons of 0, 1, ... seconds."""
    return results({f"prediction_horizon/{place}": value for place, value in enumerate(values)})


def found(stored: Results, kind: str, /, **arguments: Any) -> Finding:
    claim = made_claim(kind, **arguments)
    assert "eproduced" in claim.rule
    finding = claim.check(stored)
    assert finding.found
    return finding


CHANGE = {"run": PROPOSED, "base": REFERENCE, "figure": GAP}
RANGE = {"runs": VICE, "base": REFERENCE, "figure": GAP, "printed": (-0.0276, -0.0158)}
REDUCTION = {"run": PROPOSED, "base": REFERENCE, "figures": [CELL_1], "reduction": 0.12}
MARGIN = {"run": PROPOSED, "figure": "smallest_margin", "share": 0.25, "floor": 1.0}
HOTTEST = {"run": PROPOSED, "figure": "cell_n_temperature_max", "lowest": 39.0}
LOWER = {"lower": PROPOSED, "higher": [REFERENCE, VICE], "figures": [TRACTION]}
BETWEEN = {"run": VICE, "ends": [REFERENCE, PROPOSED], "figures": [TRACTION]}
RANK = {"among": [PROPOSED, VICE, REFERENCE], "run": VICE, "figures": [COOLING], "place": 2}


@pytest.mark.parametrize(
    ("cell_n", "expected"), [(85.0, REPRODUCED), (95.0, SIGN_ONLY), (101.0, NOT)]
)
def test_a_bound_on_several_figures_holds_for_the_least_of_them(
    cell_n: float, expected: Verdict
) -> None:
    stored = Results(
        {
            REFERENCE: {CELL_1: 100.0, CELL_N: 100.0},
            PROPOSED: {CELL_1: 85.0, CELL_N: cell_n},
        }
    )
    arguments = {**REDUCTION, "figures": [CELL_1, CELL_N]}
    assert found(stored, "reduction_at_least", **arguments).verdict is expected


@pytest.mark.parametrize(
    ("kind", "arguments", "values", "expected", "in_print"),
    [
        # Values of reference, proposed strategy, vice benchmark.
        ("change", CHANGE | {"printed": -0.08}, (200.0, 186.0), REPRODUCED, "-8.00 %"),
        ("change", CHANGE | {"printed": -0.08}, (200.0, 187.8), REPRODUCED, "-8.00 %"),
        ("change", CHANGE | {"printed": -0.08}, (200.0, 188.2), SIGN_ONLY, "-8.00 %"),
        ("change", CHANGE | {"printed": -0.08}, (200.0, 160.0), SIGN_ONLY, "-8.00 %"),
        ("change", CHANGE | {"printed": -0.08}, (200.0, 202.0), NOT, "-8.00 %"),
        ("change", CHANGE | {"printed": -0.08}, (200.0, 200.0), NOT, "-8.00 %"),
        # Within a percentage point, but of the other sign.
        ("change", CHANGE | {"printed": -0.003}, (200.0, 200.2), NOT, "-0.30 %"),
        ("change", CHANGE | {"printed": -0.003}, (200.0, 197.6), REPRODUCED, "-0.30 %"),
        ("change", CHANGE | {"printed": -0.1}, (0.0, 1.0), UNTESTED, ""),
        ("changes_in_range", RANGE, (100.0, 0.0, 97.8), REPRODUCED, "-2.76 % to -1.58 %"),
        ("changes_in_range", RANGE, (100.0, 0.0, 94.0), SIGN_ONLY, "-2.76 % to -1.58 %"),
        ("changes_in_range", RANGE, (100.0, 0.0, 100.1), NOT, "-2.76 % to -1.58 %"),
        (
            "reduction_at_least",
            REDUCTION,
            (100.0, 85.0),
            REPRODUCED,
            "degradation of cell 1 -12.77 %",
        ),
        (
            "reduction_at_least",
            REDUCTION,
            (100.0, 95.0),
            SIGN_ONLY,
            "degradation of cell 1 -12.77 %",
        ),
        ("reduction_at_least", REDUCTION, (100.0, 101.0), NOT, "degradation of cell 1 -12.77 %"),
        ("value", MARGIN, (0.0, 5.0), REPRODUCED, "5.904 m"),
        ("value", MARGIN, (0.0, 2.0), SIGN_ONLY, "5.904 m"),
        ("value", MARGIN, (0.0, 0.0), NOT, "5.904 m"),
        ("value_between", HOTTEST | {"highest": 40.0}, (0.0, 39.0), REPRODUCED, ""),
        ("value_between", HOTTEST | {"highest": 40.0}, (0.0, 40.1), NOT, ""),
        ("value_between", HOTTEST | {"highest": 40.0}, (0.0, 38.9), NOT, ""),
        ("value_between", HOTTEST, (0.0, 99.0), REPRODUCED, ""),
        ("all_lower", LOWER, (100.0, 90.0, 95.0), REPRODUCED, "2 of 2 comparisons hold"),
        ("all_lower", LOWER, (100.0, 95.0, 95.0), NOT, "2 of 2 comparisons hold"),
        ("all_lower", LOWER | {"needed_share": 0.5}, (100.0, 95.0, 95.0), REPRODUCED, None),
        ("between", BETWEEN, (100.0, 90.0, 95.0), REPRODUCED, None),
        ("between", BETWEEN, (90.0, 95.0, 95.0), REPRODUCED, None),
        ("between", BETWEEN, (94.0, 90.0, 95.0), NOT, None),
        ("rank", RANK, (100.0, 90.0, 95.0), REPRODUCED, "cooling energy: rank 1"),
        ("rank", RANK, (100.0, 99.0, 95.0), NOT, "cooling energy: rank 1"),
    ],
)
def test_strategies(
    kind: str,
    arguments: dict[str, Any],
    values: tuple[float, ...],
    expected: Verdict,
    in_print: str | None,
) -> None:
    figure = arguments.get("figure") or arguments["figures"][0]
    stored = results(dict(zip((REFERENCE, PROPOSED, VICE), values, strict=False)), figure)
    finding = found(stored, kind, **arguments)
    assert finding.verdict is expected
    assert in_print is None or finding.in_print == in_print


def test_failing_comparisons_are_named_and_cut_short() -> None:
    stored = results({REFERENCE: 100.0, PROPOSED: 95.0, VICE: 95.0}, TRACTION)
    text = found(stored, "all_lower", **LOWER).found
    assert text.startswith("1 of 2")
    assert "Energy + Aging 95.00 kJ" in text
    many = {"lower": "prediction_horizon/0", "higher": "prediction_horizon/1|2|3|4|5|6|7"}
    text = found(series(*[1.0] * 8), "all_lower", **many, figures=[GAP]).found
    assert text.startswith("0 of 7")
    assert text.endswith("and 3 more")


THREE = "prediction_horizon/0|1|2"
TWO = {"a": "prediction_horizon/0|1"}
TREND = ("trend", {"runs": THREE, "directions": {GAP: "falls"}, "least_change": 0.01})
ENDS = ("trend", {"runs": THREE, "directions": {GAP: "falls"}, "every_step": False})
NOT_ALWAYS = ("not_always", {"runs": THREE, "figures": [GAP], "direction": "falls"})
LEVELS = ("levels_off", {"groups": {"a": THREE}, "positions": [0.0, 1.0, 3.0], "figures": [GAP]})
WIDE = ("spread", {"groups": TWO, "figures": [GAP], "at_least": 0.05})
NARROW = ("spread", {"groups": TWO, "figures": [GAP], "at_most": 0.05})
GROUPS = {"a": THREE, "b": "prediction_horizon/3|4|5"}
EACH = ("trend_in_groups", {"groups": GROUPS, "figure": GAP, "direction": "rises"})
HALF = ("trend_in_groups", {**EACH[1], "needed_share": 0.5})
STEPS = {"2 s": "prediction_horizon/0|1", "5 s": "prediction_horizon/2|3"}
BEST = ("best_choice", {"candidates": STEPS, "figure": GAP, "expected": ["5 s"]})
BOTH = ("best_choice", {"candidates": STEPS, "figure": GAP, "expected": ["5 s", "2 s"]})


@pytest.mark.parametrize(
    ("check", "values", "expected"),
    [
        (TREND, (10.0, 9.0, 8.0), REPRODUCED),
        # A step of less than 0.05 % the other way counts as level.
        (TREND, (10.0, 10.004, 8.0), REPRODUCED),
        (TREND, (10.0, 11.0, 8.0), SIGN_ONLY),
        (TREND, (10.0, 9.99, 9.98), SIGN_ONLY),
        (TREND, (10.0, 9.0, 10.0), NOT),
        (ENDS, (10.0, 11.0, 8.0), REPRODUCED),
        (NOT_ALWAYS, (3.0, 2.0, 1.0), NOT),
        (NOT_ALWAYS, (3.0, 3.1, 1.0), REPRODUCED),
        (EACH, (1.0, 5.0, 4.0, 3.0, 3.5, 4.5), SIGN_ONLY),
        (HALF, (1.0, 5.0, 4.0, 3.0, 3.5, 4.5), REPRODUCED),
        (EACH, (1.0, 2.0, 3.0, 3.0, 4.0, 5.0), REPRODUCED),
        (EACH, (1.0, 2.0, 3.0, 6.0, 4.0, 5.0), NOT),
        (LEVELS, (10.0, 8.0, 7.9), REPRODUCED),
        # Saves as much in the last step, but over twice the distance.
        (LEVELS, (10.0, 9.0, 8.0), REPRODUCED),
        (LEVELS, (10.0, 9.0, 6.0), SIGN_ONLY),
        (LEVELS, (10.0, 9.0, 11.0), NOT),
        (WIDE, (1.0, 1.1), REPRODUCED),
        (WIDE, (1.0, 1.01), NOT),
        (NARROW, (1.0, 1.1), NOT),
        (NARROW, (1.0, 1.01), REPRODUCED),
        # The best one is best on average: in one of both groups.
        (BEST, (1.0, 5.0, 2.0, 3.0), REPRODUCED),
        (BEST, (1.0, 3.0, 2.0, 3.0), NOT),
        (BOTH, (1.0, 5.0, 2.0, 3.0), REPRODUCED),
    ],
)
def test_series(
    check: tuple[str, dict[str, Any]], values: tuple[float, ...], expected: Verdict
) -> None:
    kind, arguments = check
    assert found(series(*values), kind, **arguments).verdict is expected


def test_missing_runs_and_figures_leave_a_claim_untested() -> None:
    both = {"lower": "prediction_horizon/0", "higher": "prediction_horizon/1", "figures": [GAP]}
    gone = Results(
        {"prediction_horizon/0": {GAP: 1.0}}, {"prediction_horizon/1": "failed: no solution"}
    )
    finding = found(gone, "all_lower", **both)
    assert finding.verdict is UNTESTED
    assert "Prediction horizon: prediction_horizon/1 (failed: no solution)" in finding.found
    other = results({"prediction_horizon/0": 1.0, "prediction_horizon/1": 1.0}, CELL_1)
    assert found(other, "all_lower", **both) == Finding(UNTESTED, "the stored runs lack mean gap")


def test_a_cause_is_shown_unless_the_claim_is_reproduced() -> None:
    without = made_claim("value_between", run="prediction_horizon/0", figure=GAP, lowest=1.0)
    claim = replace(without, cause="{{ TRACTION }} is so")
    causes = [claim.check(runs).cause for runs in (series(2.0), series(0.0), series())]
    assert causes == ["", f"{TRACTION} is so", ""]
    assert without.check(series(0.0)).cause.startswith("No cause")


def test_changes_and_shares() -> None:
    assert (change_text(-0.07324), change_text(None)) == ("-7.32 %", "–")
    assert relative_change(1.0, 0.0) is None
    runs = results({PROPOSED: 9.0, REFERENCE: 10.0, OPTIMUM: 6.0}, DEGRADATION)
    assert runs.share_of_saving(PROPOSED) == pytest.approx(0.25)
    assert runs.share_of_saving(PROPOSED, optimum=REFERENCE) is None
    assert runs.share_of_saving(VICE) is None


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("strategies/aging", "Aging (proposed)"),
        ("long_horizon/15/reference", "SH 15 Reference"),
        ("imperfect_previews/noise/multi_horizon", "Aging, MH 3+5, noise"),
        ("omitted_parameters/t_init_30_degc/aging", "Aging (proposed), t init 30 °C"),
        ("a_study/of/a_case", "a_study/of/a_case"),
    ],
)
def test_runs_in_words(address: str, words: str) -> None:
    assert name_of(address) == words
    assert names_of([address] * 9) == f"9 runs ({words} to {words})"


def test_addresses_are_written_short() -> None:
    assert expanded("a/b|c/1|2", "d") == ("a/b/1", "a/b/2", "a/c/1", "a/c/2", "d")
    runs = series(1.0, 2.0)
    assert runs.matching(REFERENCE, "prediction_horizon/*") == [REFERENCE, *runs.figures.index]
    assert runs.matching("prediction_horizon/*", without="*/0") == ["prediction_horizon/1"]
