"""Checks on figures of runs, against numbers made by hand: held, in sign only, not held."""

from collections.abc import Mapping

import pytest

from iptm_controller.strategy import STRATEGIES as COST_TERMS
from iptm_core.metrics.figures import Figure
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_reproduction import figures as fig
from iptm_reproduction.check import Check, Claim, ClaimTopic, Finding, Verdict, check_topic, tally
from iptm_reproduction.checks.numbers import (
    change,
    changes_in_range,
    reduction_at_least,
    value,
    value_between,
)
from iptm_reproduction.checks.orders import all_lower, best_choice, between, rank
from iptm_reproduction.checks.trends import (
    FALLS,
    RISES,
    levels_off,
    not_always,
    spread,
    trend,
    trend_in_groups,
)
from iptm_reproduction.figures import change_text, relative_change, share_of_saving
from iptm_reproduction.runs import (
    PROPOSED,
    REFERENCE,
    VICE,
    MissingRun,
    ReportRun,
    Results,
    horizons,
    name_of,
    names_of,
)

REPRODUCED, SIGN_ONLY, NOT, UNTESTED = Verdict
PARAMETERS = load_parameters().values
ROUTE = build_route("us06", initial_gap_m=15.0, duration_s=60.0)


def results(runs: Mapping[str, float], figure: Figure = fig.MEAN_GAP) -> Results:
    """Runs with one figure; no check of this file may look into their trajectories."""

    def load() -> None:
        raise AssertionError("a check of figures read a trajectory")

    return Results(
        ReportRun(address, {figure.key: number}, PARAMETERS, ROUTE, COST_TERMS["aging"], load)  # type: ignore[arg-type]
        for address, number in runs.items()
    )


def series(*values: float) -> Results:
    """Runs on horizons of 0, 1, ... seconds."""
    return results(dict(zip(horizons(*range(len(values))), values, strict=True)))


def verdict(check: Check, runs: Results) -> Verdict:
    return found(check, runs).verdict


def found(check: Check, runs: Results) -> Finding:
    assert "eproduced" in check.rule
    finding = check.apply(runs)
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
    finding = found(change(PROPOSED, REFERENCE, fig.MEAN_GAP, printed), runs)
    assert finding.verdict is expected
    assert finding.in_print == change_text(printed)


@pytest.mark.parametrize(
    ("ends", "expected"),
    [((-0.016, -0.027), REPRODUCED), ((-0.016, -0.06), SIGN_ONLY), ((-0.016, 0.001), NOT)],
)
def test_range_of_changes_is_compared_at_both_ends(
    ends: tuple[float, float], expected: Verdict
) -> None:
    runs = results(
        {PROPOSED: 100.0, "a/1": 100.0 * (1.0 + ends[0]), "a/2": 100.0 * (1.0 + ends[1])}
    )
    check = changes_in_range(("a/1", "a/2"), PROPOSED, fig.MEAN_GAP, -0.0276, -0.0158)
    assert verdict(check, runs) is expected


@pytest.mark.parametrize(
    ("number", "expected"), [(85.0, REPRODUCED), (95.0, SIGN_ONLY), (101.0, NOT)]
)
def test_bound_on_a_reduction(number: float, expected: Verdict) -> None:
    check = reduction_at_least(PROPOSED, REFERENCE, (fig.CELL_1,), 0.12)
    finding = found(check, results({REFERENCE: 100.0, PROPOSED: number}, fig.CELL_1))
    assert finding.verdict is expected
    assert finding.in_print == "degradation of cell 1 -12.77 %"


@pytest.mark.parametrize(
    ("number", "expected"), [(5.0, REPRODUCED), (2.0, SIGN_ONLY), (-0.1, NOT), (0.0, NOT)]
)
def test_printed_value(number: float, expected: Verdict) -> None:
    check = value(PROPOSED, fig.SMALLEST_MARGIN, 5.904, share=0.25, floor=1.0)
    assert verdict(check, results({PROPOSED: number}, fig.SMALLEST_MARGIN)) is expected


@pytest.mark.parametrize(
    ("number", "expected"), [(39.0, REPRODUCED), (40.0, REPRODUCED), (40.1, NOT), (38.9, NOT)]
)
def test_bounds_on_a_value(number: float, expected: Verdict) -> None:
    check = value_between(PROPOSED, fig.CELL_N_MAX, lowest=39.0, highest=40.0)
    assert verdict(check, results({PROPOSED: number}, fig.CELL_N_MAX)) is expected
    open_end = value_between(PROPOSED, fig.CELL_N_MAX, lowest=39.0)
    assert verdict(open_end, results({PROPOSED: 99.0}, fig.CELL_N_MAX)) is REPRODUCED


