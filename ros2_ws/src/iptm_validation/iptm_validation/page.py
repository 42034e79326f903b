"""The page of the comparisons, and its pictures."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from iptm_core.markdown import markdown_table
from iptm_validation.outcome import Comparison, Figure, Outcome

HEAD = """# Models compared with measurements

Public measurements of cars, cells and drivers compared with the models. Errors count on trips, tests and cars
that were not fitted. Parameters and the choices named below come from the fitted part; the form of the
models was developed with all of these data in view.

Written by `scripts/validate --data FOLDER --page docs`. Sources, licences and where to download the data:
[SOURCES.md](../ros2_ws/src/iptm_validation/iptm_validation/data/SOURCES.md). The fitted parameters are in
`ros2_ws/src/iptm_validation/iptm_validation/parameters`. `scripts/validate --data FOLDER` tries them on
any files of the same data sets, and `--fit FOLDER` fits them to others.

Every third trip, run and car in alphabetical order is held out; of the cell, all cycles but US06 and the
pulses are.
"""
WIDTH_INCH = 7.6
DPI = 90


def figure_table(figures: tuple[Figure, ...]) -> str:
    """Return figures as a Markdown table."""
    rows = [
        (
            figure.quantity,
            figure.part,
            f"{figure.value:.2f} {figure.unit}",
            f"{figure.bar} {figure.unit}" if figure.bar else "",
            ("met" if figure.is_met else "**missed**") if figure.bar else "",
        )
        for figure in figures
    ]
    return markdown_table(("quantity", "part", "value:", "bar:", ""), rows)


def write_page(folder: Path, outcomes: list[Outcome]) -> Path:
    """Write ``validation.md`` and the pictures below ``validation/``; returns the path of the page."""
    pictures = folder / "validation"
    pictures.mkdir(parents=True, exist_ok=True)
    parts = [HEAD]
    for outcome in outcomes:
        parts.append(f"## {outcome.title}\n\n{outcome.text}\n\n{figure_table(outcome.figures)}\n")
        for comparison in outcome.comparisons:
            if comparison.curves:
                draw(comparison, pictures / f"{comparison.key}.png")
                parts.append(f"![{comparison.title}](validation/{comparison.key}.png)\n")
        if outcome.notes:
            parts.append("Reported apart:\n\n" + "\n".join(f"- {note}" for note in outcome.notes))
            parts[-1] += "\n"
    page = folder / "validation.md"
    page.write_text("\n".join(parts), encoding="utf-8")
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
