"""Which conclusions hold under imperfect previews and for other values of what the paper omits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from iptm_studies.report.document import Cell, Table
from iptm_studies.report.measures import MEASURES, TABLE_MEASURES
from iptm_studies.report.naming import controller_name, words
from iptm_studies.report.runs import Results
from iptm_studies.report.tables.cells import AGING_KEY, DASH, change_cell, figure_cell
from iptm_studies.report.verdict import Verdict

PREVIEWS = "imperfect_previews"
OMITTED = "omitted_parameters"
PERFECT = "perfect"

_MARKS = ("smallest_margin", "gap_violations", "soft_violations", "fallbacks")


@dataclass(frozen=True)
class Conclusion:
    """A comparison that should hold whatever varies.

    Attributes:
        text: what it says.
        better: controller with the lower figures.
        worse: controller with the higher ones.
        measures: the figures; all must be lower.
        slack: relative excess that still counts as equal.
    """

    text: str
    better: str
    worse: str
    measures: tuple[str, ...]
    slack: float = 0.0

    def holds(self, lookup: Callable[[str, str], float | None]) -> bool | None:
        """Whether it holds; None where a run is missing."""
        verdicts = []
        for key in self.measures:
            low, high = lookup(self.better, key), lookup(self.worse, key)
            if low is None or high is None:
                return None
            verdicts.append(low < high * (1.0 + self.slack))
        return all(verdicts)


_SAVES = tuple(
    Conclusion(f"{controller_name('aging')} {text} than Reference", "aging", "reference", keys)
    for text, keys in (
        ("takes less cooling energy", ("cooling_energy",)),
        ("takes less traction energy", ("traction_energy",)),
        ("takes less total energy", ("total_energy_printed",)),
        ("degrades both cells less", ("cell_1_degradation", "cell_n_degradation")),
        ("degrades them more evenly", ("inconsistency",)),
    )
)
_MULTI_HORIZON = Conclusion(
    "Aging, MH 3+5 degrades the cells less than Aging on SH 15",
    "multi_horizon",
    "aging",
    (AGING_KEY,),
)
_BEST = tuple(
    Conclusion(
        f"{controller_name('aging')} degrades the cells less than {controller_name(other)}",
        "aging",
        other,
        (AGING_KEY,),
    )
    for other in ("reference_energy", "reference_aging", "reference_energy_aging", "energy_aging")
)
CONCLUSIONS = {PREVIEWS: (*_SAVES, _MULTI_HORIZON, *_BEST), OMITTED: (*_SAVES, _MULTI_HORIZON)}
"""What is checked in each of both studies."""


def variations(results: Results, study: str) -> list[str]:
    """What varies in a study of two labels, in its order."""
    return list(dict.fromkeys(run.address.split("/")[1] for run in results.study(study)))


def conclusion_table(results: Results, study: str, title: str) -> Table:
    """Conclusions as rows, variations as columns."""
    names = variations(results, study)
    rows = []
    for conclusion in CONCLUSIONS[study]:
        marks = [_holds(results, study, name, conclusion) for name in names]
        if all(mark is None for mark in marks):
            continue
        known = [mark for mark in marks if mark is not None]
        rows.append(
            (
                Cell(conclusion.text),
                *(_mark_cell(mark) for mark in marks),
                Cell(f"{sum(known)} of {len(known)}"),
            )
        )
    return Table(
        f"conclusions-{study.replace('_', '-')}",
        title,
        ("conclusion", *(words(name) for name in names), "holds in"),
        tuple(rows),
    )


def summary_text(results: Results, study: str) -> str:
    """Which conclusions hold throughout and which do not, in words."""
    names = variations(results, study)
    throughout, others = [], []
    for conclusion in CONCLUSIONS[study]:
        marks = {name: _holds(results, study, name, conclusion) for name in names}
        known = {name: mark for name, mark in marks.items() if mark is not None}
        if known and all(known.values()):
            throughout.append(conclusion.text)
        elif known:
            failing = ", ".join(words(name) for name, mark in known.items() if not mark)
            others.append(f"{conclusion.text} (not with: {failing})")
    text = ""
    if throughout:
        text += f"Hold in every case that was run: {'; '.join(throughout)}. "
    if others:
        text += f"Depend on the case: {'; '.join(others)}."
    return text.strip()


def _holds(results: Results, study: str, variation: str, conclusion: Conclusion) -> bool | None:
    def lookup(controller: str, key: str) -> float | None:
        return results.measure(f"{study}/{variation}/{controller}", key)

    return conclusion.holds(lookup)


def _mark_cell(holds: bool | None) -> Cell:  # noqa: FBT001
    if holds is None:
        return Cell(DASH)
    verdict = Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED
    return Cell("yes" if holds else "no", verdict)


def variation_table(
    results: Results, study: str, title: str, base: str | None = None, note: str = ""
) -> Table:
    """Every run of a study, its changes against the reference.

    Args:
        results: the runs.
        study: a study of two labels, the second one being the controller.
        title: heading.
        base: address of one reference for all; None for the reference of the same variation.
        note: remark.
    """
    keys: Sequence[str] = (*TABLE_MEASURES, AGING_KEY)
    rows = []
    for run in results.study(study):
        _, variation, controller = run.address.split("/")
        reference = base or f"{study}/{variation}/reference"
        own = run.address == reference
        rows.append(
            (
                Cell(words(variation)),
                Cell(controller_name(controller), strong=own),
                *(
                    figure_cell(results, run.address, key)
                    if own
                    else change_cell(results, run.address, reference, key)
                    for key in keys
                ),
                *(figure_cell(results, run.address, key) for key in _MARKS),
            )
        )
    return Table(
        study.replace("_", "-"),
        title,
        (
            "case",
            "controller",
            *(MEASURES[key].title for key in keys),
            *(MEASURES[key].title for key in _MARKS),
        ),
        tuple(rows),
        note=f"The reference has figures, the others their change against it. {note}".strip(),
    )
