"""Which conclusions hold under imperfect previews and for other values of what the paper omits."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.metrics.figures import Figure
from iptm_reproduction import figures as fig
from iptm_reproduction.check import graded
from iptm_reproduction.document import Cell, Table
from iptm_reproduction.runs import DEFAULT_CONTROLLER, WEIGHTED, Results, controller_name, words
from iptm_reproduction.tables import change_cells, figure_cells

_MARKS = (fig.SMALLEST_MARGIN, fig.GAP_VIOLATIONS, fig.SOFT_VIOLATIONS, fig.FALLBACKS)


@dataclass(frozen=True)
class Conclusion:
    """A comparison that should hold whatever varies.

    Attributes:
        text: content.
        better: controller with the lower figures.
        worse: controller with the higher ones.
        figures: what is compared; all must be lower.
    """

    text: str
    better: str
    worse: str
    figures: tuple[Figure, ...]

    def holds(self, results: Results, study: str, variation: str) -> bool | None:
        """Return whether it holds for a variation; None where a run is missing."""
        pairs = [
            tuple(
                results.find(f"{study}/{variation}/{controller}", figure)
                for controller in (self.better, self.worse)
            )
            for figure in self.figures
        ]
        known = [(low, high) for low, high in pairs if low is not None and high is not None]
        return all(low < high for low, high in known) if len(known) == len(pairs) else None


_COMMON = (
    *(
        Conclusion(f"Aging (proposed) {text} than Reference", "aging", "reference", figures)
        for text, figures in (
            ("takes less cooling energy", (fig.COOLING,)),
            ("takes less traction energy", (fig.TRACTION,)),
            ("takes less total energy", (fig.TOTAL,)),
            ("degrades both cells less", fig.CELLS),
            ("degrades them more evenly", (fig.INCONSISTENCY,)),
        )
    ),
    Conclusion(
        "Aging, MH 3+5 degrades the cells less than Aging on SH 15",
        "multi_horizon",
        "aging",
        (fig.DEGRADATION,),
    ),
    *(
        Conclusion(
            f"Aging and cost to go, MH 3+5 degrades the cells less than {controller_name(other)}",
            DEFAULT_CONTROLLER,
            other,
            (fig.DEGRADATION,),
        )
        for other in ("reference", "multi_horizon")
    ),
)
CONCLUSIONS = {
    "imperfect_previews": (
        *_COMMON,
        *(
            Conclusion(
                f"Aging (proposed) degrades the cells less than {controller_name(other)}",
                "aging",
                other,
                (fig.DEGRADATION,),
            )
            for other in WEIGHTED
        ),
    ),
    "omitted_parameters": _COMMON,
}
"""What is checked in each of both studies."""


def _variations(results: Results, study: str) -> list[str]:
    """Return what varies in a study of two labels, in its order."""
    return list(dict.fromkeys(run.address.split("/")[1] for run in results.study(study)))


def _outcomes(results: Results, study: str) -> dict[Conclusion, dict[str, bool | None]]:
    """Return whether each conclusion holds for each variation, except those that no run can decide."""
    names = _variations(results, study)
    table = {
        conclusion: {name: conclusion.holds(results, study, name) for name in names}
        for conclusion in CONCLUSIONS[study]
    }
    return {
        conclusion: marks
        for conclusion, marks in table.items()
        if any(mark is not None for mark in marks.values())
    }


def conclusion_table(results: Results, study: str, title: str) -> Table:
    """Return conclusions as rows, variations as columns."""
    rows = []
    for conclusion, marks in _outcomes(results, study).items():
        known = [mark for mark in marks.values() if mark is not None]
        rows.append(
            (
                Cell(conclusion.text),
                *map(_mark_cell, marks.values()),
                Cell(f"{sum(known)} of {len(known)}"),
            )
        )
    return Table(
        f"conclusions-{study.replace('_', '-')}",
        title,
        ("conclusion", *map(words, _variations(results, study)), "holds in"),
        tuple(rows),
    )


def _mark_cell(holds: bool | None) -> Cell:  # noqa: FBT001
    return Cell(fig.DASH) if holds is None else Cell("yes" if holds else "no", graded(holds))


def summary_text(results: Results, study: str) -> str:
    """Return which conclusions hold throughout and which do not, in words."""
    throughout, others = [], []
    for conclusion, marks in _outcomes(results, study).items():
        failing = [words(name) for name, mark in marks.items() if mark is False]
        if failing:
            others.append(f"{conclusion.text} (not with: {', '.join(failing)})")
        else:
            throughout.append(conclusion.text)
    sentences = []
    if throughout:
        sentences.append(f"Hold in every case that was run: {'; '.join(throughout)}.")
    if others:
        sentences.append(f"Depend on the case: {'; '.join(others)}.")
    return " ".join(sentences) or "Nothing to conclude from yet."


def variation_table(results: Results, study: str, title: str, base: str | None = None) -> Table:
    """Return every run of a study, its changes against the reference.

    Args:
        results: the runs.
        study: a study of two labels, the second one being the controller.
        title: heading.
        base: address of one reference for all; None for the reference of the same variation.
    """
    shown = (*fig.TABLE_FIGURES, fig.DEGRADATION)
    rows = []
    for run in results.study(study):
        _, variation, controller = run.address.split("/")
        reference = base or f"{study}/{variation}/reference"
        rows.append(
            (
                Cell(words(variation)),
                Cell(controller_name(controller), strong=run.address == reference),
                *change_cells(results, run.address, reference, shown),
                *figure_cells(results, run.address, _MARKS),
            )
        )
    return Table(
        study.replace("_", "-"),
        title,
        ("case", "controller", *(figure.title for figure in (*shown, *_MARKS))),
        tuple(rows),
        note="The reference has figures, the others their change against it.",
    )
