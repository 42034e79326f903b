"""The life table: for cell, usage, climate and control, what is lost, saved and spent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd
from studies.drives import DEFAULT
from studies.life.own_law import PAPER, priced_trips, trip_at, uses_of
from studies.life.trips import DRIVEN_CONTROLS, THERMOSTAT

from iptm.climate import CLIMATES
from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.aging_laws.law import paper_law
from iptm_core.parameters import load_parameters
from iptm_life.life import (
    END_OF_LIFE,
    SERVICE_YEARS,
    band,
    drawn_losses,
    flags,
    losses_by_cause,
    years_to_end,
)
from iptm_life.trip_map import TripMap
from iptm_life.year import USAGES, Usage, Year, year_of

OWN_LAW = "own law"
MANAGED = "own law, managed"
CONTROLS = (*DRIVEN_CONTROLS, OWN_LAW, MANAGED)
RESISTANCE_YEARS = 1.0
OUTSIDE_LOSS = "loss"
"""Where more than `END_OF_LIFE` is lost: a law is not extrapolated to where no test of its cell was."""


def life_table(
    trips: Mapping[tuple[str, str], TripMap], usages: Sequence[Usage] = USAGES
) -> pd.DataFrame:
    """Return one row per usage, climate, cell (`PAPER` for the paper's law) and control.

    Losses are in percentage points of nominal capacity after `SERVICE_YEARS`. Their bands (``_low``,
    ``_high``) are missing for the paper's law, whose spread is not published.

    Args:
        trips: by cycle and control.
        usages: usages of the car.

    Returns:
        ``loss`` and its parts by cause, ``saved`` against the thermostat, ``years`` until 80 %
        of the capacity is left, ``resistance`` (growth in percent after `RESISTANCE_YEARS`, missing
        without a law of it), ``outside`` (quantities outside the experiments behind the law),
        ``cooling_kwh`` of compressor and fan in a year from pack and grid, ``more_kwh`` beyond the
        thermostat's; changes in percent of the ``range``, by the part of that from the pack, and of
        the ``consumption`` from the pack.
    """
    rows: list[dict[str, Any]] = []
    parameters = load_parameters().values
    for usage in usages:
        for climate in CLIMATES:
            labels = {"usage": usage.name, "climate": climate.name}
            shared = {
                control: year_of(
                    usage, climate, control, [trips[usage.cycle, control]] * 12, parameters
                )
                for control in DRIVEN_CONTROLS
            }
            rows += (labels | row for row in _rows(PAPER, shared))
            priced = priced_trips(trips, usage.cycle)
            for cell in AGING_CELLS:
                own = {}
                for control, use in ((OWN_LAW, usage), (MANAGED, usage.managed())):
                    uses = uses_of(cell, use, climate, shared[DEFAULT])
                    of_months = [trip_at(priced, month) for month in uses]
                    own[control] = year_of(use, climate, DEFAULT, of_months, parameters)
                rows += (labels | row for row in _rows(cell, shared | own))
    return pd.DataFrame(rows)


def _rows(name: str, years: Mapping[str, Year]) -> Iterator[dict[str, Any]]:
    cell = AGING_CELLS.get(name)
    law = cell.law if cell else paper_law(load_parameters().values)
    base = years[THERMOSTAT]
    without = sum(losses_by_cause(law, base, SERVICE_YEARS).values())
    drawn = {control: drawn_losses(cell, year) for control, year in years.items() if cell}
    for control, year in years.items():
        causes = losses_by_cause(law, year, SERVICE_YEARS)
        loss = sum(causes.values())
        more_kwh = year.compressor_kwh - base.compressor_kwh
        row = {
            "cell": name,
            "control": control,
            "loss": 100.0 * loss,
            **{str(cause): 100.0 * lost for cause, lost in causes.items()},
            "saved": 100.0 * (without - loss),
            "years": years_to_end(law, year),
            "outside": ", ".join([*flags(cell, year), *([OUTSIDE_LOSS] * (loss > END_OF_LIFE))])
            if cell
            else "",
            "cooling_kwh": year.compressor_kwh + year.grid_compressor_kwh,
            "more_kwh": more_kwh + year.grid_compressor_kwh - base.grid_compressor_kwh,
            "range": 100.0 * (base.driving_kwh / (base.driving_kwh + more_kwh) - 1.0),
            "consumption": 100.0
            * ((year.driving_kwh / year.distance_km) / (base.driving_kwh / base.distance_km) - 1.0),
        }
        if drawn:
            for of, losses in (
                ("loss", drawn[control]),
                ("saved", drawn[THERMOSTAT] - drawn[control]),
            ):
                low, high = band(losses)
                row |= {f"{of}_low": 100.0 * low, f"{of}_high": 100.0 * high}
        if cell and cell.resistance:
            grown = losses_by_cause(cell.resistance, year, RESISTANCE_YEARS)
            row["resistance"] = 100.0 * sum(grown.values())
        yield row
