"""The aging model: its map, and how long cooling takes to pay, on a trip and by the printed numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pandas as pd

from iptm.studies.run import Run
from iptm.studies.run_spec import REPRODUCED_SET
from iptm_controller.strategy import strategy_by_name
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K, ModelParameters
from iptm_core.physics.cell import SECONDS_PER_HOUR, capacity_loss_rate_1_s, cell_resistance_ohm
from iptm_core.physics.electrical import cell_current_a, pack_current_a, pack_resistance_ohm
from iptm_core.state import FloatArray
from iptm_reproduction.names import CELL_1, CELL_N, COOLING, REFERENCE, TOTAL
from iptm_reproduction.printed import LARGEST_VICE_RATIO_J, VALUES

CURRENT_STEPS = 41
TEMPERATURE_STEPS = 31
LARGEST_RATE_1_H = 2.0
"""The figure reaches 10 A = 2C."""


def aging_map(parameters: ModelParameters) -> pd.DataFrame:
    """Return the capacity loss per hour, as a fraction of nominal, at the initial loss of the parameters.

    A row per cell temperature in degC, over the permitted range; a column per current in A, from 0 to 2C.
    """
    capacity_ah, limits = parameters.cell.nominal_capacity_ah, parameters.limits
    currents = np.linspace(0.0, LARGEST_RATE_1_H * capacity_ah, CURRENT_STEPS, dtype=np.float64)
    temperatures = np.linspace(
        limits.min_temperature_k, limits.max_temperature_k, TEMPERATURE_STEPS, dtype=np.float64
    )
    rates = capacity_loss_rate_1_s(
        currents[np.newaxis, :],
        temperatures[:, np.newaxis],
        parameters.aging.initial_capacity_loss,
        parameters.aging,
        parameters.cell,
    )
    return pd.DataFrame(
        np.asarray(rates) * SECONDS_PER_HOUR, temperatures - CELSIUS_ZERO_K, currents
    )


_POWER_STEP_W = 10.0
_TEMPERATURE_STEP_K = 0.1
_CURRENT_STEP_A = 1e-3


@dataclass(frozen=True)
class Payback:
    """What cooling costs and brings on a trip.

    Attributes:
        cop: heat taken from the coolant per compressor energy over the trip.
        cooling_k_kj: fall of the mean cell temperature per compressor energy, in K/kJ.
        aging_per_kelvin: relative change of the mean aging rate per kelvin.
        times_s: time until cooling has paid, by the battery power in W at which the compressor runs. The
            cells are taken to stay as cool, so that it takes longer in truth.
    """

    cop: float
    cooling_k_kj: float
    aging_per_kelvin: float
    times_s: dict[float, float]


def cooling_payback(run: Run, percentiles: tuple[float, ...]) -> Payback | None:
    """Return the payback of cooling on a trip; None if the compressor never ran.

    It runs at percentiles of the distribution of the positive battery power.
    """
    cop = run.metrics.mean_cop
    trip, parameters = run.trajectory, run.parameters
    power = trip.battery_power_w[1:]
    if cop is None or not np.any(power > 0.0):
        return None
    pack = parameters.pack
    cells = pack.modules * pack.cells_per_channel
    kelvin_per_joule = cop / (cells * parameters.cell.heat_capacity_j_k)
    # Mean of both cells at the end of every interval.
    temperature = 0.5 * (trip.cell_1_temperature_k[1:] + trip.cell_n_temperature_k[1:])
    rates = [
        _mean_rate_1_s(power, temperature + step, parameters)
        for step in (-_TEMPERATURE_STEP_K, _TEMPERATURE_STEP_K)
    ]
    per_kelvin = (rates[1] - rates[0]) / (2.0 * _TEMPERATURE_STEP_K)
    mean = np.array([np.mean(temperature)])
    times = {}
    for level in np.percentile(power[power > 0.0], percentiles):
        costs = [
            _mean_rate_1_s(np.array([level + step]), mean, parameters)
            for step in (0.0, _POWER_STEP_W)
        ]
        cost_per_joule = (costs[1] - costs[0]) / _POWER_STEP_W
        times[float(level)] = cost_per_joule / (per_kelvin * kelvin_per_joule)
    return Payback(
        cop=cop,
        cooling_k_kj=1e3 * kelvin_per_joule,
        aging_per_kelvin=per_kelvin / (0.5 * (rates[0] + rates[1])),
        times_s=times,
    )


def _mean_rate_1_s(
    power_w: FloatArray, temperature_k: FloatArray, parameters: ModelParameters
) -> float:
    """Return the mean rate of the capacity loss at battery powers and temperatures."""
    loss = parameters.aging.initial_capacity_loss
    resistance = pack_resistance_ohm(
        cell_resistance_ohm(temperature_k, loss, parameters.cell), parameters.pack
    )
    current = cell_current_a(
        pack_current_a(power_w, resistance, temperature_k, parameters.cell, parameters.pack),
        parameters.pack,
    )
    rates = capacity_loss_rate_1_s(current, temperature_k, loss, parameters.aging, parameters.cell)
    return float(np.mean(rates))


TRIP_S = 1e4
"""Duration of the paper's driving cycle (Section IV-A)."""
HORIZON_S = 15.0
"""Single horizon of the comparison of strategies (Section IV-B)."""


