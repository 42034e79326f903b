"""The page of the comparisons, and its pictures."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from iptm_core.markdown import render_page
from iptm_validation.outcome import Comparison, Outcome

WIDTH_INCH = 7.6
DPI = 90


def write_page(folder: Path, outcomes: list[Outcome]) -> Path:
    """Write ``validation.md`` and the pictures below ``validation/``; returns the path of the page."""
    pictures = folder / "validation"
    pictures.mkdir(parents=True, exist_ok=True)
    for outcome in outcomes:
        for comparison in outcome.comparisons:
            if comparison.curves:
                draw(comparison, pictures / f"{comparison.key}.png")
    tables = [
        pd.DataFrame(
            {
                **vars(figure),
                "bar": f"{figure.bar} {figure.unit}" if figure.bar else "",
                "verdict": ("met" if figure.is_met else "**missed**") if figure.bar else "",
            }
            for figure in outcome.figures
        )
        for outcome in outcomes
    ]
    page = folder / "validation.md"
    pairs = list(zip(outcomes, tables, strict=True))
    text = render_page("iptm_validation", "validation.md.j2", outcomes=pairs)
    page.write_text(text, encoding="utf-8")
    return page


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
    picture.savefig(path, dpi=DPI, metadata={"Software": None})
