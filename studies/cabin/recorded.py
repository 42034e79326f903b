"""The cabin of the BMW i3 against its winter trips: temperature with the recorded heater, heater to keep it.

The cabin (`bmw_i3.cabin`) was fitted to eleven other winter trips of the same data set; these eight were held
out. The recorded temperature of the cabin does not go below 10 degC: until it rises it does not count, and
the cabin begins at the temperature of the air.

Sun, persons and flaps are not recorded. With one constant sun for each trip, the best one, the error shows
the other causes. The pack begins at its recorded temperature and has the heat of the recorded current.
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
from iptm_core.physics.cell import cell_resistance_ohm
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

TRIPS = ("B05", "B16", "B20", "B23", "B24", "B28", "B32", "B37")
COLUMNS = {
    "speed_km_h": 1.0 / 3.6,
    "heating_power_kw": 1e3,
    "ambient_temperature_c": 1.0,
    "cabin_temperature_c": 1.0,
    "heatercore_temperature_c": 1.0,
    "battery_temperature_c": 1.0,
    "battery_current_a": 1.0,
}
LOWEST_C = 10.01
GAIN_W_K, INTEGRAL_W_K_S, LARGEST_W = 600.0, 3.0, 7000.0
MOST_SUN_W_M2 = 1000.0


@cache
def _rows() -> pd.DataFrame:
    return pd.read_csv(DATA / "bmw_i3_1hz.csv.gz", float_precision="round_trip")


def _columns(trip: str) -> tuple[FloatArray, ...]:
    """Return COLUMNS of a trip at every second, in W, m/s, degC and A."""
    rows = _rows()[_rows().trip == trip]
    times = rows.time_s.to_numpy() - rows.time_s.iloc[0]
    grid = np.arange(0.0, times[-1], 1.0)
    return tuple(
        np.interp(grid, times, factor * rows[name].interpolate(limit_direction="both").to_numpy())
        for name, factor in COLUMNS.items()
    )


def _driven(
    trip: str, *, keeps: bool, sun_w_m2: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return temperatures of cabin and cells in degC, and heater power in W, of a trip.

    Args:
        keeps: the heater keeps the recorded temperature, where there is one; else it has the recorded power.
    """
    car = load_parameters("bmw_i3").values
    functions = thermal_functions(read_cabin("bmw_i3.cabin"), car)
    speed, power, air, measured, core, cell, current = _columns(trip)
    begin = measured[0] if measured[0] > LOWEST_C else min(air[0], LOWEST_C)
    nodes = (begin, begin, core[0], air[0], cell[0], cell[0])
    states = tuple(float(each) + CELSIUS_ZERO_K for each in nodes)
    found, used, cells = (np.empty(len(speed)) for _ in range(3))
    integral_w = float(power[0])
    of_cell_a = current / car.pack.parallel
    for second in range(len(speed)):
        found[second] = states[0] - CELSIUS_ZERO_K
        mean_k = 0.5 * (states[4] + states[5])
        cells[second] = mean_k - CELSIUS_ZERO_K
        heater_w = float(power[second])
        if keeps and measured[second] > LOWEST_C:
            error_k = float(measured[second]) - found[second]
            integral_w = min(max(integral_w + INTEGRAL_W_K_S * error_k, 0.0), LARGEST_W)
            heater_w = min(max(GAIN_W_K * error_k + integral_w, 0.0), LARGEST_W)
        used[second] = heater_w
        ohm = float(cell_resistance_ohm(mean_k, 0.0, car.cell))
        heat_w = car.pack.cells * ohm * float(of_cell_a[second]) ** 2
        outside_k = float(air[second]) + CELSIUS_ZERO_K
        weather = (float(speed[second]), heat_w, 0.0, outside_k, sun_w_m2)
        states = functions.advance(states, (0.0, 0.0, heater_w, 0.0), weather, 0.0, 1.0)
    return found, used, cells


def judged(trip: str) -> dict[str, Any]:
    """Return errors of a trip.

    Rms and mean of the cabin in K, rms with the best constant sun, that sun in W/m^2, rms of the cells in K,
    and heater energy over the recorded one.
    """
    _, power, air, measured, _, cell, _ = _columns(trip)
    counts = measured > LOWEST_C

    def error_k(sun_w_m2: float) -> FloatArray:
        cabin, _, _ = _driven(trip, keeps=False, sun_w_m2=sun_w_m2)
        error: FloatArray = (cabin - measured)[counts]
        return error

    dark, lit = error_k(0.0), error_k(MOST_SUN_W_M2)
    # The cabin is linear in the sun, with heater power and speed given.
    slope = (lit - dark) / MOST_SUN_W_M2
    sun_w_m2 = -float(dark @ slope) / float(slope @ slope)
    _, _, cells = _driven(trip, keeps=False)
    _, used, _ = _driven(trip, keeps=True)
    return {
        "trip": trip,
        "air_c": float(air.mean()),
        "minutes": len(air) / 60.0,
        "rms_k": _rms(dark),
        "mean_k": float(dark.mean()),
        "lit_k": _rms(dark + sun_w_m2 * slope),
        "sun_w_m2": sun_w_m2,
        "cells_k": _rms(cells - cell),
        "heater": float(used.sum() / power.sum()),
        "recorded_kwh": float(power.sum()) / 3.6e6,
    }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def summary(table: pd.DataFrame) -> dict[str, float]:
    """Return the figures of all trips together."""
    energy = table.recorded_kwh
    return {
        "median_k": float(table.rms_k.median()),
        "all_k": _rms(table.rms_k.to_numpy()),
        "lit_k": float(table.lit_k.median()),
        "cells_k": _rms(table.cells_k.to_numpy()),
        "worst_cells_k": float(table.cells_k.max()),
        "total": 100.0 * float((table.heater * energy).sum() / energy.sum() - 1.0),
        "median_trip": 100.0 * float((table.heater - 1.0).abs().median()),
    }
