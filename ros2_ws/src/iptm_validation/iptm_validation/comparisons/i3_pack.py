"""The i3: voltage and temperature of the pack."""

from __future__ import annotations

import numpy as np

from iptm_core.markdown import render_page
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_validation.comparisons.i3_energy import SEASONS
from iptm_validation.measurements import Trip
from iptm_validation.models import i3_pack
from iptm_validation.models.i3_pack import I3Pack
from iptm_validation.outcome import Comparison, Curve, Figure, Outcome, rms

LEAST_CHARGE = 0.2
VOLTAGE_BARS = {"summer": 0.4, "winter": 1.0}


def compare_pack(trips: tuple[Trip, ...], pack: I3Pack) -> Outcome | None:
    """Compare voltage and temperature on trips that were not fitted, None without one."""
    others = [t for t in trips if t.name not in pack.fitted_on and t.name not in i3_pack.UNUSABLE]
    others = [trip for trip in others if np.isfinite(trip.charge).mean() > 0.5]
    if not others:
        return None
    voltage_curves, figures, notes = [], [], []
    voltage_errors: dict[str, float] = {}
    for trip in others:
        samples = i3_pack.pack_samples(trip, pack.capacity_ah)
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
        if i3_pack.is_cooled(trip):
            notes.append(f"{trip.name}: warm pack, cooled by refrigerant; temperature not compared")
            continue
        modelled = i3_pack.simulated_temperature_k(trip, pack)
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
        key="i3_pack",
        title="BMW i3: voltage and temperature of the pack",
        text=render_page(__package__, "i3_pack.md.j2", pack=pack, cold=cold, warm=warm),
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
