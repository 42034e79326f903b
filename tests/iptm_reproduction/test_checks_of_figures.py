"""Checks on figures of runs, against numbers made by hand: held, in sign only, not held."""

from collections.abc import Mapping
from typing import Any

import pytest

from iptm_controller.strategy import STRATEGIES as COST_TERMS
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_reproduction.claims import Claim, check_claims, make_check
from iptm_reproduction.figures import (
    CELL_1,
    COOLING,
    DEGRADATION,
    TRACTION,
    change_text,
    relative_change,
)
from iptm_reproduction.names import (
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    VICE,
    expanded,
    name_of,
    names_of,
)
from iptm_reproduction.results import ReportRun, Results
from iptm_reproduction.verdict import Finding, Verdict

REPRODUCED, SIGN_ONLY, NOT, UNTESTED = Verdict
PARAMETERS = load_parameters().values
ROUTE = build_route("us06", initial_gap_m=15.0, duration_s=60.0)
GAP, MARGIN, HOTTEST = "mean_gap", "smallest_margin", "cell_n_temperature_max"


def results(runs: Mapping[str, float], figure: str = GAP) -> Results:
    """Runs with one figure; no check of this file may look into their trajectories."""

    def load() -> None:
        raise AssertionError("a check of figures read a trajectory")

    return Results(
        ReportRun(address, {figure: number}, PARAMETERS, ROUTE, COST_TERMS["aging"], load)  # type: ignore[arg-type]
        for address, number in runs.items()
    )


def series(*values: float) -> Results:
    """Runs on horizons of 0, 1, ... seconds."""
    return results({f"prediction_horizon/{place}": value for place, value in enumerate(values)})


def found(stored: Results, kind: str, /, **arguments: Any) -> Finding:
    check = make_check(kind, **arguments)
    assert "eproduced" in check.rule
    finding = check.apply(stored)
    assert finding.found
    return finding


@pytest.mark.parametrize(
    ("change_found", "printed", "expected"),
    [
        (-0.07, -0.08, REPRODUCED),
        (-0.061, -0.08, REPRODUCED),
        (-0.059, -0.08, SIGN_ONLY),
        (-0.2, -0.08, SIGN_ONLY),
        (0.01, -0.08, NOT),
        (0.0, -0.08, NOT),
        # Within a percentage point, but of the other sign.
        (0.001, -0.003, NOT),
        (-0.012, -0.003, REPRODUCED),
    ],
)
def test_change_is_compared_with_the_printed_one(
    change_found: float, printed: float, expected: Verdict
) -> None:
    runs = results({REFERENCE: 200.0, PROPOSED: 200.0 * (1.0 + change_found)})
    finding = found(runs, "change", run=PROPOSED, base=REFERENCE, figure=GAP, printed=printed)
    assert finding.verdict is expected
    assert finding.in_print == change_text(printed)


@pytest.mark.parametrize(
    ("ends", "expected"),
    [((-0.016, -0.027), REPRODUCED), ((-0.016, -0.06), SIGN_ONLY), ((-0.016, 0.001), NOT)],
)
def test_range_of_changes_is_compared_at_both_ends(
    ends: tuple[float, float], expected: Verdict
) -> None:
    runs = results({PROPOSED: 100.0, "a/1": 100.0 * (1 + ends[0]), "a/2": 100.0 * (1 + ends[1])})
    arguments = {"runs": "a/1|2", "base": PROPOSED, "figure": GAP, "printed": (-0.0276, -0.0158)}
    assert found(runs, "changes_in_range", **arguments).verdict is expected


@pytest.mark.parametrize(
    ("number", "expected"), [(85.0, REPRODUCED), (95.0, SIGN_ONLY), (101.0, NOT)]
)
def test_bound_on_a_reduction(number: float, expected: Verdict) -> None:
    runs = results({REFERENCE: 100.0, PROPOSED: number}, CELL_1)
    arguments = {"run": PROPOSED, "base": REFERENCE, "figures": [CELL_1], "reduction": 0.12}
    finding = found(runs, "reduction_at_least", **arguments)
    assert finding.verdict is expected
    assert finding.in_print == "degradation of cell 1 -12.77 %"


