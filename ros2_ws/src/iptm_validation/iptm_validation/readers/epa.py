"""Dynamometer tests of electric cars from the list of test cars of the US Environmental Protection Agency.

The list has known defects: some consumptions are kWh/100 mi though labelled MPG, some cars carry label
values (whole numbers on both cycles), brands are spelt in several ways, and rows lack values.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from iptm_validation.measurements import DynamometerTest
from iptm_validation.readers.columns import cell_number, original_rows

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


def dynamometer_tests(path: Path) -> list[DynamometerTest]:
    """Read the tests of electric cars on UDDS and HWFET, without contradictory cars."""
    header, rows = original_rows(path, ",", 0)
    at = {key: header.index(name) for key, name in _COLUMNS.items()}
    cars: dict[str, list[tuple[float, DynamometerTest]]] = defaultdict(list)
    for row in rows:
        cell = {key: row[index].strip() for key, index in at.items()}
        value = cell_number(cell["value"])
        if cell["cycle"] not in CYCLES or cell["fuel"] != _ELECTRICITY or not np.isfinite(value):
            continue
        is_energy = value < LARGEST_KWH_PER_100_MILES
        kwh_per_mile = value / 100.0 if is_energy else KWH_PER_GALLON / value
        make = _MAKES.get(cell["make"], cell["make"].title())
        car = f"{make} {cell['model']} {cell['vehicle']}-{cell['configuration']}"
        test = DynamometerTest(
            car=car,
            make=make,
            cycle=CYCLES[cell["cycle"]],
            mass_kg=cell_number(cell["mass"]) * KG_PER_POUND,
            constant_n=cell_number(cell["a"]) * NEWTON_PER_POUND_FORCE,
            linear_n_s_m=cell_number(cell["b"]) * NEWTON_PER_POUND_FORCE / M_S_PER_MPH,
            quadratic_n_s2_m2=cell_number(cell["c"]) * NEWTON_PER_POUND_FORCE / M_S_PER_MPH**2,
            consumption_wh_km=1000.0 * kwh_per_mile / KM_PER_MILE,
        )
        cars[car].append((value, test))
    return [test for tests in cars.values() if not _contradicts(tests) for _, test in tests]


def _contradicts(tests: list[tuple[float, DynamometerTest]]) -> bool:
    """True for the label values of a car, and for values on the two cycles that cannot be of one kind."""
    if len(tests) > 1 and all(value.is_integer() for value, _ in tests):
        return True
    means = {
        cycle: np.mean([test.consumption_wh_km for _, test in tests if test.cycle == cycle])
        for cycle in {test.cycle for _, test in tests}
    }
    if len(means) < len(CYCLES):
        return False
    return not RATIO_RANGE[0] <= means["hwfet"] / means["udds"] <= RATIO_RANGE[1]
