"""Voltage and case temperature of the Panasonic cell on cycles that it was not fitted to."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from studies.validation.circuit import REFERENCE_K, Circuit, Samples, ambient_temperature_rate_k_s
from studies.validation.excerpts import CellTest
from studies.validation.outcome import Comparison, Curve, Figure, Outcome, rms

from iptm_core.markdown import render_page
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

CAPACITY_AH = 2.9
RESTED_WITHIN_K = 1.5


@dataclass(frozen=True)
class PulseLaw:
    """Resistance of a pulse of the cell over temperature, ``offset + exponential exp(-k (T - 25 degC))``."""

    offset_ohm: float
    exponential_ohm: float
    coefficient_1_k: float

    def ohm(self, temperature_k: float) -> float:
        """Return the resistance at a temperature."""
        growth = np.exp(-self.coefficient_1_k * (temperature_k - REFERENCE_K))
        return float(self.offset_ohm + self.exponential_ohm * growth)


@dataclass(frozen=True)
class PanasonicCell:
    """Electrical and thermal parameters of the cell.

    Attributes:
        fitted_on: names of the tests.
        structure: which circuit cross-validation chose.
        circuit: terminal voltage.
        pulse_law: resistance of the pulses over temperature.
        heat_capacity_j_k: heat capacity.
        exchange_w_k: heat exchange with the chamber.
    """

    fitted_on: tuple[str, ...]
    structure: str
    circuit: Circuit
    pulse_law: PulseLaw
    heat_capacity_j_k: float
    exchange_w_k: float


def cell_samples(test: CellTest) -> Samples:
    """Return current, voltage, temperature and state of charge of a test."""
    return Samples(
        steps_s=np.diff(test.time_s, prepend=test.time_s[0]),
        current_a=test.current_a,
        mean_current_a=test.mean_current_a,
        voltage_v=test.voltage_v,
        temperature_k=test.case_temperature_k,
        charge=np.clip(1.0 - test.discharged_ah / CAPACITY_AH, 0.0, 1.0),
    )


def simulated_temperature_k(test: CellTest, cell: PanasonicCell) -> FloatArray:
    """Return the case temperature for the measured current, from the first measured value on."""
    samples = cell_samples(test)
    drop = cell.circuit.open_circuit_v.at(samples.charge) - cell.circuit.voltage_v(samples)
    heat = (samples.mean_current_a * drop).tolist()
    temperature, values = float(test.case_temperature_k[0]), []
    # A case that has rested shows the temperature of the chamber better than its nominal value.
    rested = abs(temperature - test.chamber_k) < RESTED_WITHIN_K
    ambient = temperature if rested else test.chamber_k
    for step, power in zip(samples.steps_s.tolist(), heat, strict=True):
        rate = ambient_temperature_rate_k_s(
            power, temperature, ambient, cell.heat_capacity_j_k, cell.exchange_w_k
        )
        temperature += min(step, 60.0) * float(rate)
        values.append(temperature)
    return np.array(values)


LEAST_CHARGE = 0.2
VOLTAGE_BARS_MV = {25: 30.0, 10: 30.0, 0: 30.0, -10: 40.0, -20: 60.0}
WHOLE_BAR_MV = 35.0
CELSIUS_WITH_WHOLE_BAR = 25


def compare_cell(tests: Sequence[CellTest], cell: PanasonicCell) -> Outcome:
    """Compare the cycles that were not fitted."""
    above: dict[int, list[float]] = defaultdict(list)
    whole: dict[int, list[float]] = defaultdict(list)
    temperatures, voltage_curves, temperature_curves = [], [], []
    for test in tests:
        samples = cell_samples(test)
        modelled = cell.circuit.voltage_v(samples)
        missed_mv = 1000.0 * (modelled - samples.voltage_v)
        celsius = round(test.chamber_k - CELSIUS_ZERO_K)
        whole[celsius].append(rms(missed_mv))
        above[celsius].append(rms(missed_mv[samples.charge > LEAST_CHARGE]))
        hours = test.time_s / 3600.0
        curve = Curve(test.name, whole[celsius][-1], hours, samples.voltage_v, modelled)
        voltage_curves.append(curve)
        case = simulated_temperature_k(test, cell)
        temperatures.append(rms(case - test.case_temperature_k))
        measured = test.case_temperature_k - CELSIUS_ZERO_K
        temperature_curves.append(
            Curve(test.name, temperatures[-1], hours, measured, case - CELSIUS_ZERO_K)
        )
    figures = []
    for celsius in sorted(above, reverse=True):
        part = f"{len(above[celsius])} cycles at {celsius} degC"
        bar = VOLTAGE_BARS_MV.get(celsius)
        whole_bar = WHOLE_BAR_MV if celsius == CELSIUS_WITH_WHOLE_BAR else None
        figures += [
            Figure(
                "cell voltage, rms above 20 % charge", part, rms(above[celsius]), "mV", None, bar
            ),
            Figure("cell voltage, rms", part, rms(whole[celsius]), "mV", None, whole_bar),
        ]
    part = f"{len(temperatures)} cycles"
    figures.append(Figure("case temperature, rms", part, rms(temperatures), "K", None, 0.6))
    ratio = cell.pulse_law.ohm(CELSIUS_ZERO_K) / cell.pulse_law.ohm(CELSIUS_ZERO_K + 25.0)
    return Outcome(
        title="Panasonic NCR18650PF: voltage and case temperature",
        text=render_page(
            Path(__file__).parent, "cell.md.j2", cell=cell, law=cell.pulse_law, ratio=ratio
        ),
        figures=tuple(figures),
        comparisons=(
            Comparison(
                "panasonic_voltage",
                "Cell voltage on cycles that were not fitted",
                "time in h",
                "voltage in V",
                "rms in mV",
                tuple(voltage_curves),
            ),
            Comparison(
                "panasonic_temperature",
                "Case temperature on cycles that were not fitted",
                "time in h",
                "temperature in degC",
                "rms in K",
                tuple(temperature_curves),
            ),
        ),
    )
