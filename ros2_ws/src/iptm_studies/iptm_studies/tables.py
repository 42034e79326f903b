"""Results as CSV files, one per study: a row per case, a column per figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from iptm_controller.strategy import COST_TERMS, Strategy
from iptm_core.errors import StoreError
from iptm_core.metrics import FIGURES, figure_values
from iptm_studies.campaign import Campaign, CaseState

_LAST_COLUMNS = ("horizon", "kind", "strategy", "key", "reason")


def write_tables(campaign: Campaign, folder: Path) -> tuple[Path, ...]:
    """Write ``<study>.csv`` for every study of a campaign that was compared with a store.

    Figures have the units of their column heads and all digits; what does not exist is left empty.

    Returns:
        The files.

    Raises:
        StoreError: the folder cannot be written.
    """
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for study in campaign.studies:
            path = folder / f"{study.name}.csv"
            states = [state for state in campaign.cases if state.study is study]
            path.write_text(table_text(states), encoding="utf-8")
            written.append(path)
    except OSError as error:
        raise StoreError(f"tables cannot be written to {folder}: {error}") from error
    return tuple(written)


def table_text(states: Sequence[CaseState]) -> str:
    """Return the cases of one study as CSV text."""
    labels = list(dict.fromkeys(name for state in states for name in state.case.labels))
    figures = [f"{key} [{figure.unit or 1}]" for key, figure in FIGURES.items()]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["study", "case", *labels, *figures, *_LAST_COLUMNS])
    for state in states:
        values = {} if state.metrics is None else figure_values(state.metrics)
        writer.writerow(
            [
                state.study.name,
                state.case.name,
                *(state.case.labels.get(name) for name in labels),
                *(values.get(key) for key in FIGURES),
                None if state.spec is None else state.spec.horizon,
                state.case.spec.kind.value,
                None if state.spec is None else _weights(state.spec.strategy),
                state.key,
                state.reason,
            ]
        )
    return text.getvalue()


def _weights(strategy: Strategy) -> str:
    weights = strategy.weights.items()
    return " ".join(
        [strategy.name, *(f"{COST_TERMS[key].symbol}={value:g}" for key, value in weights)]
    )
