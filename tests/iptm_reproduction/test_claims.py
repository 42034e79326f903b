"""The paper's numbers and statements are sound in themselves, and can be checked with the shipped studies."""

import re

import pytest

from iptm_core.metrics.figures import Figure
from iptm_reproduction import figures as fig
from iptm_reproduction.causes import causes, remarks
from iptm_reproduction.chapters import CHAPTERS
from iptm_reproduction.check import Verdict
from iptm_reproduction.claims import CLAIMS
from iptm_reproduction.printed import (
    FIGURE_CAPTIONS,
    HEADLINE_CHANGES,
    LENGTH_RANGES,
    PARAMETER_TABLES,
    STRATEGY_CHANGES,
    STRATEGY_VALUES,
    printed_change,
    printed_value,
)
from iptm_reproduction.runs import (
    MULTI_HORIZON,
    PROPOSED,
    REFERENCE,
    STRATEGIES,
    STUDIES,
    VICE,
    Results,
)
from iptm_reproduction.tables.paper_tables import formulation_table, parameter_table
from iptm_studies.study_loading import available_studies, load_study

# The one value of the printed table that contradicts its neighbours, see the note on it, as it should read.
SWAPPED = {(VICE, fig.CELL_1): 1.2190}


def printed(run: str, figure: Figure) -> float:
    value = SWAPPED.get((run, figure), printed_value(run, figure))
    assert value is not None
    return value


@pytest.mark.parametrize("figure", fig.TABLE_FIGURES, ids=lambda figure: figure.key)
def test_printed_changes_follow_from_printed_values(figure: Figure) -> None:
    """A number typed wrongly would show here: the paper prints both."""
    assert len(STRATEGY_VALUES[figure]) == len(STRATEGY_CHANGES[figure]) + 1 == len(STRATEGIES)
    for run in STRATEGIES[1:]:
        change = printed(run, figure) / printed(REFERENCE, figure) - 1.0
        assert change == pytest.approx(printed_change(run, figure), abs=1.01e-4), run


@pytest.mark.parametrize("run", STRATEGIES)
def test_printed_sums_and_differences(run: str) -> None:
    """The total is traction plus cooling, the inconsistency the difference of the cells."""
    total = printed(run, fig.COOLING) + printed(run, fig.TRACTION)
    assert total == pytest.approx(printed(run, fig.TOTAL), abs=0.011)
    between = 100.0 * (printed(run, fig.CELL_N) - printed(run, fig.CELL_1))
    assert between == pytest.approx(printed(run, fig.INCONSISTENCY), abs=0.02)


@pytest.mark.parametrize(
    ("figure", "end"),
    [(fig.COOLING, 0), (fig.TRACTION, 1), (fig.CELL_1, 1), (fig.CELL_N, 1), (fig.INCONSISTENCY, 0)],
    ids=lambda value: getattr(value, "key", None),
)
def test_printed_ranges_follow_from_headline_and_table(figure: Figure, end: int) -> None:
    """MH 3+5 against SH 15 is one end of each printed range; for cooling that is an increase."""
    change = (1.0 + HEADLINE_CHANGES[figure]) / (1.0 + printed_change(PROPOSED, figure)) - 1.0
    assert change == pytest.approx(LENGTH_RANGES[figure][end], abs=2e-4)


def test_statements_name_the_numbers_that_they_are_checked_against() -> None:
    """Each percentage of a statement on one change is the printed change of its check."""
    seen = 0
    for claim in CLAIMS:
        percent = re.search(r"by (\d+\.\d+) %", claim.statement)
        if not percent:
            continue
        seen += 1
        tolerance = re.search(r"here (\d+\.\d\d) points", claim.check.rule)
        assert tolerance is not None, claim.id
        assert float(tolerance[1]) == pytest.approx(
            max(1.0, 0.25 * float(percent[1])), abs=0.006
        ), claim.id
    assert seen >= 13


def test_ids_and_statements_are_unique() -> None:
    assert len(CLAIMS) == 78
    assert len({claim.id for claim in CLAIMS}) == len(CLAIMS)
    assert len({claim.statement for claim in CLAIMS}) == len(CLAIMS)


def test_every_statement_can_be_checked_with_the_shipped_studies() -> None:
    studies = list(map(load_study, available_studies()))
    cases = {study.address(case) for study in studies for case in study.cases}
    needed = {run for claim in CLAIMS for run in claim.check.runs} | {MULTI_HORIZON, REFERENCE}
    assert needed - cases == set()
    assert set(available_studies()) == set(STUDIES)


def test_rules_speak_in_words_and_not_in_addresses() -> None:
    for claim in CLAIMS:
        assert "eproduced" in claim.check.rule
        assert not any(f"{study}/" in claim.check.rule for study in STUDIES), claim.id


def test_causes_and_remarks_belong_to_claims_and_chapters() -> None:
    """They also read without any run: dashes stand for the numbers."""
    reasons, notes = causes(Results([])), remarks(Results([]))
    assert set(reasons) <= {claim.id for claim in CLAIMS}
    assert set(notes) <= {chapter.key for chapter in CHAPTERS}
    for text in (*reasons.values(), *notes.values()):
        assert "{" not in text
        assert "  " not in text
        assert text.endswith(".")
    assert "pays only after – s on this trip" in reasons["settles-near-30"]
    assert (
        "– kJ of – kJ for the reference here, printed 8 049.01 kJ of 187 082.68 kJ"
        in (reasons["headline-total"])
    )


def test_printed_parameters_are_those_in_use() -> None:
    """Tables I to III: the default set has the printed values."""
    for table in (*map(parameter_table, PARAMETER_TABLES), formulation_table()):
        for row in table.rows:
            assert row[-1].verdict is Verdict.REPRODUCED, row


def test_every_figure_of_results_has_its_caption() -> None:
    names = [name for name, _ in FIGURE_CAPTIONS.values()]
    assert len(set(names)) == len(names)
    numbers = {int(number) for name in names for number in re.findall(r"\d+", name)}
    assert numbers == set(range(4, 14))
