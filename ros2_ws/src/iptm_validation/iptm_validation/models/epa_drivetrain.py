"""Consumption of many electric cars on the dynamometer, from their road load with one drivetrain for all."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from iptm_core.physics.traction import coast_down_force_n
from iptm_core.routes.cycles import load_cycle
from iptm_core.state import FloatArray
from iptm_validation.measurements import DynamometerTest, held_out

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
