"""Tables of the sensitivity studies, and of what went wrong in any run."""

from __future__ import annotations

from collections.abc import Sequence

from iptm_core.metrics.figures import Figure
from iptm_reproduction import figures as fig
from iptm_reproduction.document import Cell, Table, cells
from iptm_reproduction.runs import REFERENCE, STUDIES, ReportRun, Results, name_of
from iptm_reproduction.tables import change_cells, figure_cell, figure_cells, share_cell

_RELIABILITY = (
    fig.GAP_VIOLATIONS,
    fig.HARD_VIOLATIONS,
    fig.SOFT_VIOLATIONS,
    fig.FALLBACKS,
    fig.FAILED_SOLVES,
    fig.SOLVES_FEASIBLE,
    fig.LIMITER_TICKS,
)
_MARKS = (fig.GAP_VIOLATIONS, fig.FALLBACKS)
_SAVING = "part of the possible saving"


def run_table(results: Results, study: str, base: str, paper: str) -> Table:
    """Return the runs of a study as rows: changes against a base run, shares, and what went wrong.

    Args:
        results: the runs.
        study: the study.
        base: run that the changes refer to; it comes first with its figures.
        paper: where its figure stands in the paper.
    """
    shown = (*fig.TABLE_FIGURES, fig.COMPUTING_TIME)
    others = [run.address for run in results.study(study) if run.address != base]
    rows = [
        (
            Cell(name_of(run), strong=run == base),
            *change_cells(results, run, base, shown),
            share_cell(results, run),
            *figure_cells(results, run, _MARKS),
        )
        for run in (base, *others)
    ]
    return Table(
        f"{study.replace('_', '-')}-table",
        STUDIES[study],
        ("run", *(figure.title for figure in shown), _SAVING, *(figure.label for figure in _MARKS)),
        tuple(rows),
        note="The first row has figures, the others their change against it.",
        paper=paper,
    )


def weight_table(results: Results) -> Table:
    """Return the weights of each strategy and what they lead to; the chosen ones are set off."""
    rows = []
    for run in results.study("weighting"):
        strategy = f"strategies/{run.address.split('/')[1]}"
        chosen = results.get(strategy)
        best = chosen is not None and _weights(chosen) == _weights(run)
        rows.append(
            (
                Cell(name_of(strategy), strong=best),
                *(
                    Cell(f"{weight:g}" if weight > 0.0 else fig.DASH, strong=best)
                    for weight in _weights(run)
                ),
                *change_cells(results, run.address, REFERENCE, fig.TABLE_FIGURES),
                share_cell(results, run.address),
                figure_cell(results, run.address, fig.CELL_N_MAX),
                *figure_cells(results, run.address, _MARKS),
            )
        )
    return Table(
        "weights",
        "Weights of the weighted strategies",
        (
            "strategy",
            "λ_P [1/J]",
            "λ_Q",
            *(figure.label for figure in fig.TABLE_FIGURES),
            _SAVING,
            "highest temperature [°C]",
            *(figure.label for figure in _MARKS),
        ),
        tuple(rows),
        note=(
            "Changes against the reference. The weights set off are those of the strategy table: the "
            "least degradation of both cells together among the runs that break no hard limit."
        ),
        paper="Fig. 9",
    )


def _weights(run: ReportRun) -> tuple[float, float]:
    return run.strategy.energy_weight_1_j, run.strategy.aging_weight


def reliability_table(results: Results) -> Table:
    """Return what went wrong in any run, by study: sums and the worst run."""
    rows = []
    for study, title in STUDIES.items():
        runs = results.study(study)
        missing = sum(run.study == study for run in results.missing)
        if not runs and not missing:
            continue
        longest = max(_values(runs, fig.LONGEST_SOLVE).values(), default=None)
        rows.append(
            cells(
                title,
                str(len(runs)),
                str(missing),
                *(_sum_and_worst(runs, figure) for figure in _RELIABILITY),
                fig.LONGEST_SOLVE.text(longest),
            )
        )
    return Table(
        "reliability",
        "Limits kept and solver outcomes, by study",
        (
            "study",
            "runs",
            "missing",
            *(figure.label for figure in _RELIABILITY),
            "longest solve [ms]",
        ),
        tuple(rows),
        note="Sums over the runs of a study; in brackets the run with the most.",
    )


def _values(runs: Sequence[ReportRun], figure: Figure) -> dict[str, float]:
    return {run.address: run.values[figure.key] for run in runs if figure.key in run.values}


def _sum_and_worst(runs: Sequence[ReportRun], figure: Figure) -> str:
    known = _values(runs, figure)
    if not known:
        return fig.DASH
    total = sum(known.values())
    if total == 0.0:
        return "0"
    worst = max(known, key=known.__getitem__)
    return f"{total:.0f} ({name_of(worst)}: {known[worst]:.0f})"
