"""Consumption of many electric cars on the dynamometer, from their road load with one drivetrain for all."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from studies.validation.outcome import Comparison, Curve, Figure, Outcome

from iptm.parts import (
    AUXILIARY_POWER_W,
    CHARGING_EFFICIENCY,
    INERTIA_FACTOR,
    FloatArray,
    coast_down_force_n,
    held_out,
    load_cycle,
    render_page,
)

BLEND_M_S = (3.0 / 3.6, 8.0 / 3.6)


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


def fit_one_drivetrain(tests: pd.DataFrame) -> OneDrivetrain:
    """Fit the two efficiencies on two thirds of the cars, by relative errors."""
    chosen = tests[~tests.car.isin(held_out(list(tests.car)))]
    energies = wheel_energies_wh_km(chosen)
    measured = chosen.consumption_wh_km.to_numpy()
    names = tuple(sorted(set(chosen.car)))

    def missed(values: FloatArray) -> FloatArray:
        drivetrain = OneDrivetrain(names, float(values[0]), float(values[1]))
        logarithms: FloatArray = np.log(consumption_wh_km(energies, drivetrain) / measured)
        return logarithms

    bounds = ([0.5, 0.0], [1.0, 1.0])
    found = least_squares(missed, [0.9, 0.7], bounds=bounds, loss="soft_l1", f_scale=0.05).x
    return OneDrivetrain(names, float(found[0]), float(found[1]))


def compare_cars(tests: pd.DataFrame, drivetrain: OneDrivetrain) -> Outcome | None:
    """Compare the consumptions, on the cars that were not fitted and on all, None without a car."""
    if tests.empty:
        return None
    modelled = consumption_wh_km(wheel_energies_wh_km(tests), drivetrain)
    errors = 100.0 * (modelled / tests.consumption_wh_km - 1.0)
    tests = tests.assign(modelled=modelled, error=errors)
    others = tests[~tests.car.isin(drivetrain.fitted_on)]
    if others.empty:
        return None
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
