"""The page about real cars: savings, and what simpler models of the controller cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.markdown import markdown_table
from iptm_core.parameters import load_parameters
from iptm_studies.real_cars.drives import DEFAULT, ROLES, Extent
from iptm_studies.real_cars.savings import SHIPPED_GAP, Row
from iptm_studies.real_cars.simplifications import (
    CAR,
    LARGEST_LOSS,
    SIMPLIFICATIONS,
    Loss,
    Simplification,
)

NOTICE = "<!-- Made by scripts/real_cars from stored runs; do not edit. -->"
NO_VALUE = "–"
_LEGEND = """\
Savings of the default strategy are in percent of what the other controller needs on the same trip behind
the same lead vehicle; a negative number is more. **Ageing** is the capacity that both cells lose by the
paper's law for cyclic ageing while driving ([years of use](life.md) have the percentage points of capacity,
parked hours included), with the same constants for every cell: the public data have no ageing, so it
compares controllers in one car, and no two cars. **Equal ends** is ageing with both packs cooled to the
same temperature at the end (none where they end below the lower limit of 25 °C). **Cooling** is the energy
of compressor and auxiliaries, **traction** the electric traction energy, both as the paper counts them.
**Gap** is the largest one that the default strategy may leave: 120 m as shipped, or a time headway of 3 s
in addition. The other controllers keep their own distance: **reference** is the paper's, on its horizon of
15 s; **production** has adaptive cruise control with a constant time headway and a thermostat with
hysteresis, as cars have today (`iptm_controller/production.py`). The preview of the lead vehicle is
perfect; production does without.

Every car was parked outside: its cells begin at the temperature of the air. No car has a heater of its
pack. The reference strategy tracks 26 °C, and in the cold its only means are currents: it drives and brakes
harder to warm the cells, which then age by a multiple. Its rows at -10 and 10 °C show that, and not how
good the default strategy is; there the production-like controller counts."""


@dataclass(frozen=True)
class Findings:
    """What the page shows.

    Attributes:
        command: what makes it.
        extent: what was driven.
        cycle: rows on the cycle.
        road: rows on the measured trips.
        losses: losses by simplification and temperature.
        failures: failed runs, address and cause.
        lacking: number of runs that are not stored yet.
    """

    command: str
    extent: Extent
    cycle: Sequence[Row]
    road: Sequence[Row]
    losses: Mapping[str, Mapping[float, Loss]]
    failures: Mapping[str, str]
    lacking: int = 0

    def too_large(self) -> list[str]:
        """Return the shipped simplifications that cost more than they may."""
        return [
            simplification.name
            for simplification in SIMPLIFICATIONS
            if simplification.shipped
            for worst in [_worst(self.losses.get(simplification.name, {}))]
            if worst > LARGEST_LOSS
        ]


def real_cars_page(found: Findings) -> str:
    """Return the page as Markdown."""
    parts = [
        f"# Real cars\n\n{NOTICE}",
        f"Made by `{found.command}`.\n\n{_cars(found.extent)}\n\n{_LEGEND}",
        "## Saving on WLTC class 3b\n\n" + savings_table(found.cycle),
        *([_road_part(found)] if found.road else []),
        _simplification_part(found.losses),
    ]
    if found.lacking:
        parts.insert(
            2, f"{found.lacking} runs are not computed yet; rows that need them are left out."
        )
    if found.failures:
        rows = list(found.failures.items())
        parts.append("## Failed runs\n\n" + markdown_table(("run", "cause"), rows))
    return "\n\n".join(parts) + "\n"


def _cars(extent: Extent) -> str:
    rows = [
        (
            f"`{car}`",
            load_parameters(car).description,
            f"{load_parameters(car).values.body.mass_kg:.0f} kg",
        )
        for car in extent.cars
    ]
    return markdown_table(("car", "parameter set", "mass:"), rows)


def savings_table(rows: Sequence[Row]) -> str:
    """Return rows as one table, each against every other controller."""
    others = [role for role in ROLES if role != DEFAULT]
    heads = ["car", "air:", "gap", "kWh/100 km:"]
    for role in others:
        heads += [f"{role}: ageing:", "equal ends:", "cooling:", "traction:", "kWh/100 km:"]
    lines = []
    for row in rows:
        cells = [
            row.car,
            f"{row.ambient_c:g} °C",
            gap_text(row),
            f"{row.consumption_kwh_100_km:.1f}",
        ]
        for role in others:
            saving = row.savings[role]
            cells += [
                _number(value)
                for value in (
                    saving.aging,
                    saving.aging_at_equal_end,
                    saving.cooling,
                    saving.traction,
                    saving.consumption,
                )
            ]
        lines.append(cells)
    return markdown_table(heads, lines)


def gap_text(row: Row) -> str:
    """Return the limit of the gap of a row."""
    return "120 m" if row.headway_s == SHIPPED_GAP else f"{row.headway_s:g} s"


def _road_part(found: Findings) -> str:
    count = len(found.extent.trips)
    others = [role for role in ROLES if role != DEFAULT]
    heads = ["car", "air:", "gap"]
    for role in others:
        heads += [f"{role}: least:", "median:", "most:"]
    rows = []
    for row in found.road:
        cells = [row.car, f"{row.ambient_c:g} °C", gap_text(row)]
        for role in others:
            values = row.by_trip[role]
            cells += [
                _number(value) for value in (min(values), float(np.median(values)), max(values))
            ]
        rows.append(cells)
    return f"""\