@pytest.mark.parametrize(
    ("number", "expected"), [(5.0, REPRODUCED), (2.0, SIGN_ONLY), (-0.1, NOT), (0.0, NOT)]
)
def test_printed_value(number: float, expected: Verdict) -> None:
    arguments = {"run": PROPOSED, "figure": MARGIN, "share": 0.25, "floor": 1.0}
    finding = found(results({PROPOSED: number}, MARGIN), "value", **arguments)
    assert (finding.verdict, finding.in_print) == (expected, "5.904 m")


@pytest.mark.parametrize(
    ("number", "expected"), [(39.0, REPRODUCED), (40.0, REPRODUCED), (40.1, NOT), (38.9, NOT)]
)
def test_bounds_on_a_value(number: float, expected: Verdict) -> None:
    bounds = {"run": PROPOSED, "figure": HOTTEST, "lowest": 39.0}
    runs = results({PROPOSED: number}, HOTTEST)
    assert found(runs, "value_between", **bounds, highest=40.0).verdict is expected
    open_end = found(results({PROPOSED: 99.0}, HOTTEST), "value_between", **bounds)
    assert open_end.verdict is REPRODUCED


def test_all_lower_counts_comparisons_here_and_in_print() -> None:
    arguments = {"lower": PROPOSED, "higher": [REFERENCE, VICE], "figures": [TRACTION]}
    better = results({PROPOSED: 90.0, REFERENCE: 100.0, VICE: 95.0}, TRACTION)
    both = "2 of 2 comparisons hold"
    assert found(better, "all_lower", **arguments) == Finding(REPRODUCED, both, both)
    equal = results({PROPOSED: 95.0, REFERENCE: 100.0, VICE: 95.0}, TRACTION)
    finding = found(equal, "all_lower", **arguments)
    assert finding.verdict is NOT
    assert "1 of 2" in finding.found
    assert "Energy + Aging 95.00 kJ" in finding.found
    half = found(equal, "all_lower", **arguments, needed_share=0.5)
    assert half.verdict is REPRODUCED


def test_many_failures_are_cut_short() -> None:
    higher = "prediction_horizon/1|2|3|4|5|6|7"
    arguments = {"lower": "prediction_horizon/0", "higher": higher, "figures": [GAP]}
    text = found(series(*[1.0] * 8), "all_lower", **arguments).found
    assert text.startswith("0 of 7")
    assert text.endswith("and 3 more")


@pytest.mark.parametrize(
    ("ends", "expected"),
    [((100.0, 90.0), REPRODUCED), ((90.0, 95.0), REPRODUCED), ((94.0, 90.0), NOT)],
)
def test_between_takes_the_ends_in_any_order(ends: tuple[float, float], expected: Verdict) -> None:
    runs = results({REFERENCE: ends[0], PROPOSED: ends[1], VICE: 95.0}, TRACTION)
    arguments = {"run": VICE, "ends": [REFERENCE, PROPOSED], "figures": [TRACTION]}
    assert found(runs, "between", **arguments).verdict is expected


@pytest.mark.parametrize(("proposed", "expected"), [(90.0, REPRODUCED), (99.0, NOT)])
def test_rank_counts_lower_values(proposed: float, expected: Verdict) -> None:
    runs = results({PROPOSED: proposed, REFERENCE: 100.0, VICE: 95.0}, COOLING)
    among = [PROPOSED, VICE, REFERENCE]
    finding = found(runs, "rank", among=among, run=VICE, figures=[COOLING], place=2)
    assert (finding.verdict, finding.in_print) == (expected, "cooling energy: rank 1")


