"""Voltage and temperature of the i3's pack for the measured current."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from studies.validation.circuit import Circuit, Samples, ambient_temperature_rate_k_s
from studies.validation.excerpts import Trip
from studies.validation.i3_drivetrain import durations_s
from studies.validation.i3_vehicle import SEASONS
from studies.validation.outcome import Comparison, Curve, Figure, Outcome, rms

from iptm_core.markdown import render_page
from iptm_core.physics.cell import ChargeTable
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

UNUSABLE = {
    "B02": "a step in the recording",
    "B13": "2.8 km long",
    "B34": "state of charge not recorded",
}
COOLED_FROM_K = 303.15
COOLING_W = 300.0
"""A pack this warm with an air conditioning this strong is cooled by refrigerant, which is not recorded."""


@dataclass(frozen=True)
class I3Pack:
    """Electrical and thermal parameters of the pack.

    Attributes:
        fitted_on: names of the trips.
        capacity_ah: charge per unit of the recorded state of charge.
        circuit: terminal voltage.
        heat_capacity_j_k: heat capacity as seen by the temperature sensors.
        exchange_w_k: heat exchange with the air.
        entropic_v_k: entropic coefficient of the pack, in the sign convention of eq. (8).
    """

    fitted_on: tuple[str, ...]
    capacity_ah: float
    circuit: Circuit
    heat_capacity_j_k: float
    exchange_w_k: float
    entropic_v_k: ChargeTable


def _drawn_ah(trip: Trip) -> FloatArray:
    drawn = np.cumsum(trip.current_a * durations_s(trip)) / 3600.0
    return np.concatenate([[0.0], drawn[:-1]])


def pack_samples(trip: Trip, capacity_ah: float) -> Samples:
    """Return current, voltage and temperature of a trip with the state of charge counted from its start."""
    known = trip.charge[np.isfinite(trip.charge)]
    charge = np.clip(known[0] - _drawn_ah(trip) / capacity_ah, 0.0, 1.0)
    lasting = durations_s(trip)
    return Samples(
        steps_s=np.concatenate([[0.0], lasting[:-1]]),
        current_a=trip.current_a,
        mean_current_a=np.concatenate([[trip.current_a[0]], trip.current_a[:-1]]),
        voltage_v=trip.voltage_v,
        temperature_k=trip.battery_temperature_k,
        charge=charge,
    )


def simulated_temperature_k(trip: Trip, pack: I3Pack) -> FloatArray:
    """Return the pack temperature from loss, entropic heat and exchange with the air."""
    samples = pack_samples(trip, pack.capacity_ah)
    heat = _loss_w(samples, pack.circuit)
    entropic = samples.current_a * pack.entropic_v_k.at(samples.charge)
    temperature, values = float(trip.battery_temperature_k[0]), []
    rows = np.column_stack([heat, entropic, trip.ambient_k, durations_s(trip)]).tolist()
    for loss, per_kelvin, ambient, step in rows:
        values.append(temperature)
        power = loss + per_kelvin * temperature
        rate = ambient_temperature_rate_k_s(
            power, temperature, ambient, pack.heat_capacity_j_k, pack.exchange_w_k
        )
        temperature += step * float(rate)
    return np.array(values)


def _loss_w(samples: Samples, circuit: Circuit) -> FloatArray:
    """Return the electrical loss of the circuit."""
    drop = circuit.open_circuit_v.at(samples.charge) - circuit.voltage_v(samples)
    return np.asarray(samples.current_a * drop, dtype=np.float64)


def is_cooled(trip: Trip) -> bool:
    """True where refrigerant takes heat out of the pack that no channel records."""
    warm = float(trip.battery_temperature_k.max()) >= COOLED_FROM_K
    return warm and float(trip.cooling_w.mean()) >= COOLING_W


LEAST_CHARGE = 0.2
VOLTAGE_BARS = {"summer": 0.4, "winter": 1.0}


def compare_pack(trips: tuple[Trip, ...], pack: I3Pack) -> Outcome:
    """Compare voltage and temperature on trips that were not fitted."""
    others = [t for t in trips if t.name not in pack.fitted_on and t.name not in UNUSABLE]
    others = [trip for trip in others if np.isfinite(trip.charge).mean() > 0.5]
    voltage_curves, figures, notes = [], [], []
    voltage_errors: dict[str, float] = {}
    for trip in others:
        samples = pack_samples(trip, pack.capacity_ah)
        modelled = pack.circuit.voltage_v(samples)
        counted = samples.charge > LEAST_CHARGE
        missed = 100.0 * (modelled / samples.voltage_v - 1.0)
        if counted.any():
            voltage_errors[trip.name] = rms(missed[counted])
            minutes = trip.time_s / 60.0
            voltage_curves.append(
                Curve(trip.name, voltage_errors[trip.name], minutes, samples.voltage_v, modelled)
            )
    for winter, season in SEASONS:
        chosen = [
            voltage_errors[trip.name]
            for trip in others
            if trip.is_winter == winter and trip.name in voltage_errors
        ]
        part = f"{len(chosen)} {season} trips, above 20 % state of charge"
        if chosen:
            figures.append(
                Figure("pack voltage, rms", part, rms(chosen), "%", None, VOLTAGE_BARS[season])
            )
    changes, temperature_curves = [], []
    for trip in others:
        if is_cooled(trip):
            notes.append(f"{trip.name}: warm pack, cooled by refrigerant; temperature not compared")
            continue
        modelled = simulated_temperature_k(trip, pack)
        measured = trip.battery_temperature_k
        change = float((modelled[-1] - modelled[0]) - (measured[-1] - measured[0]))
        changes.append(change)
        curve = Curve(
            trip.name,
            change,
            trip.time_s / 60.0,
            measured - CELSIUS_ZERO_K,
            modelled - CELSIUS_ZERO_K,
        )
        temperature_curves.append(curve)
    part = f"{len(changes)} trips"
    figures.append(Figure("pack temperature change, rms", part, rms(changes), "K", None, 0.7))
    cold, warm = (pack.circuit.ohmic.ohm(CELSIUS_ZERO_K + celsius, 0.6) for celsius in (0.0, 25.0))
    return Outcome(
        title="BMW i3: voltage and temperature of the pack",
        text=render_page(Path(__file__).parent, "i3_pack.md.j2", pack=pack, cold=cold, warm=warm),
        figures=tuple(figures),
        comparisons=(
            Comparison(
                "i3_pack_voltage",
                "Pack voltage",
                "time in min",
                "voltage in V",
                "rms in %",
                tuple(voltage_curves),
            ),
            Comparison(
                "i3_pack_temperature",
                "Pack temperature (recorded in steps of 1 K)",
                "time in min",
                "temperature in degC",
                "change missed in K",
                tuple(temperature_curves),
            ),
        ),
        notes=tuple(notes),
    )
