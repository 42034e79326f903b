"""Chapters beyond the paper: the limit, imperfect previews, omitted parameters, origin of the runs."""

from __future__ import annotations

from iptm_studies.report.document import Cell, Paragraph, Section, Table
from iptm_studies.report.gathering import Provenance
from iptm_studies.report.runs import OPTIMUM_RUN, PROPOSED_RUN, REFERENCE_RUN, STUDIES
from iptm_studies.report.sections import Chapters
from iptm_studies.report.tables.limit_tables import optimum_solve_table, optimum_table
from iptm_studies.report.tables.robustness_tables import (
    OMITTED,
    PERFECT,
    PREVIEWS,
    conclusion_table,
    summary_text,
    variation_table,
)
from iptm_studies.report.tables.study_tables import reliability_table


def optimum_chapter(chapters: Chapters) -> Section:
    """What could be saved at most, and what is."""
    results = chapters.results
    runs = (REFERENCE_RUN, PROPOSED_RUN, OPTIMUM_RUN)
    return Section(
        "optimum",
        "Beyond the paper: the limit",
        (
            chapters.table(
                "optimum-table",
                "The whole trip as one problem",
                runs,
                lambda: optimum_table(results),
            ),
            chapters.picture("saving_shares"),
            chapters.picture("optimum"),
            chapters.table(
                "optimum-solves",
                "Solves of the whole trip",
                (OPTIMUM_RUN,),
                lambda: optimum_solve_table(results),
            ),
        ),
    )


def previews_chapter(chapters: Chapters) -> Section:
    """The strategies when the predictions are wrong, late, lost or absent."""
    results = chapters.results
    base = f"{PREVIEWS}/{PERFECT}/reference"
    return Section(
        "previews",
        "Beyond the paper: imperfect previews",
        (
            chapters.picture("imperfect_previews"),
            Paragraph(summary_text(results, PREVIEWS) or "Nothing to conclude from yet."),
            chapters.table(
                "conclusions-previews",
                "Conclusions",
                (base,),
                lambda: conclusion_table(results, PREVIEWS, "Conclusions under imperfect previews"),
            ),
            chapters.table(
                "imperfect-previews-table",
                STUDIES[PREVIEWS],
                (base,),
                lambda: variation_table(
                    results, PREVIEWS, "All strategies under imperfect previews", base
                ),
            ),
        ),
    )


def omitted_chapter(chapters: Chapters) -> Section:
    """The conclusions under other values of what the paper omits."""
    results = chapters.results
    base = f"{OMITTED}/as_chosen/reference"
    return Section(
        "omitted",
        "Beyond the paper: parameters that the paper omits",
        (
            chapters.picture("omitted_parameters"),
            Paragraph(summary_text(results, OMITTED) or "Nothing to conclude from yet."),
            chapters.table(
                "conclusions-omitted",
                "Conclusions",
                (base,),
                lambda: conclusion_table(results, OMITTED, "Conclusions under other parameters"),
            ),
            chapters.table(
                "omitted-parameters-table",
                STUDIES[OMITTED],
                (base,),
                lambda: variation_table(results, OMITTED, "All runs with other parameters"),
            ),
        ),
    )


def reliability_chapter(chapters: Chapters, provenance: Provenance) -> Section:
    """Limits kept, solver outcomes, and where the runs come from."""
    rows = [
        (Cell("trip"), Cell(provenance.trip)),
        (Cell("runs"), Cell(f"{provenance.runs} ({provenance.cases} cases)")),
        (Cell("computed"), Cell(f"{provenance.first_utc} to {provenance.last_utc}")),
        (Cell("wall time of all runs, one after the other"), Cell(f"{provenance.wall_h:.2f} h")),
        (Cell("runs without compiled problem"), Cell(str(provenance.interpreted))),
        (Cell("source"), Cell(_counted(provenance.revisions))),
        *((Cell(name), Cell(_counted(versions))) for name, versions in provenance.versions.items()),
    ]
    return Section(
        "reliability",
        "Reliability and origin of the runs",
        (
            reliability_table(chapters.results),
            Table("origin", "Origin of the runs", ("", ""), tuple(rows)),
        ),
    )


def _counted(values: dict[str, int]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return ", ".join(f"{name} ({count} runs)" for name, count in values.items())