def test_best_choice_ranks_the_means() -> None:
    candidates = {"2 s": "prediction_horizon/0|1", "5 s": "prediction_horizon/2|3"}
    arguments = {"candidates": candidates, "figure": GAP}
    won = found(series(1.0, 5.0, 2.0, 3.0), "best_choice", **arguments, expected=["5 s"])
    assert won.verdict is REPRODUCED
    assert "best in 1 of 2 groups" in won.found
    lost = found(series(1.0, 3.0, 2.0, 3.0), "best_choice", **arguments, expected=["5 s"])
    assert lost.verdict is NOT
    whole = found(series(1.0, 5.0, 2.0, 3.0), "best_choice", **arguments, expected=["5 s", "2 s"])
    assert whole.verdict is REPRODUCED


THREE = "prediction_horizon/0|1|2"
TREND = ("trend", {"runs": THREE, "directions": {GAP: "falls"}, "least_change": 0.01})
ENDS = ("trend", {"runs": THREE, "directions": {GAP: "falls"}, "every_step": False})
NOT_ALWAYS = ("not_always", {"runs": THREE, "figures": [GAP], "direction": "falls"})
LEVELS = ("levels_off", {"groups": {"a": THREE}, "positions": [0.0, 1.0, 3.0], "figures": [GAP]})
TWO = {"a": "prediction_horizon/0|1"}
WIDE = ("spread", {"groups": TWO, "figures": [GAP], "at_least": 0.05})
NARROW = ("spread", {"groups": TWO, "figures": [GAP], "at_most": 0.05})
GROUPS = {"a": THREE, "b": "prediction_horizon/3|4|5"}
EACH = ("trend_in_groups", {"groups": GROUPS, "figure": GAP, "direction": "rises"})
HALF = ("trend_in_groups", {**EACH[1], "needed_share": 0.5})


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
    ],
)
def test_series(
    check: tuple[str, dict[str, Any]], values: tuple[float, ...], expected: Verdict
) -> None:
    kind, arguments = check
    assert found(series(*values), kind, **arguments).verdict is expected


def test_missing_runs_and_figures_leave_a_claim_untested() -> None:
    both = {"lower": "prediction_horizon/0", "higher": "prediction_horizon/1", "figures": [GAP]}
    gone = Results(series(1.0).runs.values(), {"prediction_horizon/1": "failed: no solution"})
    finding = found(gone, "all_lower", **both)
    assert finding.verdict is UNTESTED
    assert "Prediction horizon: prediction_horizon/1 (failed: no solution)" in finding.found
    other = results({"prediction_horizon/0": 1.0, "prediction_horizon/1": 1.0}, CELL_1)
    assert found(other, "all_lower", **both) == Finding(UNTESTED, "the stored runs lack mean gap")
    runs = results({PROPOSED: 1.0, REFERENCE: 0.0})
    arguments = {"run": PROPOSED, "base": REFERENCE, "figure": GAP, "printed": -0.1}
    assert found(runs, "change", **arguments).verdict is UNTESTED


def test_a_cause_is_shown_unless_the_claim_is_reproduced() -> None:
    check = make_check("value_between", run="prediction_horizon/0", figure=GAP, lowest=1.0)
    claim = Claim("the-claim", "Section I", "Something is so.", check, cause="{{ TRACTION }} is so")
    without = Claim("other", "Section I", "Something else.", check)
    causes = [
        check_claims((claim,), runs)[0].cause for runs in (series(2.0), series(0.0), series())
    ]
    assert causes == ["", f"{TRACTION} is so", ""]
    assert check_claims((without,), series(0.0))[0].cause.startswith("No cause")


def test_changes_and_shares() -> None:
    assert change_text(-0.07324) == "-7.32 %"
    assert change_text(None) == "–"
    assert relative_change(1.0, 0.0) is None
    runs = results({PROPOSED: 8.0, REFERENCE: 10.0, OPTIMUM: 6.0}, DEGRADATION)
    assert runs.share_of_saving(PROPOSED) == pytest.approx(0.5)
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
    assert runs.matching(REFERENCE, "prediction_horizon/*") == [REFERENCE, *runs.runs]
    assert runs.matching("prediction_horizon/*", without="*/0") == ["prediction_horizon/1"]
