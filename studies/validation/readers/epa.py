"""Dynamometer tests of electric cars from the list of test cars of the US Environmental Protection Agency.

The list has known defects: some consumptions are kWh/100 mi though labelled MPG, some cars carry label
values (whole numbers on both cycles), brands are spelt in several ways, and rows lack values.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from studies.validation.readers.columns import numbers, original_table

KWH_PER_GALLON = 33.705
KM_PER_MILE = 1.609344
KG_PER_POUND = 0.45359237
NEWTON_PER_POUND_FORCE = 4.4482216153
M_S_PER_MPH = 0.44704
LARGEST_KWH_PER_100_MILES = 60.0
"""A smaller number is in kWh/100 mi: no car consumes that much."""
RATIO_RANGE = (0.8, 1.4)
"""Plausible ratio of the consumptions on HWFET and UDDS; beyond it the two values have different meanings."""
CYCLES = {"81": "udds", "84": "hwfet"}
_MAKES = {"2022": "Lucid", "Polestar2 Dual Motor": "Polestar"}
_COLUMNS = {
    "make": "Represented Test Veh Make",
    "model": "Represented Test Veh Model",
    "vehicle": "Test Vehicle ID",
    "configuration": "Test Veh Configuration #",
    "fuel": "Test Fuel Type Cd",
    "cycle": "Test Procedure Cd",
    "value": "RND_ADJ_FE",
    "mass": "Equivalent Test Weight (lbs.)",
    "a": "Target Coef A (lbf)",
    "b": "Target Coef B (lbf/mph)",
    "c": "Target Coef C (lbf/mph**2)",
}
_ELECTRICITY = "62"


def is_epa(head: list[str]) -> bool:
    """True for the first lines of a list of test cars."""
    return all(name in head[0] for name in ("Target Coef A (lbf)", "RND_ADJ_FE"))


def dynamometer_tests(path: Path) -> list[pd.DataFrame]:
    """Return the tests of electric cars on UDDS and HWFET as one table, without contradictory cars."""
    table = original_table(path, _COLUMNS.values())[list(_COLUMNS.values())].set_axis(
        list(_COLUMNS), axis=1
    )
    table = table.apply(lambda column: column.str.strip())
    for name in ("value", "mass", "a", "b", "c"):
        table[name] = numbers(table[name])
    is_electric = table.cycle.isin(CYCLES) & (table.fuel == _ELECTRICITY)
    table = table[is_electric & np.isfinite(table.value)]
    is_energy = table.value < LARGEST_KWH_PER_100_MILES
    kwh_per_mile = np.where(is_energy, table.value / 100.0, KWH_PER_GALLON / table.value)
    make = table.make.map(lambda name: _MAKES.get(name, name.title()))
    table = table.assign(
        make=make,
        car=make + " " + table.model + " " + table.vehicle + "-" + table.configuration,
        cycle=table.cycle.map(CYCLES),
        mass_kg=table.mass * KG_PER_POUND,
        constant_n=table.a * NEWTON_PER_POUND_FORCE,
        linear_n_s_m=table.b * NEWTON_PER_POUND_FORCE / M_S_PER_MPH,
        quadratic_n_s2_m2=table.c * NEWTON_PER_POUND_FORCE / M_S_PER_MPH**2,
        consumption_wh_km=1000.0 * kwh_per_mile / KM_PER_MILE,
    )
    sound = [tests for _, tests in table.groupby("car", sort=False) if not _contradicts(tests)]
    return [pd.concat(sound)] if sound else []


def _contradicts(tests: pd.DataFrame) -> bool:
    """True for the label values of a car, and for values on the two cycles that cannot be of one kind."""
    if len(tests) > 1 and (tests.value % 1.0 == 0.0).all():
        return True
    means = tests.groupby("cycle").consumption_wh_km.mean()
    low, high = RATIO_RANGE
    return len(means) == len(CYCLES) and not low <= means["hwfet"] / means["udds"] <= high
