"""Pictures of the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure


def plot_comparison(comparisons: dict[str, Any], path: Path) -> None:
    """Plot median to p99 of every contender, one panel per grid, logarithmic in time."""
    figure, panels = plt.subplots(
        1, len(comparisons), figsize=(3.1 * len(comparisons), 3.6), sharey=True, squeeze=False
    )
    for axis, (title, rows) in zip(panels[0], comparisons.items(), strict=True):
        for index, row in enumerate(rows):
            color = "tab:red" if row["name"].startswith("peer") else "tab:blue"
            axis.plot([index, index], [row["median_ms"], row["p99_ms"]], color=color, lw=2)
            axis.plot(index, row["median_ms"], "o", color=color)
            axis.plot(index, row["p99_ms"], "_", color=color, ms=10)
        axis.set_xticks(range(len(rows)), [row["name"] for row in rows], rotation=90, fontsize=7)
        cycle, _, horizon = title.split(", ")
        axis.set_title(f"{cycle}\n{horizon}", fontsize=8)
        axis.set_yscale("log")
        axis.grid(axis="y", which="both", alpha=0.3)
    panels[0][0].set_ylabel("solve, median to p99 (ms)")
    _save(figure, path)


def plot_scaling(scaling: dict[str, Any], path: Path) -> None:
    """Plot time per iteration and in total over the number of nodes, with the straight lines."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6))
    for index, (name, fit) in enumerate(scaling["fits"].items()):
        rows = [row for row in scaling["rows"] if row["solver"] == name]
        nodes = np.array([row["nodes"] for row in rows], dtype=float)
        color = f"C{index}"
        left.plot(nodes, [row["ms_per_iteration"] for row in rows], "o", color=color, label=name)
        line = fit["offset_ms"] + 1e-3 * fit["per_node_us"] * nodes
        left.plot(nodes, line, "-", color=color, lw=1)
        right.plot(nodes, [row["median_ms"] for row in rows], "o-", color=color, label=name)
    left.set_ylabel("per iteration (ms)")
    right.set_ylabel("per solve, median (ms)")
    for axis in (left, right):
        axis.set_xlabel("nodes")
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)
