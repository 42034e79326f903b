"""The file of the paper's numbers and statements: sound in itself, and read strictly."""

from pathlib import Path
from typing import Any

import pytest

from iptm_core.errors import ScenarioError
from iptm_studies.report.addresses import expanded, expanded_all
from iptm_studies.report.causes import filled_in, load_causes
from iptm_studies.report.claims import CLAIMS_FILE, load_claims
from iptm_studies.report.measures import MEASURES
from iptm_studies.report.paper import PaperClaims
from iptm_studies.report.plots.registry import PLOTS
from iptm_studies.report.rules import RULES
from iptm_studies.report.rules.base import Printed
from iptm_studies.report.runs import STUDIES, Results
from iptm_studies.report.tables.paper_tables import formulation_table, parameter_table
from iptm_studies.report.verdict import Tolerance, Verdict
from iptm_studies.study_loading import available_studies, load_study

# (figure, strategy): the one value of the printed table that contradicts its neighbours, see its note.
SWAPPED = {("cell_1_degradation", "energy_aging"): 1.2190}


@pytest.fixture(scope="module")
def paper() -> PaperClaims:
    return load_claims()


def test_printed_changes_follow_from_printed_values(paper: PaperClaims) -> None:
    """A number typed wrongly would show here: the paper prints both."""
    table = paper.strategy_table
    for key, values in table.values.items():
        for strategy, value, change in zip(
            table.order[1:], values[1:], table.changes[key], strict=True
        ):
            read = SWAPPED.get((key, strategy), value)
            assert read / values[0] - 1.0 == pytest.approx(change, abs=1.01e-4), (key, strategy)


def test_printed_totals_are_traction_plus_cooling(paper: PaperClaims) -> None:
    values = paper.strategy_table.values
    for cooling, traction, total in zip(
        values["cooling_energy"],
        values["traction_energy"],
        values["total_energy_printed"],
        strict=True,
    ):
        assert cooling + traction == pytest.approx(total, abs=0.011)


def test_printed_inconsistency_is_the_difference_of_the_cells(paper: PaperClaims) -> None:
    values = paper.strategy_table.values
    for strategy, first, last, between in zip(
        paper.strategy_table.order,
        values["cell_1_degradation"],
        values["cell_n_degradation"],
        values["inconsistency"],
        strict=True,
    ):
        read = SWAPPED.get(("cell_1_degradation", strategy), first)
        assert 100.0 * (last - read) == pytest.approx(between, abs=0.02)


@pytest.mark.parametrize(
    ("claim_id", "key", "end"),
    [
        ("length-cooling-range", "cooling_energy", "lowest"),
        ("length-traction-range", "traction_energy", "highest"),
        ("length-cell-1-range", "cell_1_degradation", "highest"),
        ("length-cell-n-range", "cell_n_degradation", "highest"),
        ("length-inconsistency-range", "inconsistency", "lowest"),
    ],
)
def test_printed_ranges_follow_from_headline_and_table(
    paper: PaperClaims, claim_id: str, key: str, end: str
) -> None:
    """MH 3+5 against SH 15 is one end of each printed range; for cooling that is an increase."""
    headline = paper.headline.changes[key]
    single = paper.strategy_table.changes[key][-1]
    rule: Any = next(claim.rule for claim in paper.claims if claim.id == claim_id)
    assert (1.0 + headline) / (1.0 + single) - 1.0 == pytest.approx(getattr(rule, end), abs=2e-4)


def test_headline_claims_repeat_the_headline(paper: PaperClaims) -> None:
    rules: list[Any] = [
        claim.rule for claim in paper.claims if claim.group == "Headline comparison"
    ]
    printed = {rule.measure: rule.printed for rule in rules if hasattr(rule, "printed")}
    assert printed == dict(paper.headline.changes)


def test_strategy_claims_repeat_the_table(paper: PaperClaims) -> None:
    table = paper.strategy_table
    for claim in paper.claims:
        rule: Any = claim.rule
        if not (hasattr(rule, "printed") and getattr(rule, "base", "") == "strategies/reference"):
            continue
        study, name = rule.run.split("/")
        if study == "strategies":
            place = table.order.index(name) - 1
            assert rule.printed == table.changes[rule.measure][place], claim.id


def test_printed_parameters_are_those_in_use(paper: PaperClaims) -> None:
    """Tables I to III: the default set has the printed values."""
    tables = [*map(parameter_table, paper.parameter_tables), formulation_table(paper)]
    for table in tables:
        for row in table.rows:
            assert row[-1].verdict is Verdict.REPRODUCED, row


def test_every_statement_can_be_checked_with_the_shipped_studies(paper: PaperClaims) -> None:
    cases = {
        study.address(case)
        for study in map(load_study, available_studies())
        for case in study.cases
    }
    needed = {address for claim in paper.claims for address in claim.rule.needs()}
    for plot in PLOTS.values():
        needed |= {*plot.needs, *plot.wanted}
    needed |= {paper.headline.run, paper.headline.base}
    assert needed - cases == set()
    assert set(available_studies()) == set(STUDIES)


