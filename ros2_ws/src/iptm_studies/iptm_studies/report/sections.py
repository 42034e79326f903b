"""Puts tables, figures and checked statements into chapters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from iptm_studies.report.document import Block, ClaimList, Missing, Picture, Section, Table
from iptm_studies.report.evaluation import EvaluatedClaim, by_group, missing_text
from iptm_studies.report.paper import PaperClaims
from iptm_studies.report.plots.registry import PLOTS
from iptm_studies.report.plots.style import png_bytes
from iptm_studies.report.runs import Results


@dataclass
class Chapters:
    """Builds blocks, and puts a note in the place of what cannot be built.

    Attributes:
        results: the runs.
        paper: what the paper prints.
        evaluated: the checked statements.
        command: what computes a study, without its name.
        used: claim groups that have found their place.
    """

    results: Results
    paper: PaperClaims
    evaluated: Sequence[EvaluatedClaim]
    command: str
    used: set[str] = field(default_factory=set)

    def picture(self, key: str) -> Block:
        """A figure, or why there is none."""
        plot = PLOTS[key]
        missing = self.results.missing(plot.needs)
        if missing:
            return self._missing(key, plot.title, missing)
        caption = plot.caption
        left_out = self.results.missing(plot.wanted)
        if left_out:
            caption += f" Left out: {missing_text(left_out, self.results)}."
        printed = next((entry for entry in self.paper.figures if entry.key == key), None)
        return Picture(
            key=key,
            title=plot.title,
            caption=caption,
            png=png_bytes(plot.draw(self.results, self.paper), key),
            paper="" if printed is None else f"{printed.figure}: {printed.caption}",
        )

    def table(
        self, key: str, title: str, needs: Sequence[str], build: Callable[[], Table]
    ) -> Block:
        """A table, or why there is none."""
        missing = self.results.missing(needs)
        return self._missing(key, title, missing) if missing else build()

    def claims(self, group: str) -> Block:
        """The statements under a heading."""
        self.used.add(group)
        return ClaimList(tuple(by_group(self.evaluated).get(group, ())))

    def unplaced(self) -> list[Section]:
        """Statements whose heading no chapter has asked for, so that none is lost."""
        groups = by_group(self.evaluated)
        return [
            Section(f"claims-{index}", group, (self.claims(group),))
            for index, group in enumerate(groups)
            if group not in self.used
        ]

    def _missing(self, key: str, title: str, missing: Sequence[str]) -> Missing:
        studies = dict.fromkeys(address.partition("/")[0] for address in missing)
        return Missing(
            key=key,
            title=title,
            reason=missing_text(missing, self.results),
            command=f"{self.command} {' '.join(studies)}",
        )
