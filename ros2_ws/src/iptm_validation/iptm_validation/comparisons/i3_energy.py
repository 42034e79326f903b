"""The i3: battery energy from torque, and from speed and elevation."""

from __future__ import annotations

import numpy as np
import pandas as pd

from iptm_core.markdown import render_page
from iptm_core.state import FloatArray
from iptm_validation.measurements import Trip
from iptm_validation.models.i3_drivetrain import (
    I3Drivetrain,
    consumers_w,
    durations_s,
    objection_to,
)
from iptm_validation.models.i3_vehicle import I3Vehicle, Road, battery_power_w, recovered_j
from iptm_validation.outcome import Comparison, Curve, Figure, Outcome, rms

J_PER_KWH = 3.6e6
SEASONS = ((False, "summer"), (True, "winter"))
ENERGY_BARS = {"summer": 4.0, "winter": 1.5}
SPEED_MEDIAN_BARS = {"summer": 5.0, "winter": 4.0}
SPEED_RMS_BARS = {"summer": 6.0, "winter": 5.0}
ZETA = 0.3


def compare_energy(
    trips: tuple[Trip, ...], drivetrain: I3Drivetrain, vehicle: I3Vehicle
) -> Outcome | None:
    """Compare battery energies on the trips that were fitted to neither model, None without such trips."""
    fitted = set(drivetrain.fitted_on) | set(vehicle.fitted_on)
    others = [trip for trip in trips if trip.name not in fitted]
    objections = {trip.name: objection_to(trip, drivetrain) for trip in others}
    sound = [trip for trip in others if objections[trip.name] is None]
    if not sound:
        return None
    powers = [
        {
            "measured": trip.battery_power_w,
            "torque": drivetrain.power_w(trip.speed_m_s, trip.motor_torque_nm) + consumers_w(trip),
            "speed": battery_power_w(Road.of(trip), vehicle, drivetrain),
        }
        for trip in sound
    ]
    lasting = [durations_s(trip) for trip in sound]
    driven = list(zip(powers, lasting, strict=True))
    energies = pd.DataFrame({name: power @ s for name, power in by.items()} for by, s in driven)
    back = pd.DataFrame(
        {name: recovered_j(power, s) for name, power in by.items()} for by, s in driven
    )
    errors = 100.0 * (energies.div(energies.measured, axis=0) - 1.0)
    figures = _season_figures(sound, errors)
    part = f"{len(sound)} trips"
    for quantity, of, sums, bar in (
        ("energy from torque, total", "torque", energies.sum(), 1.0),
        ("recovered energy from torque, total", "torque", back.sum(), 7.0),
        ("recovered energy from speed, total", "speed", back.sum(), 7.0),
    ):
        error = 100.0 * (sums[of] / sums.measured - 1.0) if sums.measured else float("nan")
        figures.append(Figure(quantity, part, error, "%", -bar, bar))
    figures += _braking_power(sound, drivetrain, vehicle, [by["speed"] for by in powers])
    return Outcome(
        key="i3_energy",
        title="BMW i3: battery energy of a trip",
        text=render_page(__package__, "i3_energy.md.j2", drivetrain=drivetrain, vehicle=vehicle),
        figures=tuple(figures),
        comparisons=tuple(
            Comparison(
                f"i3_energy_from_{of}",
                f"Battery energy from {inputs}",
                "time in min",
                "energy in kWh",
                "error in %",
                tuple(
                    Curve(
                        trip.name,
                        error,
                        trip.time_s / 60.0,
                        *(np.cumsum(by[each] * s) / J_PER_KWH for each in ("measured", of)),
                    )
                    for trip, error, (by, s) in zip(sound, errors[of], driven, strict=True)
                ),
            )
            for of, inputs in (
                ("torque", "the measured motor torque"),
                ("speed", "speed and elevation"),
            )
        ),
        notes=tuple(f"{name}: {why}" for name, why in objections.items() if why is not None),
    )


def _season_figures(trips: list[Trip], errors: pd.DataFrame) -> list[Figure]:
    figures = []
    for winter, season in SEASONS:
        chosen = errors[[trip.is_winter == winter for trip in trips]]
        if chosen.empty:
            continue
        part = f"{len(chosen)} {season} trips"
        for quantity, value, bar in (
            ("energy from torque, rms", rms(chosen.torque), ENERGY_BARS[season]),
            (
                "energy from speed, median magnitude",
                float(chosen.speed.abs().median()),
                SPEED_MEDIAN_BARS[season],
            ),
            ("energy from speed, rms", rms(chosen.speed), SPEED_RMS_BARS[season]),
        ):
            figures.append(Figure(quantity, part, value, "%", None, bar))
        figures.append(
            Figure("energy from speed, mean", part, float(chosen.speed.mean()), "%", -3.0, 3.0)
        )
    return figures


def _braking_power(
    trips: list[Trip], drivetrain: I3Drivetrain, vehicle: I3Vehicle, powers_w: list[FloatArray]
) -> list[Figure]:
    """Compare zeta of eq. (4), the best constant and the limits by the battery power in braking."""
    parts = []
    for trip, power_w in zip(trips, powers_w, strict=True):
        road = Road.of(trip)
        braking = (trip.motor_torque_nm < -5.0) & (trip.speed_m_s > 1.0)
        rest = road.consumers_w + drivetrain.auxiliary_power_w
        inertia = vehicle.mass_kg * road.acceleration_m_s2 * road.speed_m_s
        columns = (trip.battery_power_w - rest, power_w - rest, np.minimum(inertia, 0.0))
        parts.append(np.array(columns)[:, braking])
    battery, bound, kinetic = np.concatenate(parts, axis=1)
    constant = float(battery @ kinetic / (kinetic @ kinetic))
    return [
        Figure(
            f"battery power, {model}, rms", f"{len(trips)} trips, braking", rms(missed) / 1e3, "kW"
        )
        for model, missed in (
            (f"zeta = {ZETA}", battery - ZETA * kinetic),
            (f"best constant {constant:.2f}", battery - constant * kinetic),
            ("limits of regeneration", battery - bound),
        )
    ]
