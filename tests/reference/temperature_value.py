"""Prices of the cell temperatures in Python, to the bits of ``c/prices.c``."""

from __future__ import annotations

import math

from iptm_controller.temperature_value import (
    C_RATE_ITERATIONS,
    FORECAST_WEIGHT_S,
    LEAST_RATE_1_S,
    TemperatureValuation,
    TemperatureValue,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import capacity_loss_rate_1_s


def mean_c_rate_1_h(
    rate_1_s: float, temperature_k: float, capacity_loss: float, parameters: ModelParameters
) -> float:
    """Return the C-rate at which a cell ages at a given rate, the inverse of eq. (12) for the current.

    Newton's method on ``ln c + b c = ln(rate / k)``, where ``k c exp(b c)`` is the law.

    Args:
        rate_1_s: rate of the capacity loss, positive.
    """
    aging, cell = parameters.aging, parameters.cell
    at_1_c = capacity_loss_rate_1_s(
        cell.nominal_capacity_ah, temperature_k, capacity_loss, aging, cell
    )
    b = _load_factor_h(temperature_k, parameters)
    target = math.log(rate_1_s / at_1_c) + b
    c_rate = math.exp(min(target, 0.0))
    for _ in range(C_RATE_ITERATIONS):
        c_rate *= (1.0 + target - math.log(c_rate)) / (1.0 + b * c_rate)
    return c_rate


def _load_factor_h(temperature_k: float, parameters: ModelParameters) -> float:
    """Return b of the aging law, the growth of its logarithm with the C-rate."""
    aging = parameters.aging
    gas_j_mol = aging.throughput_exponent * aging.gas_constant_j_mol_k * temperature_k
    return aging.compensation_factor_j_mol / gas_j_mol


class ReferenceValuation(TemperatureValuation):
    """The same valuation, whose prices are worked out in Python."""

    def _priced(self, *aged: float) -> TemperatureValue:
        time_s, temperature_k, loss, elapsed_s, lost = aged
        rate = (lost + self.foreseen_1_s * FORECAST_WEIGHT_S) / (elapsed_s + FORECAST_WEIGHT_S)
        rate = max(rate, LEAST_RATE_1_S)
        values = self._parameters
        aging = values.aging
        c_rate = mean_c_rate_1_h(0.5 * rate, temperature_k, 0.5 * loss, values)
        load = _load_factor_h(temperature_k, values) * c_rate
        molar_k = aging.throughput_exponent * aging.gas_constant_j_mol_k * temperature_k**2
        sensitivity = aging.activation_energy_j_mol / molar_k - load / temperature_k
        remaining_s = max(self._trip_duration_s - time_s - self._horizon_s, 0.0)
        lasting_s = min(self._payback_s(c_rate, load, sensitivity), remaining_s)
        if math.isinf(lasting_s):  # neither is known: nothing to base a price on
            lasting_s = 0.0
        price = self._aging_weight * sensitivity * rate * lasting_s
        return TemperatureValue(
            self._share_1 * price, self._share_n * price, rate, sensitivity, lasting_s
        )

    def _payback_s(self, c_rate_1_h: float, load: float, sensitivity_1_k: float) -> float:
        """Return the time after which cooling a kelvin away has saved what it has aged the cells."""
        if self._performance <= 0.0:
            return math.inf
        pack, cell = self._parameters.pack, self._parameters.cell
        current_a = c_rate_1_h * cell.nominal_capacity_ah * pack.parallel
        power_w = current_a * pack.open_circuit_voltage_v
        saved_w_k = self._performance * sensitivity_1_k * power_w
        return self._heat_capacity_j_k * (1.0 + load) / saved_w_k
