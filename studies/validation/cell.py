"""Voltage and case temperature of the Panasonic cell, fitted to US06 and pulses."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares, nnls
from studies.validation.circuit import REFERENCE_K, Circuit, Samples, Structure, fit_circuit
from studies.validation.measurements import CellTest
from studies.validation.outcome import Comparison, Curve, Figure, Outcome, rms

from iptm.parts import CELSIUS_ZERO_K, FloatArray, ambient_temperature_rate_k_s, render_page

CAPACITY_AH = 2.9
CUT_OFF_V = 2.6
"""Below it the tester ends or throttles the discharge: such samples count little in a fit."""
RESTED_WITHIN_K = 1.5
EVERY = 6
"""Stride of the samples of a fit."""
_ONE_BRANCH = Structure(
    ocv_charges=(
        *(0.0, 0.04, 0.06, 0.08, 0.1, 0.12, 0.15, 0.18, 0.22),
        *(0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
    ),
    resistance_charges=(0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0),
    ohmic_coefficient_1_k=0.05,
    relaxation_coefficient_1_k=0.06,
    time_constants_s=(100.0,),
    transfer_charges=(),
    exchange_current_a=1.0,
    exchange_coefficient_1_k=0.0,
    typical_ohm=0.02,
)
_TRANSFER = replace(_ONE_BRANCH, transfer_charges=(0.0, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0))
STRUCTURES = {
    "one RC branch": _ONE_BRANCH,
    "two RC branches": replace(_ONE_BRANCH, time_constants_s=(30.0, 300.0)),
    "two RC branches, charge transfer 0.06 per kelvin": replace(
        _TRANSFER,
        time_constants_s=(30.0, 300.0),
        exchange_current_a=0.7,
        exchange_coefficient_1_k=0.06,
    ),
    "one RC branch, charge transfer 0.15 per kelvin": replace(
        _TRANSFER,
        relaxation_coefficient_1_k=0.07,
        exchange_current_a=2.0,
        exchange_coefficient_1_k=0.15,
    ),
    "two RC branches, charge transfer 0.15 per kelvin": replace(
        _TRANSFER,
        relaxation_coefficient_1_k=0.07,
        time_constants_s=(30.0, 300.0),
        exchange_current_a=2.0,
        exchange_coefficient_1_k=0.15,
    ),
}
PULSE_SECONDS = (2.0, 10.0)
_SMALLEST_STEP_A = 2.0


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
    cold = max((REFERENCE_K - test.chamber_k) / 20.0, 0.0)
    near_empty = test.voltage_v < CUT_OFF_V
    return Samples(
        steps_s=np.diff(test.time_s, prepend=test.time_s[0]),
        current_a=test.current_a,
        mean_current_a=test.mean_current_a,
        voltage_v=test.voltage_v,
        temperature_k=test.case_temperature_k,
        charge=np.clip(1.0 - test.discharged_ah / CAPACITY_AH, 0.0, 1.0),
        weights=np.where(near_empty, 0.05, 1.0) / (1.0 + cold) ** 2,
    )


def simulated_temperature_k(test: CellTest, cell: PanasonicCell) -> FloatArray:
    """Return the case temperature for the measured current, from the first measured value on."""
    return _temperature(test, cell.circuit, cell.heat_capacity_j_k, cell.exchange_w_k)


def _temperature(
    test: CellTest, circuit: Circuit, heat_capacity_j_k: float, exchange_w_k: float
) -> FloatArray:
    samples = cell_samples(test)
    drop = circuit.open_circuit_v.at(samples.charge) - circuit.voltage_v(samples)
    heat = (samples.mean_current_a * drop).tolist()
    temperature, values = float(test.case_temperature_k[0]), []
    # A case that has rested shows the temperature of the chamber better than its nominal value.
    rested = abs(temperature - test.chamber_k) < RESTED_WITHIN_K
    ambient = temperature if rested else test.chamber_k
    for step, power in zip(samples.steps_s.tolist(), heat, strict=True):
        rate = ambient_temperature_rate_k_s(
            power, temperature, ambient, heat_capacity_j_k, exchange_w_k
        )
        temperature += min(step, 60.0) * float(rate)
        values.append(temperature)
    return np.array(values)


def pulse_resistances_ohm(test: CellTest) -> list[tuple[float, float]]:
    """Return state of charge and resistance of the discharge pulses, 2 to 10 s after their start."""
    found = []
    current = test.current_a
    starts = np.flatnonzero((current[1:] > _SMALLEST_STEP_A) & (np.abs(current[:-1]) < 0.05)) + 1
    for start in starts:
        within = test.time_s - test.time_s[start]
        rows = (within >= PULSE_SECONDS[0]) & (within <= PULSE_SECONDS[1])
        rows &= np.abs(current - current[start]) < 0.05 * current[start]
        if rows.any() and test.voltage_v[rows].min() > CUT_OFF_V:
            drop = test.voltage_v[start - 1] - float(np.mean(test.voltage_v[rows]))
            charge = 1.0 - test.discharged_ah[start] / CAPACITY_AH
            found.append((float(charge), float(drop / np.mean(current[rows]))))
    return found


def mean_pulse_resistance_ohm(test: CellTest) -> float:
    """Return the mean pulse resistance between 40 and 95 % state of charge, NaN without a pulse."""
    values = [ohm for charge, ohm in pulse_resistances_ohm(test) if 0.4 <= charge <= 0.95]
    return float(np.mean(values)) if values else float("nan")


def fit_pulse_law(points: Sequence[tuple[float, float]]) -> PulseLaw:
    """Fit the law to pairs of temperature (K) and resistance (ohm), by relative errors."""
    temperatures = np.array([point[0] for point in points])
    resistances = np.array([point[1] for point in points])
    best: tuple[float, PulseLaw] | None = None
    for coefficient in np.arange(0.01, 0.1201, 0.0005):
        growth = np.exp(-coefficient * (temperatures - REFERENCE_K))
        design = np.column_stack([np.ones_like(growth), growth]) / resistances[:, None]
        (offset, exponential), missed = nnls(design, np.ones_like(resistances))
        if best is None or missed < best[0]:
            best = (missed, PulseLaw(float(offset), float(exponential), float(coefficient)))
    assert best is not None  # noqa: S101  # the range of coefficients is not empty
    return best[1]


def cross_validated_structure(tests: Sequence[CellTest]) -> tuple[str, dict[str, float]]:
    """Choose the circuit that has the smallest error on tests that were left out of its fit, one at a time.

    Returns:
        Its name, and the error of each in V rms.
    """
    errors: dict[str, float] = {}
    for name, structure in STRUCTURES.items():
        squares = []
        for left_out in tests:
            others = [cell_samples(test) for test in tests if test is not left_out]
            circuit = fit_circuit(others, structure, EVERY)
            samples = cell_samples(left_out)
            counted = samples.voltage_v > CUT_OFF_V
            missed = circuit.voltage_v(samples) - samples.voltage_v
            squares.append(float(np.mean(missed[counted] ** 2)))
        errors[name] = float(np.sqrt(np.mean(squares)))
    return min(errors, key=lambda name: errors[name]), errors


def fit_cell(tests: Sequence[CellTest]) -> PanasonicCell:
    """Choose the circuit by cross-validation and fit it, the law of the pulses and the thermal parameters."""
    chosen = [test for test in tests if test.is_fitted]
    structure, _ = cross_validated_structure(chosen)
    circuit = fit_circuit([cell_samples(test) for test in chosen], STRUCTURES[structure], EVERY)
    driven = [test for test in chosen if not test.is_pulse_test]

    def missed(values: FloatArray) -> FloatArray:
        parts = [
            _temperature(test, circuit, 55.0 * values[0], 0.136 * values[1])[::EVERY]
            - test.case_temperature_k[::EVERY]
            for test in driven
        ]
        return np.concatenate(parts)

    thermal = least_squares(missed, np.ones(2), bounds=(0.2, 5.0), diff_step=1e-3).x
    pulses = [test for test in chosen if test.is_pulse_test]
    law = fit_pulse_law([(test.chamber_k, mean_pulse_resistance_ohm(test)) for test in pulses])
    names = tuple(sorted(test.name for test in chosen))
    capacity, exchange = float(55.0 * thermal[0]), float(0.136 * thermal[1])
    return PanasonicCell(names, structure, circuit, law, capacity, exchange)


LEAST_CHARGE = 0.2
VOLTAGE_BARS_MV = {25: 30.0, 10: 30.0, 0: 30.0, -10: 40.0, -20: 60.0}
WHOLE_BAR_MV = 35.0
CELSIUS_WITH_WHOLE_BAR = 25
LEAST_TEMPERATURES = 5


def compare_cell(tests: tuple[CellTest, ...], cell: PanasonicCell) -> Outcome | None:
    """Compare the cycles that were not fitted, None without one; pulses give the resistance law."""
    others = [test for test in tests if test.name not in cell.fitted_on and not test.is_pulse_test]
    pulses = [test for test in tests if test.is_pulse_test]
    if not others:
        return None
    above: dict[int, list[float]] = defaultdict(list)
    whole: dict[int, list[float]] = defaultdict(list)
    temperatures, voltage_curves, temperature_curves = [], [], []
    for test in others:
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
    ratios = [
        100.0 * (cell.pulse_law.ohm(test.chamber_k) / mean_pulse_resistance_ohm(test) - 1.0)
        for test in pulses
    ]
    if ratios:
        part = f"pulses at {len(ratios)} temperatures (fitted)"
        worst = float(np.max(np.abs(ratios)))
        figures.append(Figure("resistance law, largest error", part, worst, "%", None, 6.0))
    if len(pulses) >= LEAST_TEMPERATURES:
        errors = _left_out_percent(pulses)
        part = f"pulses at {len(errors)} inner temperatures, each left out of a fit"
        worst = float(np.max(np.abs(errors)))
        figures.append(Figure("resistance law, largest error", part, worst, "%", None, 6.0))
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


def _left_out_percent(pulses: list[CellTest]) -> list[float]:
    """Return the error of the resistance law at each inner temperature when it is not fitted to it."""
    points = sorted((test.chamber_k, mean_pulse_resistance_ohm(test)) for test in pulses)
    errors = []
    for left_out in points[1:-1]:
        law = fit_pulse_law([point for point in points if point != left_out])
        errors.append(100.0 * (law.ohm(left_out[0]) / left_out[1] - 1.0))
    return errors
