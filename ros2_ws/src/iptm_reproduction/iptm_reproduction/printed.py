"""The numbers that the paper prints (``printed.yaml``), and verdicts on ours against them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
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


CHANGE_SHARE, CHANGE_FLOOR = 0.25, 0.01
"""A relative change counts as the printed one if it has the same sign and lies within the larger of both: a
quarter of the printed change, one percentage point."""


class Verdict(Enum):
    """Outcome of checking one statement of the paper, best first."""

    REPRODUCED = "reproduced"
    SIGN_ONLY = "reproduced in sign only"
    NOT_REPRODUCED = "not reproduced"
    NOT_TESTED = "not tested"

    @property
    def symbol(self) -> str:
        """The mark of this verdict in a table."""
        return _SYMBOLS[self]

    @property
    def differs(self) -> bool:
        """Whether the statement was tested and is not simply reproduced."""
        return self in {Verdict.SIGN_ONLY, Verdict.NOT_REPRODUCED}


_SYMBOLS = dict(zip(Verdict, "✓≈✗–", strict=True))


@dataclass(frozen=True)
class Finding:
    """A verdict and the numbers behind it.

    Attributes:
        verdict: the outcome.
        found: what this project finds, in words and numbers.
        in_print: outcome of the same rule on the numbers printed in the paper, where they suffice
            to apply it; else empty.
        cause: why it is not simply reproduced; empty where it is.
    """

    verdict: Verdict
    found: str
    in_print: str = ""
    cause: str = ""


def graded(holds: bool, in_sign: bool = False) -> Verdict:  # noqa: FBT001, FBT002
    """Return the verdict on a statement that holds, holds in sign only, or does not hold."""
    if holds:
        return Verdict.REPRODUCED
    return Verdict.SIGN_ONLY if in_sign else Verdict.NOT_REPRODUCED


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict on a statement with several numbers: that of the least reproduced one."""
    return max(verdicts, key=list(Verdict).index)


def accepted_deviation(
    printed: float, share: float = CHANGE_SHARE, floor: float = CHANGE_FLOOR
) -> float:
    """Return by how much a number may deviate from the printed one: a share of it, at least the floor."""
    return max(floor, share * abs(printed))


def compared(
    found: float, printed: float, share: float = CHANGE_SHARE, floor: float = CHANGE_FLOOR
) -> Verdict:
    """Return whether a number has the sign of the printed one and lies within the accepted deviation."""
    same_sign = found * printed > 0.0
    close = abs(found - printed) <= accepted_deviation(printed, share, floor)
    return graded(same_sign and close, same_sign)
