"""The Panasonic cell: voltage, case temperature, and the law of its resistance."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from iptm_core.markdown import render_page
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_validation.measurements import CellTest
from iptm_validation.models.panasonic_cell import (
    PanasonicCell,
    cell_samples,
    fit_pulse_law,
    mean_pulse_resistance_ohm,
    simulated_temperature_k,
)
from iptm_validation.outcome import Comparison, Curve, Figure, Outcome, rms

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
        key="panasonic",
        title="Panasonic NCR18650PF: voltage and case temperature",
        text=render_page(__package__, "cell.md.j2", cell=cell, law=cell.pulse_law, ratio=ratio),
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
