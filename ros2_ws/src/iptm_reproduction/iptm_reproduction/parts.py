"""What chapters of the report are made of: each part builds its block, or a note on why it cannot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from iptm_reproduction.check import CheckedClaim, ClaimTopic
from iptm_reproduction.document import Block, ClaimList, Missing, Paragraph, Picture, Section, Table
from iptm_reproduction.gathering import Gathered, Provenance
from iptm_reproduction.plots.style import Plot, png_bytes
from iptm_reproduction.printed import FIGURE_CAPTIONS
from iptm_reproduction.runs import Results, studies_of


@dataclass(frozen=True)
class Material:
    """What parts take their content from.

    Attributes:
        gathered: the runs, and where they come from.
        checked: the checked statements by topic.
    """

    gathered: Gathered
    checked: Mapping[str, tuple[CheckedClaim, ...]]

    @property
    def results(self) -> Results:
        """The runs."""
        return self.gathered.results

    @property
    def provenance(self) -> Provenance:
        """Where they come from."""
        return self.gathered.provenance


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
        command=f"{material.gathered.command} {' '.join(studies_of(lacking))}",
    )
