"""The i3: battery energy from torque, and from speed and elevation."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

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
from iptm_validation.outcome import Comparison, Curve, Figure, Outcome, mean, median_magnitude, rms

KJ_PER_KWH = 3600.0
SEASONS = ((False, "summer"), (True, "winter"))
ENERGY_BARS = {"summer": 4.0, "winter": 1.5}
SPEED_MEDIAN_BARS = {"summer": 5.0, "winter": 4.0}
SPEED_RMS_BARS = {"summer": 6.0, "winter": 5.0}
ZETA = 0.3


def _energy_errors_percent(
    trips: Iterable[Trip], power: Callable[[Trip], FloatArray]
) -> dict[str, float]:
    errors = {}
    for trip in trips:
        lasting = durations_s(trip)
        measured = float(trip.battery_power_w @ lasting)
        errors[trip.name] = 100.0 * (float(power(trip) @ lasting) / measured - 1.0)
    return errors


def _energy_curves(
    trips: list[Trip], power: Callable[[Trip], FloatArray], errors: dict[str, float]
) -> tuple[Curve, ...]:
    curves = []
    for trip in trips:
        lasting = durations_s(trip)
        kwh = np.cumsum(np.column_stack([trip.battery_power_w, power(trip)]) * lasting[:, None], 0)
        kwh = kwh / (1000.0 * KJ_PER_KWH)
        minutes = trip.time_s / 60.0
        curves.append(Curve(trip.name, errors[trip.name], minutes, kwh[:, 0], kwh[:, 1]))
    return tuple(curves)


def _total_percent(trips: list[Trip], power: Callable[[Trip], FloatArray]) -> float:
    modelled = sum(float(power(trip) @ durations_s(trip)) for trip in trips)
    measured = sum(float(trip.battery_power_w @ durations_s(trip)) for trip in trips)
    return 100.0 * (modelled / measured - 1.0) if measured else float("nan")


def _recovered_percent(trips: list[Trip], power: Callable[[Trip], FloatArray]) -> float:
    modelled = sum(recovered_j(power(trip), durations_s(trip)) for trip in trips)
    measured = sum(recovered_j(trip.battery_power_w, durations_s(trip)) for trip in trips)
    return 100.0 * (modelled / measured - 1.0) if measured else float("nan")


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

    def from_torque(trip: Trip) -> FloatArray:
        return drivetrain.power_w(trip.speed_m_s, trip.motor_torque_nm) + consumers_w(trip)

    by_speed = {trip.name: battery_power_w(Road.of(trip), vehicle, drivetrain) for trip in sound}

    def from_speed(trip: Trip) -> FloatArray:
        return by_speed[trip.name]

    torque_errors = _energy_errors_percent(sound, from_torque)
    speed_errors = _energy_errors_percent(sound, from_speed)
    figures = []
    for winter, season in SEASONS:
        chosen = [trip for trip in sound if trip.is_winter == winter]
        if not chosen:
            continue
        part = f"{len(chosen)} {season} trips"
        torque = [torque_errors[trip.name] for trip in chosen]
        speed = [speed_errors[trip.name] for trip in chosen]
        figures += [
            Figure("energy from torque, rms", part, rms(torque), "%", None, ENERGY_BARS[season]),
            Figure(
                "energy from speed, median magnitude",
                part,
                median_magnitude(speed),
                "%",
                None,
                SPEED_MEDIAN_BARS[season],
            ),
            Figure("energy from speed, rms", part, rms(speed), "%", None, SPEED_RMS_BARS[season]),
            Figure("energy from speed, mean", part, mean(speed), "%", -3.0, 3.0),
        ]
    part = f"{len(sound)} trips"
    figures += [
        Figure("energy from torque, total", part, _total_percent(sound, from_torque), "%", -1, 1),
        Figure(
            "recovered energy from torque, total",
            part,
            _recovered_percent(sound, from_torque),
            "%",
            -7.0,
            7.0,
        ),
        Figure(
            "recovered energy from speed, total",
            part,
            _recovered_percent(sound, from_speed),
            "%",
            -7.0,
            7.0,
        ),
        *_braking_power(sound, drivetrain, vehicle, from_speed),
    ]
    return Outcome(
        key="i3_energy",
        title="BMW i3: battery energy of a trip",
        text=render_page(__package__, "i3_energy.md.j2", drivetrain=drivetrain, vehicle=vehicle),
        figures=tuple(figures),
        comparisons=(
            Comparison(
                "i3_energy_from_torque",
                "Battery energy from the measured motor torque",
                "time in min",
                "energy in kWh",
                "error in %",
                _energy_curves(sound, from_torque, torque_errors),
            ),
            Comparison(
                "i3_energy_from_speed",
                "Battery energy from speed and elevation",
                "time in min",
                "energy in kWh",
                "error in %",
                _energy_curves(sound, from_speed, speed_errors),
            ),
        ),
        notes=tuple(f"{name}: {why}" for name, why in objections.items() if why is not None),
    )


def _braking_power(
    trips: list[Trip],
    drivetrain: I3Drivetrain,
    vehicle: I3Vehicle,
    from_speed: Callable[[Trip], FloatArray],
) -> list[Figure]:
    """Compare zeta of eq. (4), the best constant and the limits by the battery power in braking."""
    measured, limited, wheel = [], [], []
    for trip in trips:
        road = Road.of(trip)
        braking = (trip.motor_torque_nm < -5.0) & (trip.speed_m_s > 1.0)
        rest = road.consumers_w + drivetrain.auxiliary_power_w
        measured.append((trip.battery_power_w - rest)[braking])
        limited.append((from_speed(trip) - rest)[braking])
        inertia = vehicle.mass_kg * road.acceleration_m_s2 * road.speed_m_s
        wheel.append(np.minimum(inertia, 0.0)[braking])
    battery, bound, kinetic = map(np.concatenate, (measured, limited, wheel))
    constant = float(battery @ kinetic / (kinetic @ kinetic))
    part = f"{len(trips)} trips, braking"
    return [
        Figure(
            f"battery power, zeta = {ZETA}, rms", part, rms(battery - ZETA * kinetic) / 1e3, "kW"
        ),
        Figure(
            f"battery power, best constant {constant:.2f}, rms",
            part,
            rms(battery - constant * kinetic) / 1e3,
            "kW",
        ),
        Figure(
            "battery power, limits of regeneration, rms", part, rms(battery - bound) / 1e3, "kW"
        ),
    ]
