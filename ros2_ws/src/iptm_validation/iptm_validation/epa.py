"""Consumption of many electric cars on the dynamometer, from their road load with one drivetrain for all."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from iptm_core.markdown import render_page
from iptm_core.physics.traction import coast_down_force_n
from iptm_core.routes.cycles import load_cycle
from iptm_core.state import FloatArray
from iptm_validation.measurements import DynamometerTest, held_out
from iptm_validation.outcome import Comparison, Curve, Figure, Outcome

AUXILIARY_POWER_W = 200.0
CHARGING_EFFICIENCY = 0.88
"""From the grid into the battery and out again; not separable from the drivetrain."""
INERTIA_FACTOR = 1.015
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


def wheel_energies_wh_km(test: DynamometerTest) -> FloatArray:
    """Return driving energy, braking energy (negative) and auxiliary energy per distance."""
    cycle = load_cycle(test.cycle)
    times = np.arange(cycle.times_s[0], cycle.times_s[-1] + 0.5, 1.0)
    speed = np.interp(times, cycle.times_s, cycle.speeds_m_s)
    acceleration = np.gradient(speed, times)
    load = coast_down_force_n(speed, test.constant_n, test.linear_n_s_m, test.quadratic_n_s2_m2)
    force = np.where(speed > 0.05, load, 0.0) + INERTIA_FACTOR * test.mass_kg * acceleration
    power = force * speed
    low, high = BLEND_M_S
    blend = np.clip((speed - low) / (high - low), 0.0, 1.0)
    energies = np.array(
        [
            np.maximum(power, 0.0).sum(),
            (blend * np.minimum(power, 0.0)).sum(),
            AUXILIARY_POWER_W * len(times),
        ]
    )
    # Joules per metre of one-second sums are watt-hours per kilometre times 3.6.
    per_distance: FloatArray = energies / speed.sum() / 3.6
    return per_distance


def consumption_wh_km(energies: FloatArray, drivetrain: OneDrivetrain) -> float:
    """Return the energy from the grid per distance."""
    drive, brake, auxiliary = energies
    battery = drive / drivetrain.driving_efficiency + brake * drivetrain.recovered_share + auxiliary
    return float(battery / CHARGING_EFFICIENCY)


def fit_one_drivetrain(tests: Sequence[DynamometerTest]) -> OneDrivetrain:
    """Fit the two efficiencies on two thirds of the cars, by relative errors."""
    kept_back = held_out([test.car for test in tests])
    chosen = [test for test in tests if test.car not in kept_back]
    energies = [wheel_energies_wh_km(test) for test in chosen]
    names = tuple(sorted({test.car for test in chosen}))

    def missed(values: FloatArray) -> FloatArray:
        drivetrain = OneDrivetrain(names, float(values[0]), float(values[1]))
        ratios = [
            consumption_wh_km(energy, drivetrain) / test.consumption_wh_km
            for energy, test in zip(energies, chosen, strict=True)
        ]
        return np.log(ratios)

    bounds = ([0.5, 0.0], [1.0, 1.0])
    found = least_squares(missed, [0.9, 0.7], bounds=bounds, loss="soft_l1", f_scale=0.05).x
    return OneDrivetrain(names, float(found[0]), float(found[1]))


def within_make(errors: Sequence[float], makes: Sequence[str]) -> float:
    """Return the standard deviation around the means of the makes, corrected for their number."""
    groups: dict[str, list[float]] = defaultdict(list)
    for error, make in zip(errors, makes, strict=True):
        groups[make].append(error)
    squares = sum(float(np.sum((np.array(g) - np.mean(g)) ** 2)) for g in groups.values())
    freedom = len(errors) - len(groups)
    return float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")


def compare_cars(tests: tuple[DynamometerTest, ...], drivetrain: OneDrivetrain) -> Outcome | None:
    """Compare the consumptions, on the cars that were not fitted and on all, None without a car."""
    others = [test for test in tests if test.car not in drivetrain.fitted_on]
    if not others:
        return None
    figures = []
    curves = []
    for part, chosen in (("cars not fitted", others), ("all cars", list(tests))):
        modelled = [consumption_wh_km(wheel_energies_wh_km(test), drivetrain) for test in chosen]
        errors = [
            100.0 * (model / test.consumption_wh_km - 1.0)
            for model, test in zip(modelled, chosen, strict=True)
        ]
        within = within_make(errors, [test.make for test in chosen])
        label = f"{part}, {len(chosen)} tests"
        figures += [
            Figure("consumption, mean", label, float(np.mean(errors)), "%", -2.0, 2.0),
            Figure("consumption, deviation", label, float(np.std(errors, ddof=1)), "%", None, 9.5),
        ]
        if np.isfinite(within):
            figures.append(Figure("consumption, within a make", label, within, "%", None, 5.0))
        if part == "cars not fitted":
            order = np.argsort([test.consumption_wh_km for test in chosen])
            curves.append(
                Curve(
                    label,
                    float(np.mean(errors)),
                    np.arange(1.0, len(order) + 1.0, dtype=np.float64),
                    np.array([test.consumption_wh_km for test in chosen])[order] / 10.0,
                    np.array(modelled)[order] / 10.0,
                )
            )
    return Outcome(
        title="EPA: consumption of electric cars on the dynamometer",
        text=render_page("iptm_validation", "cars.md.j2", drivetrain=drivetrain),
        figures=tuple(figures),
        comparisons=(
            Comparison(
                "epa_consumption",
                "Consumption from the grid on UDDS and HWFET",
                "test, in the order of consumption",
                "kWh/100 km",
                "mean error in %",
                tuple(curves),
            ),
        ),
    )
