"""The page about trips to a fast charger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from studies.life.charging_stop import (
    EVENING_LAW,
    HEATER_W,
    MINUTE_KWH,
    MINUTE_VALUES_AIR_C,
    RADIATOR,
    Preparation,
    charging_damage,
)
from studies.life.fast_charge import (
    LIMIT_1_H,
    LIMIT_C,
    TAPER_CHARGE,
    TAPER_SHARE,
    ChargingStopSettings,
    FastCharge,
)

from iptm_core.aging_laws.cells import AGING_CELLS, AgingCell
from iptm_core.aging_laws.law import Mechanism
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH

_LEAST_KWH = 1e-4
"""Energy below which heat per energy is not shown."""

_EVENING = ["place", "cooling", "arrival_c", "thermal_kwh", "removed_kwh"]

Rows = Sequence[Mapping[str, Any]]


def charging_values(arrivals: Rows, values: Rows, evenings: Rows) -> dict[str, Any]:
    """Return what the template of the page shows.

    Args:
        arrivals: trips with every preparation, see `arrival`.
        values: trips with several values of a minute.
        evenings: trips from warm packs, see `charging_stop.evening`.
    """
    bases = {
        (each["car"], each["air_c"]): each
        for each in arrivals
        if each["preparation"] is Preparation.NONE
    }
    cells = {
        name: cell
        for name, cell in AGING_CELLS.items()
        if any(part.mechanism is Mechanism.CYCLIC for part in cell.law.mechanisms)
    }
    aging = []
    for each in arrivals:
        if each["preparation"] is Preparation.OPTIMISED:
            base = bases[each["car"], each["air_c"]]["charge"]
            ratios = {name: _ratio(cell, each["charge"], base) for name, cell in cells.items()}
            aging.append({"car": each["car"], "air_c": each["air_c"], **ratios})
    drives = pd.DataFrame(evenings, columns=_EVENING)
    spent_kwh = drives.thermal_kwh.where(drives.thermal_kwh > _LEAST_KWH)
    return {
        "stop": ChargingStopSettings(),
        "limits": list(zip(LIMIT_C, LIMIT_1_H, strict=True)),
        "tapers": list(zip(TAPER_CHARGE, TAPER_SHARE, strict=True)),
        "heater_kw": 1e-3 * HEATER_W,
        "minute_kwh": MINUTE_KWH,
        "arrivals": _compared(arrivals, bases),
        "air_c": MINUTE_VALUES_AIR_C,
        "minute_values": _compared(values, bases),
        "aging": aging,
        "cells": list(cells),
        "law": EVENING_LAW,
        "radiator": RADIATOR,
        "evenings": drives.assign(ratio=drives.removed_kwh / spent_kwh),
    }


def _compared(trips: Rows, bases: Mapping[tuple[str, float], Mapping[str, Any]]) -> pd.DataFrame:
    """Return trips with minutes and energies, and what they save against those without preparation."""
    rows = []
    for each in trips:
        base = bases[each["car"], each["air_c"]]
        row = {**each, "energy_kwh": each["battery_kwh"] - base["battery_kwh"]}
        for name, charge in (("own", "charge"), ("heated", "heated")):
            minutes = float(each[charge].minutes[0])
            row[f"{name}_min"] = minutes
            row[f"{name}_saved_min"] = float(base[charge].minutes[0]) - minutes
        rows.append({**row, "heater_kwh": each["heated"].heater_j[0] / J_PER_KWH})
    return pd.DataFrame(rows)


def _ratio(cell: AgingCell, charge: FastCharge, base: FastCharge) -> str | None:
    """Return the damage relative to another charge, marked where it is outside of the experiments."""
    before = charging_damage(cell, base)
    if before <= 0.0:
        return None
    celsius = charge.temperature_k - CELSIUS_ZERO_K
    tests = cell.experiments
    is_outside = celsius.min() < tests.cycling_c[0] or celsius.max() > tests.cycling_c[1]
    is_fast = charge.c_rate_1_h.max() > tests.largest_c_rate_1_h
    ratio = charging_damage(cell, charge) / before
    return f"{ratio:.2f}{' (T)' if is_outside else ''}{' (C)' if is_fast else ''}"