def test_every_figure_and_group_of_the_paper_is_there(paper: PaperClaims) -> None:
    assert {figure.key for figure in paper.figures} <= set(PLOTS)
    assert [figure.figure for figure in paper.figures] == [
        "Fig. 4",
        "Fig. 5",
        "Fig. 6a",
        "Fig. 6b",
        "Fig. 7a",
        "Fig. 7b",
        "Fig. 8a",
        "Fig. 8b",
        *(f"Fig. {number}" for number in range(9, 14)),
    ]
    assert len(paper.claims) >= 60


def test_every_rule_says_what_it_does(paper: PaperClaims) -> None:
    for claim in paper.claims:
        text = claim.rule.text(paper.printed)
        assert "eproduced" in text
        assert "/" not in text.replace("1/", ""), f"{claim.id}: an address in words: {text}"
    assert {type(claim.rule) for claim in paper.claims} == set(RULES.values())


def replaced(old: str, new: str) -> str:
    text = CLAIMS_FILE.read_text(encoding="utf-8")
    assert old in text, old
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rule: aging_falls", "rule: aging_rises", "aging-falls: unknown rule 'aging_rises'"),
        ("reduction: 0.22", "reduction: 22 %", "headline-over-22.*reduction: a finite number"),
        ("reduction: 0.22", "reducton: 0.22", "headline-over-22.*unknown reducton"),
        ("    printed: -0.0718\n", "", "headline-computing-time.*missing printed"),
        ("measure: solve_total", "measure: solve_totl", "unknown figure 'solve_totl'"),
        ("run: long_horizon/3+5\n    base", "run: longhorizon/3+5\n    base", "unknown study"),
        ("{5,10,15,20}", "{5,10,15,20", "braces"),
        ("{5,10,15,20}", "{5,10,,20}", "empty alternative"),
        ("{5,10,15,20}", "{5,10,5,20}", "occurs twice"),
        ("id: headline-cooling", "id: headline-traction", "same id: headline-traction"),
        ("directions: {solve_total: rises}", "directions: {solve_total: up}", "direction"),
        ("key: body.mass_kg", "key: body.mass", "unknown parameter 'body.mass'"),
        ("8049.01, 6925.07", "8049.01", "cooling_energy"),
        ("    group: Headline comparison\n", "", "group"),
        ("change_tolerance:", "tolerance_of_change:", "missing.*change_tolerance"),
        ("headline:\n  where", "headline:\n  were", "headline: unknown were"),
        ("runs: [long_horizon/3+5]", "runs: long_horizon/3+5", "a list is needed"),
        ("paper:\n", "paper:\npaper:\n", "twice"),
    ],
)
def test_malformed_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "claims.yaml"
    path.write_text(replaced(old, new), encoding="utf-8")
    with pytest.raises(ScenarioError, match=rf"(?s){message}"):
        load_claims(path)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="no such file"):
        load_claims(tmp_path / "none.yaml")


def test_braces_stand_for_every_combination() -> None:
    assert expanded("a/{b,c}+{1,2}", "test") == ["a/b+1", "a/b+2", "a/c+1", "a/c+2"]
    assert expanded_all(["x/y", "z/{1,2}"], "test") == ("x/y", "z/1", "z/2")


PRINTED = Printed({"strategies/aging": {"traction_energy": 90.0}}, Tolerance(0.25, 0.01))


def test_causes_belong_to_claims(tmp_path: Path, paper: PaperClaims) -> None:
    ids = {claim.id for claim in paper.claims}
    load_causes(ids)
    path = tmp_path / "causes.yaml"
    path.write_text("claims: {no-such-claim: because}\nchapters: {}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="no claim 'no-such-claim'"):
        load_causes(ids, path)
    path.write_text("claims: {aging-falls: 3}\nchapters: {}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="aging-falls: a text is needed"):
        load_causes(ids, path)
    path.write_text("claims: {}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="needed are claims and chapters"):
        load_causes(ids, path)


def test_causes_take_their_numbers_from_results() -> None:
    texts = filled_in(
        {
            "one": "printed {{ printed('strategies/aging', 'traction_energy') }},\n  "
            "found {{ value('strategies/aging', 'traction_energy') }}, "
            "{{ payback('strategies/aging') }}, {{ braking_share('strategies/aging') }}"
        },
        Results([]),
        PRINTED,
    )
    assert (
        texts["one"] == f"printed {MEASURES['traction_energy'].text(90.0)} kJ, found – kJ, – s, – %"
    )


@pytest.mark.parametrize(
    "text",
    [
        "{{ value('strategies/aging', 'speed') }}",
        "{{ value('x/y', 'distance') }}",
        "{{ oops",
        "{{ a }}",
    ],
)
def test_malformed_causes_are_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match="one: "):
        filled_in({"one": text}, Results([]), PRINTED)