@dataclass(frozen=True)
class PrintedCooling:
    """Cooling from the printed numbers of the reference alone: nothing here is identified.

    The ratio of both cells' degradations gives, by the printed aging law, how much warmer cell N is; the
    coolant warms up by as much along the channel, which is the heat that it carries; with the printed cooling
    energy that is a coefficient of performance.

    Attributes:
        cells_differ_k: mean temperature of cell N above cell 1.
        heat_w: mean heat that the coolant carries.
        compressor_power_w: mean of P_cp.
        cop: heat per compressor energy.
        pays_after_s: time after which slower aging has made up for the current that cooling draws; a lower
            bound, because the cells are taken to stay as cool.
        braking_refund: what the aging term of the vice benchmark gives back of a joule that its energy
            term charges, where the compressor takes it from a charging current: at the mean C-rate, cells
            at their upper limit, and the largest printed ratio of the weights.
    """

    cells_differ_k: float
    heat_w: float
    compressor_power_w: float
    cop: float
    pays_after_s: float
    braking_refund: float

    def cop_to_pay_within(self, horizon_s: float) -> float:
        """Return the coefficient of performance with which cooling would pay after a time."""
        return self.cop * self.pays_after_s / horizon_s


def printed_cooling(parameters: ModelParameters, reference_k: float) -> PrintedCooling:
    """Work the figures out from Tables I and II and the temperature that the reference keeps (r_T)."""
    pack, cooling, cell = parameters.pack, parameters.cooling, parameters.cell
    cooling_kj, total_kj, loss_1, loss_n = (
        float(VALUES.at[REFERENCE, figure]) for figure in (COOLING, TOTAL, CELL_1, CELL_N)
    )
    power_w = 1e3 * total_kj / TRIP_S
    current_a = power_w / (pack.open_circuit_voltage_v * pack.parallel)

    def log_rate(current: float, temperature_k: float) -> float:
        loss = parameters.aging.initial_capacity_loss
        return math.log(
            capacity_loss_rate_1_s(current, temperature_k, loss, parameters.aging, cell)
        )

    def per_ampere(temperature_k: float) -> float:
        step = log_rate(current_a + _CURRENT_STEP_A, temperature_k)
        return (step - log_rate(current_a, temperature_k)) / _CURRENT_STEP_A

    warmer = log_rate(current_a, reference_k + _TEMPERATURE_STEP_K)
    per_kelvin = (warmer - log_rate(current_a, reference_k)) / _TEMPERATURE_STEP_K
    cells_differ_k = math.log(loss_n / loss_1) / per_kelvin
    heat_w = cooling.coolant_mass_flow_kg_s * cooling.coolant_specific_heat_j_kg_k * cells_differ_k
    compressor_power_w = 1e3 * cooling_kj / TRIP_S - cooling.auxiliary_power_w
    cop = heat_w / compressor_power_w
    per_watt = 1.0 / (pack.open_circuit_voltage_v * pack.parallel)
    heat_capacity_j_k = pack.modules * pack.cells_per_channel * cell.heat_capacity_j_k
    limit_k = parameters.limits.max_temperature_k
    both_cells_1_s = 2.0 * math.exp(log_rate(current_a, limit_k))
    return PrintedCooling(
        cells_differ_k=cells_differ_k,
        heat_w=heat_w,
        compressor_power_w=compressor_power_w,
        cop=cop,
        pays_after_s=heat_capacity_j_k * per_ampere(reference_k) * per_watt / (cop * per_kelvin),
        braking_refund=LARGEST_VICE_RATIO_J * both_cells_1_s * per_ampere(limit_k) * per_watt,
    )


@cache
def reproduced_cooling() -> PrintedCooling:
    """Return the figures with the printed parameters and the printed reference temperature."""
    reference_k = strategy_by_name("reference").reference_temperature_k
    return printed_cooling(load_parameters(REPRODUCED_SET).values, reference_k)
