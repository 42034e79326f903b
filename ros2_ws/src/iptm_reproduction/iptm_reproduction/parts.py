"""What chapters of the report are made of: each part builds its block, or a note on why it cannot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from iptm_reproduction.check import CheckedClaim, ClaimTopic, Verdict, tally
from iptm_reproduction.document import (
    Block,
    Cell,
    ClaimList,
    Missing,
    Paragraph,
    Picture,
    Section,
    Table,
    cells,
)
from iptm_reproduction.gathering import Gathered
from iptm_reproduction.plots.style import Plot, png_bytes
from iptm_reproduction.printed import FIGURE_CAPTIONS
from iptm_reproduction.runs import Results, studies_of


@dataclass(frozen=True)
class Material(Gathered):
    """What parts take their content from: what was gathered, and the checked statements by topic."""

    checked: Mapping[str, tuple[CheckedClaim, ...]]


Part = Callable[[Material], Block | None]
"""Builds a block; None for one that does not apply."""


@dataclass(frozen=True)
class Chapter:
    """A chapter of the report: its heading and its parts."""

    key: str
    title: str
    parts: tuple[Part, ...]

    def section(self, material: Material, remark: str) -> Section:
        """Build the chapter; a remark goes to its beginning."""
        blocks = [part(material) for part in self.parts]
        first = (Paragraph(remark),) if remark else ()
        return Section(
            self.key, self.title, (*first, *(block for block in blocks if block is not None))
        )


def claims(topic: ClaimTopic) -> Part:
    """Show the statements of a topic with their verdicts."""
    return lambda material: ClaimList(material.checked[topic.title])


def text(write: Callable[[Results], str]) -> Part:
    """Show a paragraph."""
    return lambda material: Paragraph(write(material.results))


def table(
    key: str,
    title: str,
    build: Callable[[Results], Table],
    needs: tuple[str, ...] = (),
    any_of: tuple[str, ...] = (),
) -> Part:
    """Show a table.

    Args:
        key: identifier of the note in its place.
        title: heading of that note.
        build: makes the table.
        needs: runs without which it cannot be made.
        any_of: runs of which at least one is needed.
    """

    def part(material: Material) -> Block:
        lacking = material.results.lacking(needs)
        if any_of and material.results.lacking(any_of) == any_of:
            lacking = (*lacking, *any_of)
        return _missing(material, key, title, lacking) if lacking else build(material.results)

    return part


def picture(plot: Plot) -> Part:
    """Show a figure."""

    def part(material: Material) -> Block:
        results = material.results
        lacking = results.lacking(plot.needs)
        if lacking:
            return _missing(material, plot.key, plot.title, lacking)
        left_out = results.lacking(plot.wanted)
        note = f" Left out: {results.missing_text(left_out)}." if left_out else ""
        printed = FIGURE_CAPTIONS.get(plot.key)
        return Picture(
            key=plot.key,
            title=plot.title,
            caption=plot.caption + note,
            png=png_bytes(plot.draw(results), plot.key),
            paper="" if printed is None else ": ".join(printed),
        )

    return part


def _missing(material: Material, key: str, title: str, lacking: tuple[str, ...]) -> Missing:
    return Missing(
        key=key,
        title=title,
        reason=material.results.missing_text(lacking),
        command=f"{material.command} {' '.join(studies_of(lacking))}",
    )


RULES_TEXT = (
    "A statement is reproduced if its rule holds within the stated tolerance; reproduced in "
    "sign only if the direction is right and the size is not; not reproduced otherwise; not tested if "
    "a run is missing. Rules are applied by code to stored runs. Where a rule can be applied to the "
    "paper's printed numbers alone, its outcome for them is given, too. The printed numbers and "
    "statements are data, each with its place in the paper."
)


def runs_used(material: Material) -> Block:
    """Return the number of runs behind the page, and their trip."""
    origin = material.provenance
    return Paragraph(
        f"Every number on this page comes from {origin.runs} stored runs "
        f"({origin.cases} cases of the studies; equal runs are stored once). Where no other trip is "
        f"named, it is {origin.trip}."
    )


def other_trip(material: Material) -> Block | None:
    """Warn that the runs drive another trip than the paper's, if so."""
    if material.provenance.whole_cycle:
        return None
    return Paragraph(
        "The runs do not all drive the whole comprehensive cycle. What is printed holds for "
        "that cycle, so that verdicts on numbers mean little here."
    )


def incomplete(material: Material) -> Block | None:
    """Return the missing runs and how to compute them, if any."""
    missing = material.results.missing
    if not missing:
        return None
    names = dict.fromkeys(run.study for run in missing)
    return Paragraph(
        f"This report is incomplete: {len(missing)} cases are missing, of the studies "
        f"{', '.join(names)}. Affected places are marked. To "
        f"compute them: {material.command} {' '.join(names)}"
    )


def verdicts(material: Material) -> Block:
    """Return the number of statements by topic and verdict."""
    every = tuple(entry for entries in material.checked.values() for entry in entries)
    rows = [
        (
            Cell(title, strong=entries is every),
            Cell(str(len(entries))),
            *(Cell(str(count)) for count in tally(entries).values()),
        )
        for title, entries in (*material.checked.items(), ("all statements", every))
    ]
    return Table(
        "verdicts",
        "Statements of the paper by verdict",
        ("statements about", "number", *(verdict.value for verdict in Verdict)),
        tuple(rows),
    )


def origin_table(material: Material) -> Block:
    """Return the origin of the runs as a table."""
    origin = material.provenance
    return Table(
        "origin",
        "Origin of the runs",
        ("", ""),
        (
            cells("trip", origin.trip),
            cells("runs", f"{origin.runs} ({origin.cases} cases)"),
            cells("computed", f"{origin.first_utc} to {origin.last_utc}"),
            cells("wall time of all runs, one after the other", f"{origin.wall_h:.2f} h"),
            cells("runs without compiled problem", str(origin.interpreted)),
            cells("source", _counted(origin.revisions)),
            *(cells(name, _counted(versions)) for name, versions in origin.versions.items()),
        ),
    )


def _counted(values: dict[str, int]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return ", ".join(f"{name} ({count} runs)" for name, count in values.items())
