"""What a figure of a run is: its name, symbol, unit and definition, how it is computed and printed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from iptm_core.declaration import TextEnum
from iptm_core.metrics.run_metrics import RunMetrics

NO_VALUE = "–"


class Better(TextEnum):
    """Which way a figure should go."""

    MORE = "more"
    LESS = "less"
    NEITHER = "-"


@dataclass(frozen=True)
class Figure:
    """One figure of a run.

    Attributes:
        key: identifier, in files and on command lines.
        unit: unit of the value, empty for a pure number.
        decimals: digits after the point that are worth printing; a value below two more prints as 0.
        definition: what it is, in one sentence.
        compute: the value from the metrics of a run; None where it does not exist.
        symbol: symbol of the paper, empty where it has none.
        compared: whether its change relative to a reference run is meaningful.
        better: which way it should go.
    """

    key: str
    label: str
    unit: str
    decimals: int
    definition: str
    compute: Callable[[RunMetrics], float | None]
    symbol: str = ""
    compared: bool = False
    better: Better = Better.NEITHER

    @property
    def title(self) -> str:
        """Label with unit, for column heads and axes."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def about(self) -> str:
        """The definition, and which way the figure should go."""
        return self.definition + (
            "" if self.better is Better.NEITHER else f" {self.better.capitalize()} is better."
        )

    def precise_text(self, value: float | None) -> str:
        """Print a value without its unit, with three significant digits."""
        if value is None or not math.isfinite(value):
            return NO_VALUE
        if self.decimals == 0:
            return f"{value:.0f}"
        return significant(value, 10.0 ** -(self.decimals + 2))


def significant(value: float, least: float = 0.0) -> str:
    """Print a value with three significant digits, all before the point, and 0 where it is below `least`."""
    if not math.isfinite(value):
        return NO_VALUE
    if value == 0.0 or abs(value) < least:
        return "0"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:#.3g}".rstrip(".")
