"""Results as CSV files, one per study: a row per case, a column per figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from iptm_core.errors import StoreError
from iptm_core.metrics import FIGURES, figure_values
from iptm_studies.campaign import Campaign, CaseState

_FIRST_COLUMNS = ("study", "case")
_LAST_COLUMNS = ("horizon", "kind", "strategy", "key", "reason")


def write_tables(campaign: Campaign, folder: Path) -> tuple[Path, ...]:
    """Write ``<study>.csv`` for every study of a campaign that was compared with a store.

    Figures have the units of their column heads and all digits; what does not exist is left empty.

    Returns:
        The files.

    Raises:
        StoreError: the folder cannot be written.
    """
    by_study: dict[str, list[CaseState]] = {study.name: [] for study in campaign.studies}
    for state in campaign.cases():
        by_study[state.study.name].append(state)
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, states in by_study.items():
            path = folder / f"{name}.csv"
            path.write_text(table_text(states), encoding="utf-8")
            written.append(path)
    except OSError as error:
        raise StoreError(f"tables cannot be written to {folder}: {error}") from error
    return tuple(written)


def table_text(states: Iterable[CaseState]) -> str:
    """The cases of one study as CSV text."""
    rows = list(states)
    labels = list(dict.fromkeys(name for state in rows for name in state.case.labels))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [
            *_FIRST_COLUMNS,
            *labels,
            *(f"{key} [{figure.unit or 1}]" for key, figure in FIGURES.items()),
            *_LAST_COLUMNS,
        ]
    )
    for state in rows:
        values = {} if state.metrics is None else figure_values(state.metrics)
        spec = state.spec
        writer.writerow(
            [
                state.study.name,
                state.case.name,
                *(state.case.labels.get(name, "") for name in labels),
                *(_cell(values.get(key)) for key in FIGURES),
                "" if spec is None else spec.horizon,
                state.case.spec.kind.value,
                "" if spec is None else _weights(state),
                state.key or "",
                state.reason,
            ]
        )
    return text.getvalue()


def _cell(value: float | None) -> str:
    return "" if value is None else repr(value)


def _weights(state: CaseState) -> str:
    if state.spec is None:
        return ""
    strategy = state.spec.strategy
    return (
        f"{strategy.name} Q={strategy.speed_weight:g} R={strategy.temperature_weight:g} "
        f"lambda_P={strategy.energy_weight_1_j:g} lambda_Q={strategy.aging_weight:g}"
    )
