"""The page about capacity over years of use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
from studies import drives
from studies.drives import DEFAULT
from studies.life import decisions, own_law, trips
from studies.life import table as life
from studies.savings import BASELINE, ROAD_COLUMNS

from iptm import climate
from iptm_controller.production import ProductionSettings
from iptm_core.aging_laws.cells import AGING_CELLS, Experiments
from iptm_core.markdown import table_of
from iptm_core.units import CELSIUS_ZERO_K
from iptm_life import life as losses
from iptm_life import year

FLEET = {"cell": "fleet of 22,700 cars", "Rome": 2.3, "Phoenix": 2.7, "hot": 0.4}
"""Capacity lost in percent a year in all and in hot regions, and the difference (Geotab 2026)."""
SHOWN = (BASELINE, trips.EQUAL_ROAD, DEFAULT)
"""Controls of the short statement."""


def life_values(rows: pd.DataFrame, decided: pd.DataFrame, roads: pd.DataFrame) -> dict[str, Any]:
    """Return what the template of the page about the life table and single trips shows."""
    longest = losses.LONGEST_YEARS
    rows = rows.assign(
        loss_band=_bands(rows, "loss", 1),
        saved_band=_bands(rows, "saved", 2),
        outside=rows.outside.where(rows.outside != ""),
        years=[f"> {longest:g}" if years >= longest else f"{years:.1f}" for years in rows.years],
    )
    climates = [each.name for each in climate.CLIMATES]
    rows["mark"] = rows.outside.map(lambda text: " outside" if isinstance(text, str) else "")
    first = rows[rows.usage == year.USAGES[0].name]
    orders = {"control": life.CONTROLS, "climate": climates}
    return {
        "rows": rows,
        "summary": _by_cell(
            first,
            "{saved:.2f}{saved_band}; {more_kwh:.0f}{mark}",
            orders | {"control": life.CONTROLS[1:]},
        ),
        "roads": roads,
        "road_columns": ROAD_COLUMNS,
        "inside": _inside(rows),
        "parked": _parked_shares(first),
        "fleet": _beside_the_fleet(first),
        "decided": decided,
        "resistance": _by_cell(
            first.dropna(subset="resistance"),
            "{resistance:.1f}",
            {name: orders[name] for name in ("climate", "control")},
        ),
        "cells": [
            {"name": name, "cell": cell, "tests": _tests(cell.experiments)}
            for name, cell in AGING_CELLS.items()
        ],
        "decisions": decisions,
        "drives": drives,
        "climate": climate,
        "life": life,
        "losses": losses,
        "own_law": own_law,
        "production": ProductionSettings(),
        "trips": trips,
        "usage": year,
        "year": year,
        "zero_k": CELSIUS_ZERO_K,
    }


def _inside(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per case of which no part is outside the experiments, with what some controls save."""
    cases = []
    for labels, part in rows[rows.cell != own_law.PAPER].groupby(
        ["cell", "usage", "climate"], sort=False
    ):
        by = part.set_index("control")
        if by.loc[[trips.THERMOSTAT, *SHOWN], "outside"].isna().all():
            names = dict(zip(("cell", "usage", "climate"), labels, strict=True))
            saved = {name: by.saved[name] for name in SHOWN}
            cases.append({**names, "loss": by.loss[trips.THERMOSTAT], **saved})
    return pd.DataFrame(cases, columns=["cell", "usage", "climate", "loss", *SHOWN])


def _parked_shares(rows: pd.DataFrame) -> pd.Series:
    """Return the part of the loss with a thermostat that is lost parked, in percent."""
    shown = rows[(rows.control == trips.THERMOSTAT) & (rows.cell != own_law.PAPER)]
    return 100.0 * shown[str(losses.Cause.CALENDAR_PARKED)] / shown.loss


def _beside_the_fleet(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return what each cell loses in percent a year with a thermostat, by climate, and the fleet first."""
    found: list[dict[str, Any]] = [{**FLEET, "Oslo": None, "outside": ""}]
    for cell, part in rows[rows.control == trips.THERMOSTAT].groupby("cell", sort=False):
        yearly = part.set_index("climate").loss / losses.SERVICE_YEARS
        outside = part.set_index("climate").outside.dropna()
        found.append(
            {
                "cell": cell,
                **yearly,
                "hot": yearly["Phoenix"] - yearly["Rome"],
                "outside": ", ".join(outside.index),
            }
        )
    return found


def _bands(rows: pd.DataFrame, name: str, digits: int) -> list[str]:
    ends = zip(rows[f"{name}_low"], rows[f"{name}_high"], strict=True)
    return ["" if pd.isna(low) else f" [{low:.{digits}f}, {high:.{digits}f}]" for low, high in ends]


def _by_cell(rows: pd.DataFrame, text: str, orders: dict[str, Sequence[str]]) -> str:
    """Return a table with a column per cell, and rows in the order of the product of two other columns."""
    cells = rows.cell.unique()
    shown = rows.assign(text=[text.format_map(row) for row in rows.to_dict("records")])
    wide = shown.pivot(index=list(orders), columns="cell", values="text")
    wide = wide.reindex(pd.MultiIndex.from_product(orders.values(), names=orders), columns=cells)
    heads = {name.capitalize(): f"{{{name}}}" for name in orders}
    return table_of(wide.reset_index(), heads, cells)


def _tests(tests: Experiments) -> str:
    return (
        f"storage {_span(tests.calendar_c)} °C, about {tests.days:.0f} days; cycling "
        f"{_span(tests.cycling_c)} °C, depth {_span(tests.depth)}, up to {tests.largest_c_rate_1_h:g}C; "
        f"charge {_span(tests.charge)}"
    )


def _span(ends: tuple[float, float]) -> str:
    return f"{ends[0]:g} to {ends[1]:g}" if ends[0] != ends[1] else f"{ends[0]:g}"