## Saving on measured trips

The lead vehicle drives the first five minutes of {count} recorded trips of a BMW i3 around Munich, with the
slope of their elevation (smoothed over 400 m to either side; sources in
[SOURCES.md](../ros2_ws/src/iptm_validation/iptm_validation/data/SOURCES.md)), evenly spread over the
excerpts of the project, trips faster than 130 km/h left out. The figures are of the sums over the trips.

{savings_table(found.road)}

Saving of ageing on the single trips:

{markdown_table(heads, rows)}"""


def _simplification_part(losses: Mapping[str, Mapping[float, Loss]]) -> str:
    def table(chosen: Sequence[Simplification]) -> str:
        climates = sorted({ambient_c for loss in losses.values() for ambient_c in loss})
        heads = ["simple", "refined", *(f"{ambient_c:g} °C:" for ambient_c in climates), "bar"]
        rows = []
        for simplification in chosen:
            found = losses.get(simplification.name, {})
            cells = [simplification.simple_text, simplification.refined_text]
            for ambient_c in climates:
                loss = found.get(ambient_c)
                cells.append(
                    NO_VALUE
                    if loss is None
                    else f"{_points(loss.aging)} / {_points(loss.consumption)}"
                )
            within = _worst(found) <= LARGEST_LOSS
            cells.append("within" if within else "**beyond**")
            rows.append(cells)
        return markdown_table(heads, rows)

    shipped = [simplification for simplification in SIMPLIFICATIONS if simplification.shipped]
    shared = [simplification for simplification in SIMPLIFICATIONS if not simplification.shipped]
    return f"""\
## What simpler models of the controller cost

`{CAR}` on WLTC: saving against the production-like controller with the refined model in the default
strategy less that with the simple one, in percentage points: of ageing / of kWh/100 km. At most
{LARGEST_LOSS:g} in ageing is within the bar. A negative number is a simple model that saves more, which
closed loops on finite horizons may do. What finite steps of the horizon cost is in [the paper's
studies](paper-reproduction.md).

The shipped controller has the simple model:

{table(shipped)}

The shipped controller has the refined model, that of the vehicle:

{table(shared)}"""


def _worst(found: Mapping[float, Loss]) -> float:
    return max((loss.aging for loss in found.values()), default=math.inf)


def _number(value: float) -> str:
    return NO_VALUE if math.isnan(value) else f"{round(value, 1) + 0.0:.1f}"  # no negative zero


def _points(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}"
