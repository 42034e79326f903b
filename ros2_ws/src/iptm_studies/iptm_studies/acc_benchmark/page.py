"""The page of the benchmark: two tables per car, and one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from iptm_core.markdown import markdown_table
from iptm_core.parameters import load_parameters
from iptm_studies.acc_benchmark.comparison import Figures, Found, Spread, column
from iptm_studies.acc_benchmark.drives import Car
from iptm_studies.acc_benchmark.scenes import LONGEST_S, RUN_IN_S

PAGE = "acc-benchmark.md"
PICTURE = "acc-benchmark.png"
REAL = "real follower"
NOTICE = "<!-- Made by scripts/acc_benchmark from stored runs; do not edit. -->"
WIDTH_INCH, DPI = 9.0, 90
_PANELS = (
    ("headway_s", "time headway, s"),
    ("jerk_m_s3", "jerk (rms), m/s³"),
    ("energy_saving", "energy saved, %"),
    ("aging_saving", "ageing saved, %"),
)


@dataclass(frozen=True)
class Findings:
    """What the page shows.

    Attributes:
        command: what makes it.
        cars: figures by car and way of driving.
        failures: failed runs, address and cause.
    """

    command: str
    cars: Mapping[Car, Found]
    failures: Mapping[str, str]

    @property
    def collisions(self) -> int:
        """Runs that touched the lead vehicle."""
        return sum(
            row.collided for found in self.cars.values() for rows in found.values() for row in rows
        )


def draw_picture(folder: Path, found: Findings) -> None:
    """Draw the picture of the page in a folder."""
    pictures = folder / "images"
    pictures.mkdir(parents=True, exist_ok=True)
    _draw(found, pictures / PICTURE)


def benchmark_page(found: Findings) -> str:
    """Return the page as Markdown."""
    counts = sorted({len(rows[REAL]) for rows in found.cars.values()})
    parts = [
        f"# Behind measured lead vehicles\n\n{NOTICE}",
        f"""\
Made by `{found.command}`. The default strategy drives behind {" and ".join(map(str, counts))} lead
vehicles of OpenACC, compared with the production car that followed each of them in the same seconds with its
adaptive cruise control. Collisions: {found.collisions}.

![Spread over the lead vehicles](images/{PICTURE})""",
        _METHOD,
    ]
    parts += [_of_car(car, rows) for car, rows in found.cars.items()]
    if found.failures:
        rows = list(found.failures.items())
        parts.append("## Failed runs\n\n" + markdown_table(("run", "cause"), rows))
    return "\n\n".join(parts) + "\n"


_METHOD = f"""\
## How it is compared

