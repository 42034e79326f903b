"""Battery energy of the i3 from speed and elevation alone: road load, warm-up, and limits of regeneration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from studies.validation.excerpts import Trip
from studies.validation.i3_drivetrain import (
    I3Drivetrain,
    consumers_w,
    durations_s,
    motor_speed_rad_s,
    objection_to,
)
from studies.validation.outcome import Comparison, Curve, Figure, Outcome, rms

from iptm_core.markdown import render_page
from iptm_core.parameters.model import BodyParameters, RegenerationParameters
from iptm_core.physics.powertrain import (
    motor_torque_nm,
    regenerative_torque_nm,
    traction_force_n,
)
from iptm_core.state import FloatArray
from iptm_core.units import J_PER_KWH

GRAVITY_M_S2 = 9.81
FRONTAL_AREA_M2 = 2.38
INERTIA_FACTOR = 1.03
REGENERATION = RegenerationParameters(
    torque_nm=84.0,
    power_w=51.0e3,
    blend_start_m_s=3.0 / 3.6,
    blend_end_m_s=8.0 / 3.6,
    deceleration_m_s2=2.0,
    decline_s2_m=0.5,
)
"""Read off the measured torque of the fitted trips: its lower bound, the bound of torque times speed, and
the share of the demanded torque over speed and deceleration."""
SMOOTHING_M = 400.0
_ROAD_STEP_M = 20.0


@dataclass(frozen=True)
class I3Vehicle:
    """Longitudinal parameters of the i3.

    Attributes:
        fitted_on: names of the trips.
        mass_kg: mass with driver, passengers and equipment.
        drag_coefficient: c_w with a frontal area of 2.38 m^2.
        driveline_efficiency: eta_t of eq. (3), with the tyre slip that it has to stand for.
        rolling_summer: rolling resistance coefficient, warm, summer trips.
        rolling_winter: the same of winter trips (winter tyres, wet roads).
        cold_force_summer_n: additional rolling force of a car that was parked for long, summer.
        cold_force_winter_n: the same in winter.
        warm_up_s: time constant with which it decays.
        parked_k: difference of heat exchanger and ambient temperature at the start at which the car counts as
            cold only to 1/e.
    """

    fitted_on: tuple[str, ...]
    mass_kg: float
    drag_coefficient: float
    driveline_efficiency: float
    rolling_summer: float
    rolling_winter: float
    cold_force_summer_n: float
    cold_force_winter_n: float
    warm_up_s: float
    parked_k: float


@dataclass(frozen=True, eq=False)
class Road:
    """Input of the model from a trip: motion, slope and consumers; arrays of shape (n,)."""

    speed_m_s: FloatArray
    acceleration_m_s2: FloatArray
    slope_rad: FloatArray
    driven_s: FloatArray
    consumers_w: FloatArray
    durations_s: FloatArray
    air_density_kg_m3: float
    parked_difference_k: float
    is_winter: bool

    @classmethod
    def of(cls, trip: Trip) -> Road:
        """Derive it from the recorded speed, elevation, temperatures and consumers of a trip."""
        ambient_k = float(np.mean(trip.ambient_k))
        height_m = float(np.mean(trip.elevation_m))
        pressure_pa = 101325.0 * np.exp(-height_m / 8400.0)
        difference = trip.heat_exchanger_k[:5] - trip.ambient_k[:5]
        return cls(
            speed_m_s=trip.speed_m_s,
            acceleration_m_s2=np.gradient(trip.speed_m_s, trip.time_s),
            slope_rad=road_slope_rad(trip),
            driven_s=trip.time_s,
            consumers_w=consumers_w(trip),
            durations_s=durations_s(trip),
            air_density_kg_m3=float(pressure_pa / (287.05 * ambient_k)),
            parked_difference_k=float(np.nan_to_num(np.mean(difference))),
            is_winter=trip.is_winter,
        )


def road_slope_rad(trip: Trip) -> FloatArray:
    """Return the slope of the elevation, smoothed over 400 m to either side with a Hann window."""
    means = 0.5 * (trip.speed_m_s[1:] + trip.speed_m_s[:-1])
    travelled = np.concatenate([[0.0], np.cumsum(means * np.diff(trip.time_s))])
    grid = np.arange(0.0, travelled[-1] + _ROAD_STEP_M, _ROAD_STEP_M)
    if len(grid) < 3:
        return np.zeros(len(travelled))
    # Standing adds a hair of distance, so that the abscissa increases.
    heights = np.interp(grid, travelled + 1e-9 * np.arange(len(travelled)), trip.elevation_m)
    half = int(SMOOTHING_M / _ROAD_STEP_M)
    kernel = np.hanning(2 * half + 1)
    padded = np.pad(heights, half, mode="edge")
    smooth = np.convolve(padded, kernel / kernel.sum(), mode="valid")
    slope = np.arctan(np.gradient(smooth, _ROAD_STEP_M))
    return np.asarray(np.interp(travelled, grid, slope), dtype=np.float64)


def motor_torque_at_nm(road: Road, vehicle: I3Vehicle, drivetrain: I3Drivetrain) -> FloatArray:
    """Return the motor torque by eqs. (2) and (3), warm-up and the limits of regeneration."""
    body = BodyParameters(
        mass_kg=vehicle.mass_kg,
        gravity_m_s2=GRAVITY_M_S2,
        rolling_resistance=vehicle.rolling_winter if road.is_winter else vehicle.rolling_summer,
        drag_coefficient=vehicle.drag_coefficient,
        frontal_area_m2=FRONTAL_AREA_M2,
        air_density_kg_m3=road.air_density_kg_m3,
        rotational_inertia_factor=INERTIA_FACTOR,
    )
    speed = road.speed_m_s
    force = traction_force_n(speed, road.acceleration_m_s2, road.slope_rad, body)
    cold_n = vehicle.cold_force_winter_n if road.is_winter else vehicle.cold_force_summer_n
    coldness = np.exp(-abs(road.parked_difference_k) / vehicle.parked_k)
    # Cold tyres, bearings and gear oil.
    force = force + cold_n * coldness * np.exp(-road.driven_s / vehicle.warm_up_s)
    powertrain = drivetrain.powertrain(vehicle.driveline_efficiency)
    demanded = np.where(speed > 0.1, motor_torque_nm(force, powertrain), 0.0)
    motor_speed = motor_speed_rad_s(speed)
    torque = regenerative_torque_nm(
        demanded, motor_speed, speed, road.acceleration_m_s2, REGENERATION
    )
    return np.asarray(torque, dtype=np.float64)


def battery_power_w(road: Road, vehicle: I3Vehicle, drivetrain: I3Drivetrain) -> FloatArray:
    """Return the battery power that the model has for the motion of a trip."""
    torque = motor_torque_at_nm(road, vehicle, drivetrain)
    return drivetrain.power_w(road.speed_m_s, torque) + road.consumers_w


def recovered_j(power_w: FloatArray, durations: FloatArray) -> float:
    """Return the energy that flows into the battery, positive."""
    return float(-np.minimum(power_w, 0.0) @ durations)


SEASONS = ((False, "summer"), (True, "winter"))
ENERGY_BARS = {"summer": 4.0, "winter": 1.5}
SPEED_MEDIAN_BARS = {"summer": 5.0, "winter": 4.0}
SPEED_RMS_BARS = {"summer": 6.0, "winter": 5.0}
ZETA = 0.3


def compare_energy(
    trips: tuple[Trip, ...], drivetrain: I3Drivetrain, vehicle: I3Vehicle
) -> Outcome:
    """Compare battery energies on the trips that were fitted to neither model."""
    fitted = set(drivetrain.fitted_on) | set(vehicle.fitted_on)
    others = [trip for trip in trips if trip.name not in fitted]
    objections = {trip.name: objection_to(trip, drivetrain) for trip in others}
    sound = [trip for trip in others if objections[trip.name] is None]
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
        title="BMW i3: battery energy of a trip",
        text=render_page(
            Path(__file__).parent, "i3_energy.md.j2", drivetrain=drivetrain, vehicle=vehicle
        ),
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
