"""Pictures of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from studies.paper import figures as kept
from studies.paper import statements, tables, trips

Runs = Mapping[str, Mapping[str, Any]]
DPI, HOUR_S = 110, 3600.0
FOUR = ("cooling_energy", "traction_energy", "cell_1_degradation", "cell_n_degradation")


def draw_all(folder: Path, runs: Runs, figures: Mapping[str, pd.DataFrame]) -> None:
    """Draw every picture of which the runs are there into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    mpl.use("Agg")
    for name, draw in PICTURES.items():
        figure = draw(runs, figures)
        figure.savefig(folder / f"{name}.png", dpi=DPI)
        plt.close(figure)


def _panels(rows: int, columns: int, height: float = 3.0) -> tuple[Figure, Any]:
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.6 * columns, height * rows), layout="constrained", squeeze=False
    )
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    return figure, axes


def strategy_changes(_: Runs, figures: Mapping[str, pd.DataFrame]) -> Figure:
    """Table IV: changes against the reference, printed and found by each set."""
    figure, axes = _panels(2, 3)
    printed = statements.printed_table()
    names = [name for name in trips.NAMES if name != "reference"]
    columns = {"printed": printed, **figures}
    for axis, key in zip(axes.flat, tables.PAPER_ROWS, strict=True):
        for place, (label, table) in enumerate(columns.items()):
            heights = [tables.change(table, f"strategies/{name}", key) for name in names]
            width = 0.8 / len(columns)
            axis.bar(np.arange(len(names)) + (place - 1) * width, heights, width, label=label)
        axis.set_title(tables.LABELS[key][0].partition(" [")[0], fontsize=9)
        axis.set_xticks(
            np.arange(len(names)), [trips.NAMES[name] for name in names], fontsize=6, rotation=20
        )
        axis.set_ylabel("change [%]")
    axes[0, 0].legend(fontsize=7)
    return figure


def headline(_: Runs, figures: Mapping[str, pd.DataFrame]) -> Figure:
    """MH 3+5 against the reference, printed and found by each set."""
    figure, axes = _panels(1, 1, 3.4)
    claims = statements.claims()
    part = claims[tables.of_headline(claims)]
    axis, keys = axes[0, 0], list(part.figure)
    columns = {"printed": part.printed.astype(float).tolist()}
    columns |= {
        n: [tables.change(t, tables.MULTI_HORIZON, key) for key in keys] for n, t in figures.items()
    }
    for place, (label, heights) in enumerate(columns.items()):
        axis.bar(np.arange(len(keys)) + 0.27 * (place - 1), heights, 0.27, label=label)
    axis.set_xticks(
        np.arange(len(keys)),
        [tables.LABELS[k][0].partition(" [")[0] for k in keys],
        fontsize=6,
        rotation=20,
    )
    axis.set_ylabel("change [%]")
    axis.legend(fontsize=7)
    return figure


def temperatures(runs: Runs, _: Mapping[str, pd.DataFrame]) -> Figure:
    """Fig. 7: temperatures and losses of both cells by strategy, a column per set."""
    figure, axes = _panels(2, len(runs), 3.2)
    for column, (name, driven) in enumerate(runs.items()):
        for strategy, label in trips.NAMES.items():
            frame = driven[f"strategies/{strategy}"]["frame"]
            hours = frame.index / HOUR_S
            line = axes[0, column].plot(hours, kept.mean_cell_c(frame), lw=0.9, label=label)[0]
            loss = frame.cell_1_capacity_loss + frame.cell_n_capacity_loss
            axes[1, column].plot(hours, 1e5 * (loss - loss.iloc[0]), lw=0.9, color=line.get_color())
        axes[0, column].set_title(f"{name}: mean temperature of cells 1 and N", fontsize=9)
        axes[1, column].set_title("loss of both cells", fontsize=9)
        axes[0, column].set_ylabel("[°C]")
        axes[1, column].set_ylabel("[10⁻⁵]")
        axes[1, column].set_xlabel("time [h]")
    axes[0, 0].legend(fontsize=6)
    return figure


