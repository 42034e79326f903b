"""Report of a string of vehicles: disturbances along it, and the saving of each vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import colormaps, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from iptm.panels import GREY
from iptm.picture import STYLE
from iptm.report import relative_changes
from iptm.run import Run
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.units import KM_H_PER_M_S
from iptm_string.headless import amplification, deviations_along

_SIZE_INCHES = (12.0, 8.0)
_DOTS_PER_INCH = 100


@dataclass(frozen=True, eq=False)
class StringPart:
    """A table of the report: heading, text above it, format of the cells by heading, rows."""

    heading: str
    about: str
    columns: Mapping[str, str]
    rows: pd.DataFrame


def _deviations(runs: Sequence[Run]) -> pd.DataFrame:
    return deviations_along([run.trajectory for run in runs], runs[0].parameters)


def _fallbacks(run: Run) -> float:
    return run.figures["fallbacks"]


def _along_the_string(runs: Sequence[Run]) -> StringPart:
    rows = _deviations(runs)
    for name, ratios in amplification(rows).items():
        rows[f"{name}_ratio"] = ["" if np.isnan(each) else f" (× {each:.2f})" for each in ratios]
    rows["name"] = ["driving cycle", *(f"car_{place}" for place in rows.index[1:])]
    rows["fallbacks"] = [np.nan, *map(_fallbacks, runs)]
    return StringPart(
        "From vehicle to vehicle",
        "In brackets: the ratio to the member ahead; below 1 a disturbance fades.",
        {
            "": "{name}",
            "speed, std (m/s):": "{speed_m_s:.2f}{speed_m_s_ratio}",
            "acceleration, rms (m/s²):": "{acceleration_m_s2:.3f}{acceleration_m_s2_ratio}",
            "acceleration, peak (m/s²):": "{peak_acceleration_m_s2:.2f}{peak_acceleration_m_s2_ratio}",
            "gap, std (m):": "{gap_m:.2f}{gap_m_ratio}",
            "least gap − s_min (m):": "{smallest_margin_m:.2f}",
            "largest gap (m):": "{largest_gap_m:.1f}",
            "fallbacks:": "{fallbacks:.0f}",
        },
        rows,
    )


def _savings(runs: Sequence[Run], others: Sequence[Run]) -> StringPart:
    """Compare each vehicle with the one in its place in the other string."""
    pairs = zip(runs, others, strict=True)
    rows = 100.0 * pd.DataFrame(
        [relative_changes(own.figures, other.figures) for own, other in pairs]
    )
    rows["name"] = [f"car_{place + 1}" for place in rows.index]
    for name, string in (("own_m_s2", runs), ("other_m_s2", others)):
        rows[name] = _deviations(string).acceleration_m_s2[1:].to_numpy()
    savings = [own.saving(other) for own, other in zip(runs, others, strict=True)]
    rows["energy_saved"] = [f"{found.energy.text} ({found.energy.as_driven})" for found in savings]
    rows["cells"] = [found.cells.text for found in savings]
    rows["aging_saved"] = [f"{found.aging.text} ({found.aging.as_driven})" for found in savings]
    rows["kept"] = [found.following.text for found in savings]
    return StringPart(
        "What each vehicle saves",
        f"Against a string that drives by `{others[0].strategy}`, each vehicle against the one in its place.",
        {
            "": "{name}",
            "energy saved, equal ends:": "{energy_saved}",
            "ageing saved, measured cells:": "{cells}",
            "by the paper's law:": "{aging_saved}",
            "distance kept:": "{kept}",
            "cooling energy:": "{cooling_energy:+.1f} %",
            "traction energy:": "{traction_energy:+.1f} %",
            "acceleration, rms (m/s²):": "{own_m_s2:.3f}",
            "of the other string (m/s²):": "{other_m_s2:.3f}",
        },
        rows,
    )


def _late_plans(late: Mapping[float, Sequence[Run]]) -> StringPart:
    rows = []
    for late_s, runs in late.items():
        vehicles = _deviations(runs)[1:]
        row = {
            "late_s": late_s,
            "last_m_s2": vehicles.acceleration_m_s2.iloc[-1],
            "smallest_margin_m": vehicles.smallest_margin_m.min(),
            "largest_gap_m": vehicles.largest_gap_m.max(),
            "fallbacks": sum(map(_fallbacks, runs)),
        }
        rows.append(row)
    return StringPart(
        "How late the plans may be",
        "The same string without ROS, with `latency_s`; the extremes of all vehicles.",
        {
            "plans arrive after": "{late_s:g} s",
            "acceleration of the last car, rms (m/s²):": "{last_m_s2:.3f}",
            "least gap − s_min (m):": "{smallest_margin_m:.2f}",
            "largest gap (m):": "{largest_gap_m:.1f}",
            "fallbacks:": "{fallbacks:.0f}",
        },
        pd.DataFrame(rows),
    )


def string_parts(
    runs: Sequence[Run],
    others: Sequence[Run] = (),
    late: Mapping[float, Sequence[Run]] | None = None,
) -> list[StringPart]:
    """Return the tables about a string.

    Args:
        runs: of the vehicles, the first one first.
        others: of a string of another strategy, empty for none.
        late: of the same string without ROS, by how late the plans arrive in s.
    """
    parts = [_along_the_string(runs)]
    parts += [_savings(runs, others)] if others else []
    return parts + ([_late_plans(late)] if late else [])


def save_string_picture(path: Path, runs: Sequence[Run]) -> None:
    """Draw speeds, gaps, and margins to the lower limit of the gap."""
    with rc_context(STYLE):
        layout = ConstrainedLayoutEngine(h_pad=0.06, hspace=0.03)
        figure = Figure(figsize=_SIZE_INCHES, dpi=_DOTS_PER_INCH, layout=layout)
        FigureCanvasAgg(figure)
        speed, gap, margin = figure.subplots(3, 1, sharex=True)
        first = runs[0].trajectory
        speed.plot(
            first.time_s, KM_H_PER_M_S * first.leader_speed_m_s, color=GREY, label="driving cycle"
        )
        count = len(runs)
        for place, run in enumerate(runs):
            each, colour = run.trajectory, colormaps["viridis"](place / count)
            name = f"car_{place + 1}"
            speed.plot(each.time_s, KM_H_PER_M_S * each.speed_m_s, color=colour, label=name)
            gap.plot(each.time_s, each.gap_m, color=colour)
            margins_m = gap_margins_m(each, run.parameters)
            margin.plot(each.time_s, margins_m, color=colour)
        margin.axhline(0.0, color=GREY, linestyle="--")
        for axes, title, unit in (
            (speed, "speed", "km/h"),
            (gap, "gap to the vehicle ahead", "m"),
            (margin, "gap above its lower limit", "m"),
        ):
            axes.set_title(title)
            axes.set_ylabel(unit)
            axes.margins(x=0.0)
        speed.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=count + 1)
        margin.set_xlabel("time (s)")
        figure.savefig(path, metadata={"Software": "iptm"})
