"""Results as CSV files, one per study: a row per case, a column per figure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from iptm.studies.campaign import Campaign
from iptm.studies.study import Case
from iptm_controller.strategy import Strategy
from iptm_core.errors import StoreError
from iptm_core.metrics import FIGURES, figure_values


def write_tables(campaign: Campaign, folder: Path) -> tuple[Path, ...]:
    """Write ``<study>.csv`` for every study of a campaign that was compared with a store.

    Figures have the units of their column heads and all digits; what does not exist is left empty.

    Raises:
        StoreError: the folder cannot be written.
    """
    paths = tuple(folder / f"{study.name}.csv" for study in campaign.studies)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for study, path in zip(campaign.studies, paths, strict=True):
            table_of(campaign.cases_of(study)).to_csv(path, index=False)
    except OSError as error:
        raise StoreError(f"tables cannot be written to {folder}: {error}") from error
    return paths


def table_of(cases: Sequence[Case]) -> pd.DataFrame:
    """Return the cases of one study."""
    labels = dict.fromkeys(name for case in cases for name in case.labels)
    rows = []
    for case in cases:
        values = {} if case.metrics is None else figure_values(case.metrics)
        is_known = case.best_of is None
        rows.append(
            {"study": case.study, "case": case.name}
            | {name: case.labels.get(name) for name in labels}
            | {f"{key} [{figure.unit or 1}]": values.get(key) for key, figure in FIGURES.items()}
            | {
                "horizon": case.spec.horizon if is_known else None,
                "kind": case.spec.kind.value,
                "strategy": _weights(case.spec.strategy) if is_known else None,
                "key": case.key if is_known else None,
                "reason": case.reason,
            }
        )
    return pd.DataFrame(rows, dtype=object)


def results(cases: Iterable[Case]) -> pd.DataFrame:
    """Return a row per case: its labels, the name of the ``case``, ``key``, ``metrics`` and ``reason``."""
    rows: list[dict[str, Any]] = [
        {**case.labels, "case": case.name}
        | {name: getattr(case, name) for name in ("key", "metrics", "reason")}
        for case in cases
    ]
    return pd.DataFrame(rows, columns=None if rows else ["metrics"])


def _weights(strategy: Strategy) -> str:
    return (
        f"{strategy.name} Q={strategy.speed_weight:g} R={strategy.temperature_weight:g} "
        f"lambda_P={strategy.energy_weight_1_j:g} lambda_Q={strategy.aging_weight:g}"
    )
