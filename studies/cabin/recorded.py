"""The cabin of the BMW i3 against its winter trips: temperature with the recorded heater, heater to keep it.

The cabin (`bmw_i3.cabin`) was fitted to eleven other winter trips of the same data set; these eight were held
out. The recorded temperature of the cabin does not go below 10 degC: until it rises it does not count, and
the cabin begins at the temperature of the air.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from studies.validation.excerpts import DATA

from iptm_cabin.parameters import read_cabin
from iptm_cabin.thermal_functions import thermal_functions
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

TRIPS = ("B05", "B16", "B20", "B23", "B24", "B28", "B32", "B37")
COLUMNS = {
    "speed_km_h": 1.0 / 3.6,
    "heating_power_kw": 1e3,
    "ambient_temperature_c": 1.0,
    "cabin_temperature_c": 1.0,
    "heatercore_temperature_c": 1.0,
}
LOWEST_C = 10.01
GAIN_W_K, INTEGRAL_W_K_S, LARGEST_W = 600.0, 3.0, 7000.0


@cache
def _rows() -> pd.DataFrame:
    return pd.read_csv(DATA / "bmw_i3_1hz.csv.gz", float_precision="round_trip")


def _columns(trip: str) -> tuple[FloatArray, ...]:
    """Return speed, heater power, air, cabin and heater core of a trip at every second."""
    rows = _rows()[_rows().trip == trip]
    times = rows.time_s.to_numpy() - rows.time_s.iloc[0]
    grid = np.arange(0.0, times[-1], 1.0)
    return tuple(
        np.interp(grid, times, factor * rows[name].interpolate(limit_direction="both").to_numpy())
        for name, factor in COLUMNS.items()
    )


def _driven(trip: str, *, keeps: bool) -> tuple[FloatArray, FloatArray]:
    """Return cabin temperature in degC and heater power in W of a trip.

    Args:
        keeps: the heater keeps the recorded temperature, where there is one; else it has the recorded power.
    """
    cabin = read_cabin("bmw_i3.cabin")
    functions = thermal_functions(cabin, load_parameters("bmw_i3").values)
    speed, power, air, measured, core = _columns(trip)
    begin = measured[0] if measured[0] > LOWEST_C else min(air[0], LOWEST_C)
    nodes = (begin, begin, core[0], air[0], air[0], air[0])
    states = tuple(float(each) + CELSIUS_ZERO_K for each in nodes)
    found, used, integral_w = np.empty(len(speed)), np.empty(len(speed)), float(power[0])
    for second in range(len(speed)):
        found[second] = states[0] - CELSIUS_ZERO_K
        heater_w = float(power[second])
        if keeps and measured[second] > LOWEST_C:
            error_k = float(measured[second]) - found[second]
            integral_w = min(max(integral_w + INTEGRAL_W_K_S * error_k, 0.0), LARGEST_W)
            heater_w = min(max(GAIN_W_K * error_k + integral_w, 0.0), LARGEST_W)
        used[second] = heater_w
        weather = (float(speed[second]), 0.0, 0.0, float(air[second]) + CELSIUS_ZERO_K, 0.0)
        states = functions.advance(states, (0.0, 0.0, heater_w, 0.0), weather, 0.0, 1.0)
    return found, used


def judged(trip: str) -> dict[str, Any]:
    """Return errors of a trip: rms and mean of the cabin in K, and heater energy over the recorded one."""
    _, power, air, measured, _ = _columns(trip)
    counts = measured > LOWEST_C
    found, _ = _driven(trip, keeps=False)
    _, used = _driven(trip, keeps=True)
    error = (found - measured)[counts]
    return {
        "trip": trip,
        "air_c": float(air.mean()),
        "minutes": len(air) / 60.0,
        "rms_k": float(np.sqrt(np.mean(error**2))),
        "mean_k": float(error.mean()),
        "heater": float(used.sum() / power.sum()),
        "recorded_kwh": float(power.sum()) / 3.6e6,
    }


def summary(table: pd.DataFrame) -> dict[str, float]:
    """Return the figures of all trips together."""
    energy = table.recorded_kwh
    return {
        "median_k": float(table.rms_k.median()),
        "all_k": float(np.sqrt((table.rms_k**2).mean())),
        "total": 100.0 * float((table.heater * energy).sum() / energy.sum() - 1.0),
        "median_trip": 100.0 * float((table.heater - 1.0).abs().median()),
    }
