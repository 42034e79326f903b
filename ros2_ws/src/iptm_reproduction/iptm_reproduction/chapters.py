"""The order of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from iptm_studies.report.beyond_chapters import (
    omitted_chapter,
    optimum_chapter,
    previews_chapter,
    reliability_chapter,
)
from iptm_studies.report.document import Block, Cell, Document, Paragraph, Section, Table
from iptm_studies.report.evaluation import EvaluatedClaim, by_group, tally
from iptm_studies.report.gathering import Provenance
from iptm_studies.report.naming import STRATEGY_NAMES
from iptm_studies.report.paper import PaperClaims
from iptm_studies.report.plots.trip_plots import HORIZONS_S
from iptm_studies.report.runs import (
    PROPOSED_RUN,
    REFERENCE_RUN,
    STUDIES,
    Results,
)
from iptm_studies.report.sections import Chapters
from iptm_studies.report.tables.diagnosis_tables import cooling_table, payback_table
from iptm_studies.report.tables.limit_tables import discretisation_table
from iptm_studies.report.tables.paper_tables import (
    formulation_table,
    headline_table,
    omitted_parameter_table,
    parameter_table,
    ranking_text,
    strategy_table,
)
from iptm_studies.report.tables.study_tables import run_table, weight_table
from iptm_studies.report.verdict import Verdict

from iptm_core.errors import ScenarioError

TITLE = "Reproduction of the paper"
_RULES_TEXT = (
    "A statement is reproduced if the rule beside it holds within the stated tolerance; reproduced in "
    "sign only if the direction is right and the size is not; not reproduced otherwise; not tested if "
    "a run is missing. Rules are applied by code to stored runs. Where a rule can be applied to the "
    "paper's printed numbers alone, its outcome for them is given, too. The printed numbers and "
    "statements are data, each with its place in the paper."
)


def compose(
    results: Results,
    paper: PaperClaims,
    evaluated: Sequence[EvaluatedClaim],
    provenance: Provenance,
    command: str,
) -> Document:
    """Build the whole report.

    Args:
        results: the runs.
        paper: what the paper prints.
        evaluated: the checked statements.
        provenance: where the runs come from.
        command: what computes a study, without its name.

    Returns:
        The report; what cannot be built says why.
    """
    chapters = Chapters(results, paper, evaluated, command)
    sections = [
        _summary(chapters, provenance),
        _parameters(paper),
        _model(chapters),
        _strategies(chapters),
        _power(chapters),
        _trip(chapters),
        _weights(chapters),
        _horizon(chapters),
        _sampling_time(chapters),
        _long_horizon(chapters),
        optimum_chapter(chapters),
        previews_chapter(chapters),
        omitted_chapter(chapters),
    ]
    sections += chapters.unplaced()
    sections += [reliability_chapter(chapters, provenance)]
    return Document(TITLE, f"{paper.paper.authors}: {paper.paper.title}", tuple(sections))


def with_remarks(document: Document, remarks: Mapping[str, str], file: str) -> Document:
    """Put a remark at the beginning of each chapter that has one.

    Raises:
        ScenarioError: there is no chapter of that key.
    """
    unknown = set(remarks) - {section.key for section in document.sections}
    if unknown:
        raise ScenarioError(
            f"{file}: there is no chapter {', '.join(sorted(unknown))}; there are "
            f"{', '.join(section.key for section in document.sections)}"
        )
    return replace(
        document,
        sections=tuple(
            replace(section, blocks=(Paragraph(remarks[section.key]), *section.blocks))
            if section.key in remarks
            else section
            for section in document.sections
        ),
    )


def _summary(chapters: Chapters, provenance: Provenance) -> Section:
    paper, results = chapters.paper, chapters.results
    blocks: list[Block] = [
        Paragraph(
            f"Every number on this page comes from {provenance.runs} stored runs of the trip "
            f"{provenance.trip} ({provenance.cases} cases of the studies; equal runs are stored once)."
        ),
        _verdict_table(chapters.evaluated),
        Paragraph(_RULES_TEXT),
    ]
    if not provenance.whole_cycle:
        blocks.insert(
            1,
            Paragraph(
                "The runs do not all drive the whole comprehensive cycle. What is printed holds for "
                "that cycle, so that verdicts on numbers mean little here."
            ),
        )
    if results.gaps:
        names = dict.fromkeys(gap.study for gap in results.gaps)
        blocks.append(
            Paragraph(
                f"This report is incomplete: {len(results.gaps)} cases are missing, of the studies "
                f"{', '.join(names)}. What is not shown for this reason says so in its place. To "
                f"compute them: {chapters.command} {' '.join(names)}"
            )
        )
    headline = (paper.headline.run, paper.headline.base)
    blocks += [
        chapters.table(
            "headline-table",
            "Headline comparison",
            headline,
            lambda: headline_table(results, paper),
        ),
        chapters.picture("headline"),
        chapters.claims("Headline comparison"),
    ]
    return Section("summary", "Summary", tuple(blocks))


def _verdict_table(evaluated: Sequence[EvaluatedClaim]) -> Table:
    """Number of statements by heading and verdict."""
    verdicts = tuple(Verdict)
    groups = {**by_group(evaluated), "all statements": list(evaluated)}
    return Table(
        "verdicts",
        "Statements of the paper by verdict",
        ("statements about", "number", *(verdict.value for verdict in verdicts)),
        tuple(
            (
                Cell(name, strong=entries == list(evaluated)),
                Cell(str(len(entries))),
                *(Cell(str(tally(entries)[verdict])) for verdict in verdicts),
            )
            for name, entries in groups.items()
        ),
    )


def _parameters(paper: PaperClaims) -> Section:
    return Section(
        "parameters",
        "Parameters and formulations",
        (
            *(parameter_table(table) for table in paper.parameter_tables),
            omitted_parameter_table(paper),
            formulation_table(paper),
        ),
    )


def _model(chapters: Chapters) -> Section:
    return Section(
        "model",
        "Aging model and driving cycle",
        (
            chapters.picture("aging_map"),
            chapters.claims("Aging model"),
            chapters.picture("driving_cycle"),
        ),
    )


def _strategies(chapters: Chapters) -> Section:
    return Section(
        "strategies",
        "Six strategies on a single horizon",
        (
            chapters.table(
                "strategies",
                chapters.paper.strategy_table.title,
                (REFERENCE_RUN, PROPOSED_RUN),
                lambda: strategy_table(chapters.results, chapters.paper),
            ),
            Paragraph(ranking_text(chapters.results)),
            chapters.picture("strategy_changes"),
            chapters.claims("Strategies"),
        ),
    )


def _power(chapters: Chapters) -> Section:
    return Section(
        "power",
        "Power",
        (
            chapters.picture("power_distribution"),
            chapters.picture("power_statistics"),
            chapters.picture("power_profiles"),
            chapters.claims("Power"),
        ),
    )


def _trip(chapters: Chapters) -> Section:
    return Section(
        "trip",
        "Temperature, degradation and spacing",
        (
            chapters.picture("temperature_comparison"),
            _cooling(
                chapters, "cooling-strategies", [f"strategies/{name}" for name in STRATEGY_NAMES]
            ),
            chapters.table(
                "payback",
                "How long cooling takes to pay",
                (PROPOSED_RUN,),
                lambda: payback_table(chapters.results[PROPOSED_RUN]),
            ),
            chapters.picture("degradation_comparison"),
            chapters.picture("spacing"),
            chapters.claims("Temperature and spacing"),
        ),
    )


def _cooling(chapters: Chapters, key: str, addresses: Sequence[str]) -> Block:
    """When the compressor runs, for those of the runs that are there."""
    present = [address for address in addresses if address in chapters.results]
    return chapters.table(
        key,
        "When the compressor runs",
        () if present else addresses[:1],
        lambda: cooling_table(chapters.results, key, present),
    )


def _weights(chapters: Chapters) -> Section:
    results = chapters.results
    needs = () if results.study("weighting") else ("weighting/reference_energy/1",)
    return Section(
        "weights",
        "Sensitivity to the weights",
        (
            chapters.table(
                "weights",
                "Weights of the weighted strategies",
                needs,
                lambda: weight_table(results, "Fig. 9"),
            ),
            chapters.picture("weighting"),
            chapters.claims("Weighting sensitivity"),
        ),
    )


def _horizon(chapters: Chapters) -> Section:
    return Section(
        "horizon",
        "Sensitivity to the prediction horizon",
        (
            _study_table(chapters, "prediction_horizon", REFERENCE_RUN, "Fig. 10", HORIZONS_S[0]),
            chapters.picture("prediction_horizon"),
            chapters.picture("horizon_temperatures"),
            _cooling(
                chapters,
                "cooling-horizons",
                [f"prediction_horizon/{horizon}" for horizon in HORIZONS_S],
            ),
            chapters.claims("Prediction horizon"),
        ),
    )


def _sampling_time(chapters: Chapters) -> Section:
    return Section(
        "sampling-time",
        "Multi-horizon: sampling time of the long horizon",
        (
            _study_table(chapters, "sampling_time", PROPOSED_RUN, "Fig. 12", "3+12/5"),
            chapters.picture("sampling_time"),
            chapters.claims("Multi-horizon sampling time"),
        ),
    )


def _long_horizon(chapters: Chapters) -> Section:
    return Section(
        "long-horizon",
        "Multi-horizon: length of the long horizon",
        (
            _study_table(chapters, "long_horizon", PROPOSED_RUN, "Fig. 13", "3+5"),
            chapters.picture("long_horizon"),
            chapters.claims("Multi-horizon length"),
            chapters.table(
                "discretisation-table",
                STUDIES["discretisation"],
                ("discretisation/28/3+5", "discretisation/28/fine"),
                lambda: discretisation_table(chapters.results),
            ),
            chapters.picture("discretisation"),
        ),
    )


def _study_table(
    chapters: Chapters,
    study: str,
    base: str,
    paper: str,
    first: object,
) -> Block:
    """All runs of a study against one run."""
    results = chapters.results
    addresses = [run.address for run in results.study(study)]
    return chapters.table(
        f"{study.replace('_', '-')}-table",
        STUDIES[study],
        () if addresses else (f"{study}/{first}",),
        lambda: run_table(
            results,
            f"{study.replace('_', '-')}-table",
            STUDIES[study],
            addresses,
            base,
            paper=paper,
        ),
    )
