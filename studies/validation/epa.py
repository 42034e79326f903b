"""Consumption of many electric cars on the dynamometer, from their road load with one drivetrain for all.

The list of test cars of the US Environmental Protection Agency has known defects: some consumptions are
kWh/100 mi though labelled MPG, some cars carry label values (whole numbers on both cycles), brands are spelt
in several ways, and rows lack values.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from studies.validation.excerpts import DATA
from studies.validation.outcome import Comparison, Curve, Figure, Outcome

from iptm_core.markdown import render_page
from iptm_core.parameters.catalogue import AUXILIARY_POWER_W, CHARGING_EFFICIENCY, INERTIA_FACTOR
from iptm_core.routes.cycles import load_cycle
from iptm_core.state import FloatArray

BLEND_M_S = (3.0 / 3.6, 8.0 / 3.6)
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


def coast_down_force_n(
    speed_m_s: FloatArray, constant_n: float, linear_n_s_m: float, quadratic_n_s2_m2: float
) -> FloatArray:
    """Return the road load ``A + B v + C v^2`` from the three coefficients of a coast-down test, in N."""
    return constant_n + speed_m_s * (linear_n_s_m + quadratic_n_s2_m2 * speed_m_s)


@dataclass(frozen=True)
class OneDrivetrain:
    """The drivetrain that all cars share.

    Attributes:
        fitted_on: names of the cars.
        driving_efficiency: from the battery to the wheels.
        recovered_share: from the wheels into the battery.
    """

    fitted_on: tuple[str, ...]
    driving_efficiency: float
    recovered_share: float


def dynamometer_tests() -> pd.DataFrame:
    """Return the tests of electric cars on UDDS and HWFET, without contradictory cars, a row per test.

    Columns: unique name of ``car`` and configuration, ``make`` (spelt in one way), ``cycle`` (``udds`` or
    ``hwfet``), ``mass_kg`` (equivalent test weight), road load coefficients ``constant_n``,
    ``linear_n_s_m`` and ``quadratic_n_s2_m2``, and ``consumption_wh_km`` (from the grid per distance).
    """
    table = pd.read_csv(
        DATA / "epa_2022_bev_tests.csv.gz", encoding="utf-8-sig", dtype=str, keep_default_na=False
    )
    table = table[list(_COLUMNS.values())].set_axis(list(_COLUMNS), axis=1)
    table = table.apply(lambda column: column.str.strip())
    for name in ("value", "mass", "a", "b", "c"):
        table[name] = pd.to_numeric(table[name], errors="coerce")
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
    return pd.concat(sound)


def _contradicts(tests: pd.DataFrame) -> bool:
    """True for the label values of a car, and for values on the two cycles that cannot be of one kind."""
    if len(tests) > 1 and (tests.value % 1.0 == 0.0).all():
        return True
    means = tests.groupby("cycle").consumption_wh_km.mean()
    low, high = RATIO_RANGE
    return len(means) == len(CYCLES) and not low <= means["hwfet"] / means["udds"] <= high


def wheel_energies_wh_km(tests: pd.DataFrame) -> FloatArray:
    """Return driving, braking (negative) and auxiliary energy per distance, shape (tests, 3)."""
    energies = []
    for test in tests.itertuples():
        cycle = load_cycle(test.cycle)
        times = np.arange(cycle.times_s[0], cycle.times_s[-1] + 0.5, 1.0)
        speed = np.interp(times, cycle.times_s, cycle.speeds_m_s)
        acceleration = np.gradient(speed, times)
        load = coast_down_force_n(speed, test.constant_n, test.linear_n_s_m, test.quadratic_n_s2_m2)
        force = np.where(speed > 0.05, load, 0.0) + INERTIA_FACTOR * test.mass_kg * acceleration
        power = force * speed
        low, high = BLEND_M_S
        blend = np.clip((speed - low) / (high - low), 0.0, 1.0)
        sums = (
            np.maximum(power, 0.0).sum(),
            (blend * np.minimum(power, 0.0)).sum(),
            AUXILIARY_POWER_W * len(times),
        )
        # Joules per metre of one-second sums are watt-hours per kilometre times 3.6.
        energies.append(np.array(sums) / speed.sum() / 3.6)
    return np.array(energies)


def consumption_wh_km(energies: FloatArray, drivetrain: OneDrivetrain) -> FloatArray:
    """Return the energy from the grid per distance, shape (tests,)."""
    drive, brake, auxiliary = energies.T
    battery = drive / drivetrain.driving_efficiency + brake * drivetrain.recovered_share + auxiliary
    return np.asarray(battery / CHARGING_EFFICIENCY, dtype=np.float64)


def compare_cars(tests: pd.DataFrame, drivetrain: OneDrivetrain) -> Outcome:
    """Compare the consumptions, on the cars that were not fitted and on all."""
    modelled = consumption_wh_km(wheel_energies_wh_km(tests), drivetrain)
    errors = 100.0 * (modelled / tests.consumption_wh_km - 1.0)
    tests = tests.assign(modelled=modelled, error=errors)
    others = tests[~tests.car.isin(drivetrain.fitted_on)]
    figures = []
    for part, chosen in (("cars not fitted", others), ("all cars", tests)):
        label = f"{part}, {len(chosen)} tests"
        mean, deviation = float(chosen.error.mean()), float(chosen.error.std())
        figures += [
            Figure("consumption, mean", label, mean, "%", -2.0, 2.0),
            Figure("consumption, deviation", label, deviation, "%", None, 9.5),
        ]
        freedom = len(chosen) - chosen.make.nunique()
        if freedom > 0:
            around = chosen.error - chosen.groupby("make").error.transform("mean")
            within = float(np.sqrt((around**2).sum() / freedom))
            figures.append(Figure("consumption, within a make", label, within, "%", None, 5.0))
    ordered = others.sort_values("consumption_wh_km")
    curve = Curve(
        f"cars not fitted, {len(others)} tests",
        float(others.error.mean()),
        np.arange(1.0, len(ordered) + 1.0, dtype=np.float64),
        ordered.consumption_wh_km.to_numpy() / 10.0,
        ordered.modelled.to_numpy() / 10.0,
    )
    return Outcome(
        title="EPA: consumption of electric cars on the dynamometer",
        text=render_page(Path(__file__).parent, "cars.md.j2", drivetrain=drivetrain),
        figures=tuple(figures),
        comparisons=(
            Comparison(
                "epa_consumption",
                "Consumption from the grid on UDDS and HWFET",
                "test, in the order of consumption",
                "kWh/100 km",
                "mean error in %",
                (curve,),
            ),
        ),
    )