def test_all_lower_counts_comparisons_here_and_in_print() -> None:
    check = all_lower((PROPOSED,), (REFERENCE, VICE), (fig.TRACTION,))
    better = found(check, results({PROPOSED: 90.0, REFERENCE: 100.0, VICE: 95.0}, fig.TRACTION))
    assert (better.verdict, better.found) == (REPRODUCED, "2 of 2 comparisons hold")
    assert better.in_print == "2 of 2 comparisons hold"
    equal = results({PROPOSED: 95.0, REFERENCE: 100.0, VICE: 95.0}, fig.TRACTION)
    assert verdict(check, equal) is NOT
    assert "1 of 2" in found(check, equal).found
    assert "Energy + Aging 95.00 kJ" in found(check, equal).found
    half = all_lower((PROPOSED,), (REFERENCE, VICE), (fig.TRACTION,), needed_share=0.5)
    assert verdict(half, equal) is REPRODUCED


def test_many_failures_are_cut_short() -> None:
    check = all_lower(horizons(0), horizons(*range(1, 8)), (fig.MEAN_GAP,))
    text = found(check, series(*[1.0] * 8)).found
    assert text.startswith("0 of 7")
    assert text.endswith("and 3 more")


@pytest.mark.parametrize(
    ("ends", "expected"),
    [((100.0, 90.0), REPRODUCED), ((90.0, 95.0), REPRODUCED), ((94.0, 90.0), NOT)],
)
def test_between_takes_the_ends_in_any_order(ends: tuple[float, float], expected: Verdict) -> None:
    check = between(VICE, (REFERENCE, PROPOSED), (fig.TRACTION,))
    runs = results({REFERENCE: ends[0], PROPOSED: ends[1], VICE: 95.0}, fig.TRACTION)
    assert verdict(check, runs) is expected


@pytest.mark.parametrize(("proposed", "expected"), [(90.0, REPRODUCED), (99.0, NOT)])
def test_rank_counts_lower_values(proposed: float, expected: Verdict) -> None:
    check = rank(VICE, (PROPOSED, VICE, REFERENCE), (fig.COOLING,), place=2)
    runs = results({PROPOSED: proposed, REFERENCE: 100.0, VICE: 95.0}, fig.COOLING)
    assert verdict(check, runs) is expected
    assert found(check, runs).in_print == "cooling energy: rank 1"


def test_best_choice_ranks_the_means() -> None:
    candidates = {"2 s": horizons(0, 1), "5 s": horizons(2, 3)}
    check = best_choice(candidates, ("5 s",), fig.MEAN_GAP)
    won = found(check, series(1.0, 5.0, 2.0, 3.0))
    assert won.verdict is REPRODUCED
    assert "best in 1 of 2 groups" in won.found
    assert verdict(check, series(1.0, 3.0, 2.0, 3.0)) is NOT
    whole = best_choice(candidates, ("5 s", "2 s"), fig.MEAN_GAP)
    assert verdict(whole, series(1.0, 5.0, 2.0, 3.0)) is REPRODUCED


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((10.0, 9.0, 8.0), REPRODUCED),
        # A step of less than 0.05 % the other way counts as level.
        ((10.0, 10.004, 8.0), REPRODUCED),
        ((10.0, 11.0, 8.0), SIGN_ONLY),
        ((10.0, 9.99, 9.98), SIGN_ONLY),
        ((10.0, 9.0, 10.0), NOT),
    ],
)
def test_trend_needs_every_step_and_the_size(values: tuple[float, ...], expected: Verdict) -> None:
    assert (
        verdict(trend(horizons(0, 1, 2), {fig.MEAN_GAP: FALLS}, 0.01), series(*values)) is expected
    )


def test_trend_between_the_ends_only() -> None:
    check = trend(horizons(0, 1, 2), {fig.MEAN_GAP: FALLS}, every_step=False)
    assert verdict(check, series(10.0, 11.0, 8.0)) is REPRODUCED


