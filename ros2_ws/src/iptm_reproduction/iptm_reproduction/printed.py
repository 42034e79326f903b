"""The numbers that the paper prints (``printed.yaml``), by run and figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from iptm_reproduction.names import MULTI_HORIZON, STRATEGIES

_PRINTED: dict[str, Any] = yaml.safe_load(
    Path(__file__).with_name("printed.yaml").read_text(encoding="utf-8")
)

PAPER: str = _PRINTED["paper"]
PARAMETER_TABLES: dict[str, dict[str, tuple[float, str]]] = _PRINTED["parameter_tables"]
"""Tables I and II: printed value and unit by key of this project's parameter."""
FORMULATIONS: dict[str, tuple[str, list[int]]] = _PRINTED["formulations"]
"""Table III: name of each strategy and the numbers of its cost terms."""
VALUES = pd.DataFrame(_PRINTED["values"], index=STRATEGIES)
"""A row per run, a column per figure; NaN where none is printed."""
CHANGES = pd.DataFrame(_PRINTED["changes"], index=(*STRATEGIES[1:], MULTI_HORIZON))
"""Changes against the reference: a row per run, a column per figure; NaN where none is printed."""
RANGES: dict[str, dict[str, tuple[float, float]]] = _PRINTED["ranges"]
"""Smallest and largest change by study and figure."""
LARGEST_VICE_RATIO_J: float = _PRINTED["largest_vice_ratio_j"]


def printed_value(run: str, figure: str) -> float | None:
    """Return a figure of a run as the paper prints it, None where it prints none."""
    if run not in VALUES.index or figure not in VALUES.columns or pd.isna(VALUES.at[run, figure]):
        return None
    return float(VALUES.at[run, figure])


def printed_change(run: str, figure: str) -> float:
    """Return the printed change of a figure against the reference; NaN where none is printed."""
    return float(CHANGES.at[run, figure])