- **Data:** M. Makridis, K. Mattas, A. Anesiadou, B. Ciuffo, *OpenACC: an open database of car-following
  experiments*, Transportation Research Part C 125, 2021; Joint Research Centre of the European Commission,
  [CC BY 4.0](https://creativecommons.org/licenses/by/4.0/). Followers with adaptive cruise control of the
  platoons in [the excerpts of the project](../ros2_ws/src/iptm_validation/iptm_validation/data/SOURCES.md),
  evenly spread over all pairs of neighbours; speeds and gaps are means of a second. A scene is the
  beginning of the longest part without missing values, {LONGEST_S} s at most. Scenes whose recorded gap
  falls to zero or below (errors of the positioning) are left out.
- **Vehicle:** the real cars burn petrol or have motors of other sizes, so their energy and ageing cannot be
  compared. What is compared is the motion, with the same models: the speed of the real follower is driven
  exactly by the simulated vehicle, its compressor controlled by the thermostat of the strategy
  `production`. Vehicle models: the paper's car on a hot day, and the BMW i3, whose model was fitted to
  measurements, on a mild one. The road is level for all.
- **Start:** all begin at rest with the same pack. Where the lead vehicle was moving when the scene began, a
  run-in of {RUN_IN_S} s leads up to its speed, and that of the real follower to its own. Gap, headway, jerk
  and time below count in the measured seconds only; energy and ageing from standstill.
- **Equal ends:** energy is that from the battery per distance, less the kinetic energy at the end, and with
  what it takes to cool the warmer pack to the temperature of the other; ageing in the same way
  ([formula](explanation/comparison.md)). The remaining differences in gap and kinetic energy at the end are
  in the tables.
- **Limits of the gap:** *120 m* is the shipped one. With *real headway* the time headway may be at most the
  95th percentile of that real follower's (above 5 m/s; below 8 m no limit); where the shipped lower limit
  (5 m and 1.5 s) would be above that, its time headway is cut, to 0.3 s at least. Both limits are soft, and
  without V2X the reserve for a lead vehicle that may brake outranks the upper one.
- **No V2X:** the lead vehicle's speed and gap are measured, its future is extrapolated. **Perfect
  preview:** it is known.
- Savings are in percent of the real follower's; a negative number is more. Figures are the median over the
  lead vehicles and, in brackets, the quartiles. *Time below*: share of the time with a shorter time headway
  than the real follower at the same instant. *Time above*: share of the time above 5 m/s with a time
  headway beyond the 95th percentile of that real follower's. *Emergency*: runs in which the safety monitor
  braked."""


def _of_car(car: Car, found: Found) -> str:
    described = load_parameters(car.parameter_set).description
    spacing, value = [], []
    for way, rows in found.items():
        spacing.append(
            [
                way,
                str(sum(row.collided for row in rows)),
                f"{min(column(rows, 'smallest_gap_m')):.1f}",
                _text(rows, "gap_m", 1),
                _text(rows, "headway_s", 2),
                _text(rows, "below_share", 0, 100.0),
                _text(rows, "above_share", 0, 100.0),
                _text(rows, "jerk_m_s3", 2),
                str(sum(row.emergency_s > 0.0 for row in rows)),
            ]
        )
        value.append(
            [
                way,
                _text(rows, "consumption_kwh_100_km", 1),
                *(
                    ("0", "0")
                    if way == REAL
                    else (_text(rows, "energy_saving", 1), _text(rows, "aging_saving", 1))
                ),
                _text(rows, "end_gap_m", 1),
                _text(rows, "end_kinetic_j", 0, 1e-3),
            ]
        )
    heads = ["", "collisions:", "smallest gap, m:", "gap, m:", "time headway, s:", "time below, %:"]
    heads += ["time above, %:", "jerk (rms), m/s³:", "emergency:"]
    ends = ["", "kWh/100 km:", "energy saved, %:", "ageing saved, %:"]
    ends += ["gap at the end, m:", "kinetic energy at the end, kJ:"]
    return (
        f"## `{car.parameter_set}` at {car.ambient_c:g} °C\n\n{described[:1].upper()}{described[1:]}.\n\n"
        f"{markdown_table(heads, spacing)}\n\n"
        "Energy, and cyclic ageing while driving by the paper's law ([years of use](life.md) have the "
        "capacity); the last two columns are differences to the real follower.\n\n"
        f"{markdown_table(ends, value)}"
    )


def _text(rows: Sequence[Figures], name: str, digits: int, factor: float = 1.0) -> str:
    return Spread.of([factor * value for value in column(rows, name)]).text(digits)


def _draw(found: Findings, path: Path) -> None:
    """Draw the spread over the lead vehicles as boxes from quartile to quartile."""
    picture = Picture(figsize=(WIDTH_INCH, 3.2 * len(found.cars)), dpi=DPI, layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots(len(found.cars), len(_PANELS), squeeze=False, sharey="row")
    for line, (car, ways) in zip(axes, found.cars.items(), strict=True):
        for axis, (name, label) in zip(line, _PANELS, strict=True):
            values = [_known(column(rows, name)) for rows in ways.values()]
            if name.endswith("saving"):
                values = [[] if way == REAL else v for way, v in zip(ways, values, strict=True)]
                axis.axvline(0.0, color="0.6", linewidth=0.8)
            axis.boxplot(values, orientation="horizontal", showfliers=False, widths=0.6)
            axis.set_xlabel(label)
            axis.grid(axis="x", alpha=0.3)
        line[0].set_yticks(np.arange(1, len(ways) + 1), list(ways))
        line[0].invert_yaxis()
        line[0].set_title(
            f"{car.parameter_set}, {car.ambient_c:g} °C", loc="left", fontsize="medium"
        )
    picture.savefig(path, metadata={"Software": None})


def _known(values: Sequence[float]) -> list[float]:
    return [value for value in values if np.isfinite(value)]
