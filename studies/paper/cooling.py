"""When cooling pays: on the trips of the sets, and by the printed numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from studies.paper import equations, statements, tables, trips
from studies.paper.equations import Array

import iptm

TRIP_S, HORIZON_S = 1e4, 15.0
REFERENCE_K = 299.15
"""r_T, 26 degC (Section IV-A)."""
LARGEST_VICE_RATIO_J = 5e12
"""Section IV-C.1: largest lambda_Q / lambda_P of the vice benchmark."""
PERCENTILES = (10.0, 90.0)
STEP_W, STEP_K, STEP_A = 10.0, 0.1, 1e-3


def table() -> str:
    """Cooling worked out from Tables I, II and IV; nothing in it is identified.

    The ratio of both cells' degradations gives, by the ageing law, how much warmer cell N is; the coolant
    warms up by as much along the channel, which is the heat that it carries.
    """
    p, printed = (
        iptm.load_parameters(trips.VEHICLE).values,
        statements.printed_table().loc[tables.REFERENCE],
    )
    loss = p.aging.initial_capacity_loss
    power_w = 1e3 * printed.total_energy_printed / TRIP_S
    per_watt = 1.0 / (p.pack.open_circuit_voltage_v * p.pack.parallel)
    current = power_w * per_watt

    def log_rate(current_a: float, kelvin: float) -> float:
        return float(np.log(equations.loss_rate_1_s(current_a, kelvin, loss, p)))

    def per_ampere(kelvin: float) -> float:
        return (log_rate(current + STEP_A, kelvin) - log_rate(current, kelvin)) / STEP_A

    per_kelvin = (log_rate(current, REFERENCE_K + STEP_K) - log_rate(current, REFERENCE_K)) / STEP_K
    warmer_k = float(np.log(printed.cell_n_degradation / printed.cell_1_degradation)) / per_kelvin
    heat_w = p.cooling.coolant_mass_flow_kg_s * p.cooling.coolant_specific_heat_j_kg_k * warmer_k
    compressor_w = 1e3 * printed.cooling_energy / TRIP_S - p.cooling.auxiliary_power_w
    cop = heat_w / compressor_w
    pays_s = p.pack_heat_capacity_j_k * per_ampere(REFERENCE_K) * per_watt / (cop * per_kelvin)
    limit_k = p.limits.max_temperature_k
    refund = (
        LARGEST_VICE_RATIO_J
        * 2.0
        * np.exp(log_rate(current, limit_k))
        * per_ampere(limit_k)
        * per_watt
    )
    rows = [
        [
            "cell N warmer than cell 1, on average",
            f"{warmer_k:.2f} K",
            "degradation of both cells (Table IV), ageing law (Table II)",
        ],
        [
            "heat that the coolant carries",
            f"{heat_w:.0f} W",
            "that rise of the coolant, its flow and heat capacity (Table II)",
        ],
        ["compressor power", f"{compressor_w:.0f} W", "cooling energy (Table IV) less P_aux"],
        ["coefficient of performance", f"{cop:.2f}", "heat and compressor power"],
        [
            "cooling pays after",
            f"{pays_s:.0f} s",
            "total energy (Table IV), heat capacity of the cells (Table II)",
        ],
        [
            f"coefficient to pay within {HORIZON_S:g} s",
            f"{cop * pays_s / HORIZON_S:.1f}",
            "the row above",
        ],
        [
            "what J4 of the vice benchmark gives back of a joule that J3 charges while braking",
            f"{100.0 * refund:.0f} %",
            "largest printed ratio of the weights, cells at their upper limit",
        ],
    ]
    return tables.markdown(["figure", "value", "from"], rows)


def payback_table(runs: Mapping[str, Mapping[str, Any]]) -> str:
    """How long cooling with drawn power takes to pay on the trips of the sets, and what braking pays for."""
    rows = []
    for name, driven in runs.items():
        p = iptm.load_parameters(trips.VEHICLE).values
        for run in (tables.REFERENCE, tables.VICE, tables.PROPOSED, tables.MULTI_HORIZON):
            figures, frame = driven[run]["figures"], driven[run]["frame"]
            cop = figures.get("mean_cop", np.nan)
            share = 100.0 * figures["braking_share"]
            rows.append(
                [
                    name,
                    tables.name_of(run),
                    f"{cop:.2f}",
                    payback_text(frame, cop, p),
                    f"{share:.1f} %",
                ]
            )
    heads = ["set", "run", "mean COP", "pays after [s]", "compressor energy spent while braking"]
    return tables.markdown(heads, rows)


def payback_text(frame: pd.DataFrame, cop: float, p: Any) -> str:
    """Times after which a joule of cooling has paid, at low and at high positive battery power."""
    driven = frame.iloc[1:]
    power = driven.battery_power_w.to_numpy()
    kelvin = 0.5 * (driven.cell_1_temperature_k + driven.cell_n_temperature_k).to_numpy()
    if not np.isfinite(cop) or cop <= 0.0:
        return "–"

    def mean_rate(power_w: Array, temperature_k: Array) -> float:
        loss = p.aging.initial_capacity_loss
        resistance = equations.cell_resistance_ohm(temperature_k, loss, p)
        current = equations.pack_current_a(power_w, temperature_k, resistance, p) / p.pack.parallel
        return float(np.mean(equations.loss_rate_1_s(current, temperature_k, loss, p)))

    per_kelvin = (mean_rate(power, kelvin + STEP_K) - mean_rate(power, kelvin - STEP_K)) / (
        2.0 * STEP_K
    )
    cooling_k_j = cop / p.pack_heat_capacity_j_k
    at = np.array([kelvin.mean()])
    times = []
    for level in np.percentile(power[power > 0.0], PERCENTILES):
        cost = (
            mean_rate(np.array([level + STEP_W]), at) - mean_rate(np.array([level]), at)
        ) / STEP_W
        times.append(cost / (per_kelvin * cooling_k_j))
    return f"{min(times):.0f} to {max(times):.0f}"
