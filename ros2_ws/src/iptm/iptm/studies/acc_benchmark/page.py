"""The page about measured lead vehicles, and its picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from iptm.studies.acc_benchmark.comparison import spread
from iptm.studies.acc_benchmark.drives import CARS
from iptm.studies.acc_benchmark.scenes import LONGEST_S, RUN_IN_S
from iptm_core.markdown import render_page
from iptm_core.parameters import load_parameters

PAGE = "acc-benchmark.md"
PICTURE = "images/acc-benchmark.png"
REAL = "real follower"
WIDTH_INCH, DPI = 9.0, 90
_PANELS = {
    "headway_s": "time headway, s",
    "jerk_m_s3": "jerk (rms), m/s³",
    "energy_saving": "energy saved, %",
    "aging_saving": "ageing saved, %",
}
_SAVINGS = ["energy_saving", "aging_saving"]
_DIGITS = {
    "gap_m": 1,
    "headway_s": 2,
    "below_percent": 0,
    "above_percent": 0,
    "jerk_m_s3": 2,
    "consumption_kwh_100_km": 1,
    "energy_saving": 1,
    "aging_saving": 1,
    "end_gap_m": 1,
    "end_kinetic_kj": 0,
}
"""Decimals of the figures of which median and quartiles are shown."""


def benchmark_page(
    command: str, cars: Sequence[str], rows: pd.DataFrame, failures: Mapping[str, str]
) -> str:
    """Return the page as Markdown.

    Args:
        command: what makes it.
        cars: parameter sets, in the order of the page.
        rows: figures by ``car`` (parameter set) and ``variant`` of driving, one row per lead vehicle.
        failures: failed runs, address and cause.
    """
    real = rows[rows.variant == REAL]
    return render_page(
        "iptm.studies.acc_benchmark",
        "acc_benchmark.md.j2",
        command=command,
        picture=PICTURE,
        counts=sorted(set(real.groupby("car").size())),
        collisions=int(rows.collided.sum()),
        longest_s=LONGEST_S,
        run_in_s=RUN_IN_S,
        cars=[
            (car, CARS[car], load_parameters(car).description, _by_variant(rows[rows.car == car]))
            for car in cars
        ],
        failures=[{"run": run, "cause": cause} for run, cause in failures.items()],
    )


def _by_variant(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row of texts and numbers per variant of driving."""
    variants = rows.groupby("variant", sort=False)
    found = pd.DataFrame(
        {name: variants[name].agg(spread, digits) for name, digits in _DIGITS.items()}
    )
    found.loc[REAL, _SAVINGS] = "0"
    found["collisions"] = variants.collided.sum()
    found["smallest_gap_m"] = variants.smallest_gap_m.min()
    found["emergencies"] = variants.emergency_s.agg(lambda seconds: (seconds > 0.0).sum())
    return found.reset_index()


def draw_picture(folder: Path, cars: Sequence[str], rows: pd.DataFrame) -> None:
    """Draw the spread over the lead vehicles as boxes from quartile to quartile, below a folder."""
    figure = Figure(figsize=(WIDTH_INCH, 3.2 * len(cars)), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(cars), len(_PANELS), squeeze=False, sharey="row")
    for line, car in zip(axes, cars, strict=True):
        variants = rows[rows.car == car].groupby("variant", sort=False)
        for axis, (name, label) in zip(line, _PANELS.items(), strict=True):
            is_saving = name in _SAVINGS
            values = [
                [] if is_saving and variant == REAL else part[name].dropna().tolist()
                for variant, part in variants
            ]
            if is_saving:
                axis.axvline(0.0, color="0.6", linewidth=0.8)
            axis.boxplot(values, orientation="horizontal", showfliers=False, widths=0.6)
            axis.set_xlabel(label)
            axis.grid(axis="x", alpha=0.3)
        line[0].set_yticks(np.arange(1, variants.ngroups + 1), list(variants.groups))
        line[0].invert_yaxis()
        line[0].set_title(f"{car}, {CARS[car]:g} °C", loc="left", fontsize="medium")
    path = folder / PICTURE
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": None})