def trip(runs: Runs, _: Mapping[str, pd.DataFrame]) -> Figure:
    """Figs. 5 and 8: leader, powers and gap of the proposed strategy, a column per set."""
    figure, axes = _panels(3, len(runs), 2.4)
    for column, (name, driven) in enumerate(runs.items()):
        frame = driven[tables.PROPOSED]["frame"]
        hours = frame.index / HOUR_S
        axes[0, column].plot(hours, 3.6 * frame.leader_speed_m_s, lw=0.5)
        axes[1, column].plot(hours, 1e-3 * frame.traction_power_w, lw=0.4, label="traction")
        axes[1, column].plot(
            hours, 1e-2 * frame.compressor_power_w, lw=0.4, label="compressor × 10"
        )
        axes[2, column].plot(hours, frame.gap_m, lw=0.5)
        for axis, label in zip(
            axes[:, column], ("leader [km/h]", "power [kW]", "gap [m]"), strict=True
        ):
            axis.set_ylabel(label)
        axes[0, column].set_title(name, fontsize=9)
        axes[2, column].set_xlabel("time [h]")
    axes[1, 0].legend(fontsize=6)
    return figure


def power(runs: Runs, _: Mapping[str, pd.DataFrame]) -> Figure:
    """Fig. 6: share of time by battery power for the proposed strategy and both benchmarks."""
    figure, axes = _panels(1, len(runs))
    bins = np.arange(-30.0, 100.0, 4.0)
    for axis, (name, driven) in zip(axes.flat, runs.items(), strict=True):
        for run in (tables.REFERENCE, tables.VICE, tables.PROPOSED):
            values = 1e-3 * driven[run]["frame"].battery_power_w.iloc[1:]
            axis.hist(values, bins, histtype="step", density=True, label=tables.name_of(run))
        axis.set_title(name, fontsize=9)
        axis.set_xlabel("battery power [kW]")
        axis.set_yscale("log")
    axes[0, 0].legend(fontsize=6)
    return figure


def _lines(
    axis: Axes, table: pd.DataFrame, key: str, groups: Mapping[str, list[str]], x: list[float]
) -> None:
    for name, addresses in groups.items():
        axis.plot(
            x, table.reindex(addresses)[key].to_numpy(dtype=float), "o-", ms=3, lw=0.9, label=name
        )
    axis.set_ylabel(tables.LABELS[key][0], fontsize=7)


def _series(
    groups: Mapping[str, list[str]], x: list[float], label: str
) -> Callable[[Runs, Mapping[str, pd.DataFrame]], Figure]:
    def draw(_: Runs, figures: Mapping[str, pd.DataFrame]) -> Figure:
        figure, axes = _panels(len(figures), len(FOUR), 2.8)
        for row, (name, table) in zip(axes, figures.items(), strict=True):
            for axis, key in zip(row, FOUR, strict=True):
                _lines(axis, table, key, groups, x)
                axis.set_xlabel(label, fontsize=7)
            row[0].set_title(name, fontsize=9)
        if len(groups) > 1:
            axes[0, 0].legend(fontsize=6)
        return figure

    return draw


def weighting(_: Runs, figures: Mapping[str, pd.DataFrame]) -> Figure:
    """Fig. 9: the four weights of each strategy relative to the reference."""
    figure, axes = _panels(len(figures), len(FOUR), 2.8)
    for row, (name, table) in zip(axes, figures.items(), strict=True):
        for axis, key in zip(row, FOUR, strict=True):
            for strategy in trips.WEIGHTED:
                runs = [f"weighting/{strategy}/{number}" for number in range(1, 5)]
                changes = statements.changes(table, runs, tables.REFERENCE, key)
                axis.plot(range(1, 5), changes, "o-", ms=3, lw=0.9, label=trips.NAMES[strategy])
            axis.set_title(f"{name}: {tables.LABELS[key][0].partition(' [')[0]}", fontsize=7)
            axis.set_xlabel("weight, small to large", fontsize=7)
            axis.set_ylabel("change [%]", fontsize=7)
    axes[0, 0].legend(fontsize=6)
    return figure


PICTURES: dict[str, Callable[[Runs, Mapping[str, pd.DataFrame]], Figure]] = {
    "headline": headline,
    "strategy_changes": strategy_changes,
    "temperatures": temperatures,
    "power": power,
    "trip": trip,
    "weighting": weighting,
    "prediction_horizon": _series(
        {"": [f"prediction_horizon/{s}" for s in (5, 10, 15, 20)]}, [5, 10, 15, 20], "horizon [s]"
    ),
    "sampling_time": _series(
        {n: [f"sampling_time/{n}/{s}" for s in trips.STEPS_S] for n in trips.SPLITS},
        list(trips.STEPS_S),
        "long step [s]",
    ),
    "long_horizon": _series(
        {f"N_p1 = {s}": [f"long_horizon/{s}+{n}" for n in trips.LONG_STEPS] for s in (3, 5)},
        list(trips.LONG_STEPS),
        "N_p2",
    ),
}
