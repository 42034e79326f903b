"""Results of a comparison with measurements: figures with their bars, curves, and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from iptm_core.state import FloatArray


@dataclass(frozen=True)
class Figure:
    """One number of a comparison.

    Attributes:
        quantity: what was compared.
        part: the data that it was computed on.
        value: the number, in ``unit``.
        unit: its unit.
        lowest: smallest permitted value, None without one.
        highest: largest permitted value, None without one.
    """

    quantity: str
    part: str
    value: float
    unit: str
    lowest: float | None = None
    highest: float | None = None

    @property
    def is_met(self) -> bool:
        """True unless the value is outside its bar or not a number."""
        above = self.lowest is None or self.value >= self.lowest
        below = self.highest is None or self.value <= self.highest
        return bool(np.isfinite(self.value)) and above and below

    @property
    def bar(self) -> str:
        """The permitted range in words, empty without one."""
        if self.lowest is not None and self.highest is not None:
            if self.lowest == -self.highest:
                return f"within {self.highest:g}"
            return f"{self.lowest:g} to {self.highest:g}"
        if self.highest is not None:
            return f"at most {self.highest:g}"
        return "" if self.lowest is None else f"at least {self.lowest:g}"


@dataclass(frozen=True, eq=False)
class Curve:
    """Measured and modelled values of one case.

    Attributes:
        name: the case.
        error: its error, by which best, median and worst are chosen.
        x: abscissa, shape (n,).
        measured: measured values, shape (n,).
        modelled: modelled values, shape (n,).
    """

    name: str
    error: float
    x: FloatArray
    measured: FloatArray
    modelled: FloatArray


@dataclass(frozen=True, eq=False)
class Comparison:
    """Curves of one quantity with what their axes are.

    Attributes:
        key: file name of the picture without suffix.
        title: heading of the picture.
        x_label: abscissa with unit.
        y_label: ordinate with unit.
        error_label: what the error of a curve is.
        curves: one per case that was not fitted.
    """

    key: str
    title: str
    x_label: str
    y_label: str
    error_label: str
    curves: tuple[Curve, ...]

    def best_median_worst(self) -> list[tuple[str, Curve]]:
        """Return up to three curves with their rank."""
        ordered = sorted(self.curves, key=lambda curve: abs(curve.error))
        if len(ordered) < 3:
            return [("case", curve) for curve in ordered]
        chosen = (ordered[0], ordered[len(ordered) // 2], ordered[-1])
        return list(zip(("best", "median", "worst"), chosen, strict=True))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The comparison of one model with one data set.

    Attributes:
        title: heading on the page.
        text: what was compared and fitted, in Markdown.
        figures: the numbers.
        comparisons: pictures.
        notes: cases that were left out or reported apart, one line each.
    """

    title: str
    text: str
    figures: tuple[Figure, ...]
    comparisons: tuple[Comparison, ...] = ()
    notes: tuple[str, ...] = field(default=())


def rms(values: Sequence[float] | FloatArray) -> float:
    """Return the root mean square, NaN of nothing."""
    array = np.asarray(values, dtype=np.float64)
    return float(np.sqrt(np.mean(array**2))) if array.size else float("nan")


WIDTH_INCH = 7.6
DPI = 90


def figures_table(outcome: Outcome) -> pd.DataFrame:
    """Return the figures of an outcome with their bars and verdicts in words."""
    return pd.DataFrame(
        {
            **vars(figure),
            "bar": f"{figure.bar} {figure.unit}" if figure.bar else "",
            "verdict": ("met" if figure.is_met else "**missed**") if figure.bar else "",
        }
        for figure in outcome.figures
    )


def draw(comparison: Comparison, path: Path) -> None:
    """Draw the best, the median and the worst case above one another."""
    chosen = comparison.best_median_worst()
    picture = Picture(figsize=(WIDTH_INCH, 2.0 * len(chosen) + 0.6), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots(len(chosen), 1, squeeze=False)[:, 0]
    for axis, (rank, curve) in zip(axes, chosen, strict=True):
        axis.plot(curve.x, curve.measured, color="#555555", linewidth=1.0, label="measured")
        axis.plot(curve.x, curve.modelled, color="#2a9d3a", linewidth=0.8, label="model")
        axis.set_title(
            f"{rank}: {curve.name}, {comparison.error_label}: {curve.error:.2f}", fontsize=9
        )
        axis.set_ylabel(comparison.y_label)
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    axes[-1].set_xlabel(comparison.x_label)
    picture.suptitle(comparison.title, fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.savefig(path, dpi=DPI, metadata={"Software": None})