@pytest.mark.parametrize(
    ("values", "expected"), [((3.0, 2.0, 1.0), NOT), ((3.0, 3.1, 1.0), REPRODUCED)]
)
def test_not_always(values: tuple[float, ...], expected: Verdict) -> None:
    assert (
        verdict(not_always(horizons(0, 1, 2), (fig.MEAN_GAP,), FALLS), series(*values)) is expected
    )


@pytest.mark.parametrize(
    ("values", "share", "expected"),
    [
        ((1.0, 5.0, 4.0, 3.0, 3.5, 4.5), 1.0, SIGN_ONLY),
        ((1.0, 5.0, 4.0, 3.0, 3.5, 4.5), 0.5, REPRODUCED),
        ((1.0, 2.0, 3.0, 3.0, 4.0, 5.0), 1.0, REPRODUCED),
        ((1.0, 2.0, 3.0, 6.0, 4.0, 5.0), 1.0, NOT),
    ],
)
def test_trend_in_groups(values: tuple[float, ...], share: float, expected: Verdict) -> None:
    groups = {"a": horizons(0, 1, 2), "b": horizons(3, 4, 5)}
    assert verdict(trend_in_groups(groups, fig.MEAN_GAP, RISES, share), series(*values)) is expected


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((10.0, 8.0, 7.9), REPRODUCED),
        # Saves as much in the last step, but over twice the distance.
        ((10.0, 9.0, 8.0), REPRODUCED),
        ((10.0, 9.0, 6.0), SIGN_ONLY),
        ((10.0, 9.0, 11.0), NOT),
    ],
)
def test_levelling_off_counts_per_unit(values: tuple[float, ...], expected: Verdict) -> None:
    check = levels_off({"a": horizons(0, 1, 2)}, (0.0, 1.0, 3.0), (fig.MEAN_GAP,))
    assert verdict(check, series(*values)) is expected


@pytest.mark.parametrize(("largest", "wide"), [(1.1, True), (1.01, False)])
def test_spread_has_a_lower_or_an_upper_bound(largest: float, wide: bool) -> None:
    large = spread({"a": horizons(0, 1)}, (fig.MEAN_GAP,), at_least=0.05)
    small = spread({"a": horizons(0, 1)}, (fig.MEAN_GAP,), at_most=0.05)
    assert verdict(large, series(1.0, largest)) is (REPRODUCED if wide else NOT)
    assert verdict(small, series(1.0, largest)) is (NOT if wide else REPRODUCED)


def test_missing_runs_and_figures_leave_a_claim_untested() -> None:
    check = all_lower(horizons(0), horizons(1), (fig.MEAN_GAP,))
    gone = Results(series(1.0), [MissingRun("prediction_horizon/1", "failed: no solution")])
    finding = check.apply(gone)
    assert finding.verdict is UNTESTED
    assert "Prediction horizon: prediction_horizon/1 (failed: no solution)" in finding.found
    without = check.apply(
        results({"prediction_horizon/0": 1.0, "prediction_horizon/1": 1.0}, fig.CELL_1)
    )
    assert (without.verdict, without.found) == (UNTESTED, "the stored runs lack mean gap")
    from_nothing = change(PROPOSED, REFERENCE, fig.MEAN_GAP, -0.1)
    assert verdict(from_nothing, results({PROPOSED: 1.0, REFERENCE: 0.0})) is UNTESTED


def test_a_cause_is_shown_unless_the_claim_is_reproduced() -> None:
    check = value_between(*horizons(0), fig.MEAN_GAP, lowest=1.0)
    topic = ClaimTopic("A topic", (Claim("the-claim", "Section I", "Something is so.", check),))
    causes = {"the-claim": "shown"}
    (good,) = check_topic(topic, series(2.0), causes)
    (bad,) = check_topic(topic, series(0.0), causes)
    (untested,) = check_topic(topic, series(), causes)
    assert [entry.cause for entry in (good, bad, untested)] == ["", "shown", ""]
    assert check_topic(topic, series(0.0), {})[0].cause.startswith("No cause")
    assert tally([good, bad, bad]) == {REPRODUCED: 1, SIGN_ONLY: 0, NOT: 2, UNTESTED: 0}


def test_changes_and_shares() -> None:
    assert change_text(-0.07324) == "-7.32 %"
    assert change_text(None) == "–"
    assert relative_change(1.0, 0.0) is None
    assert share_of_saving(8.0, 10.0, 6.0) == pytest.approx(0.5)
    assert share_of_saving(8.0, 10.0, 11.0) is None


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
