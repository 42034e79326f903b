"""A stop at a fast charger: how long it takes, as a function of the temperature of the pack on arrival.

The charging current is the smallest of what the cells take at their temperature, less where they are fuller,
and of what the charger delivers. The pack warms up by its own loss meanwhile, so that minutes at the
charger are the solution of a differential equation and not a division.

Limits of the current are assumed: cell makers do not publish them. They are low in the cold, where lithium
plates on the anode; plating itself is in no ageing law of this project.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, cell_heat_w, cell_resistance_ohm, heat_from_air_w
from iptm_core.physics.powertrain import pack_current_a, pack_resistance_ohm
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, SECONDS_PER_HOUR

LIMIT_C = (-30.0, -20.0, -10.0, 0.0, 10.0, 15.0, 20.0, 25.0, 30.0)
LIMIT_1_H = (0.02, 0.05, 0.15, 0.35, 0.8, 1.15, 1.5, 1.9, 2.2)
"""Largest C-rate at temperatures of the cells, linear between and constant outside; assumed."""
TAPER_CHARGE = (0.5, 0.8, 1.0)
TAPER_SHARE = (1.0, 0.3, 0.1)
"""Share of that C-rate at states of charge, linear between and constant outside; assumed."""
_STEP = 0.005
_COST_C = tuple(0.25 * quarter for quarter in range(-160, 241))
"""Temperatures on arrival: the grid of the cost to go of the controller."""


@dataclass(frozen=True)
class ChargingStopSettings(Settings):
    """A fast charger at the end of the trip."""

    charging_minute_kwh: float = parameter(
        0.0,
        "energy of the pack that a minute at a fast charger at the end of the trip is worth; 0 for none",
        "kWh",
        0.0,
        10.0,
    )
    charging_power_kw: float = parameter(
        150.0, "largest power of the fast charger at the terminals of the pack", "kW", 1.0, 1000.0
    )
    fast_charge_from: float = parameter(
        0.1, "state of charge at which fast charging begins", "", 0.0, 1.0
    )
    fast_charge_to: float = parameter(
        0.8, "state of charge at which fast charging ends", "", 0.0, 1.0
    )
    charging_heater_kw: float = parameter(
        0.0,
        "power of a heater that runs from the charger while the cells take less than it gives",
        "kW",
        0.0,
        20.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fast_charge_from >= self.fast_charge_to:
            raise ParameterError(
                f"fast_charge_from is {self.fast_charge_from:g}; allowed: below fast_charge_to, "
                f"{self.fast_charge_to:g}"
            )


@dataclass(frozen=True)
class FastCharge:
    """Charging from each of n temperatures, in m steps of equal charge.

    Attributes:
        charge: state of charge in the middle of the steps, shape (m,).
        step_s: how long each step takes, shape (m, n).
        temperature_k: temperature of the pack in the middle of the steps, shape (m, n).
        c_rate_1_h: current over the nominal capacity, positive, shape (m, n).
        heater_j: energy of the heater, from the charger, shape (n,).
    """

    charge: FloatArray
    step_s: FloatArray
    temperature_k: FloatArray
    c_rate_1_h: FloatArray
    heater_j: FloatArray

    @property
    def minutes(self) -> FloatArray:
        """Minutes at the charger, shape (n,)."""
        total: FloatArray = np.sum(self.step_s, axis=0) / 60.0
        return total


def fast_charge(
    temperature_k: FloatArray,
    stop: ChargingStopSettings,
    parameters: ModelParameters,
    step: float = _STEP,
) -> FastCharge:
    """Charge a pack from each of some temperatures.

    One temperature stands for all cells; air exchange follows the parameters, and at the upper temperature
    limit the chiller holds it.
    """
    pack, cell, limits = parameters.pack, parameters.cell, parameters.limits
    cells = pack.cells_in_series * pack.parallel
    count = int(np.ceil((stop.fast_charge_to - stop.fast_charge_from) / step - 1e-9))
    step = (stop.fast_charge_to - stop.fast_charge_from) / count
    middles = (stop.fast_charge_from + step * (np.arange(count) + 0.5)).astype(np.float64)
    loss = parameters.aging.initial_capacity_loss
    kelvin = np.asarray(temperature_k, dtype=float)
    durations, temperatures, c_rates = [], [], []
    heater_j = np.zeros_like(kelvin)
    heater_w = 1000.0 * stop.charging_heater_kw

    def rates(charge: float, kelvin: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return C-rate, warming in K/s and whether the cells are the limit."""
        at = at_charge(parameters, charge)
        ohm = cell_resistance_ohm(kelvin, loss, at.cell)
        by_charger_a = -pack_current_a(
            -1000.0 * stop.charging_power_kw,
            pack_resistance_ohm(ohm, pack),
            kelvin,
            at.cell,
            at.pack,
        )
        by_charger = by_charger_a / pack.parallel / cell.nominal_capacity_ah
        by_cells = np.interp(charge, TAPER_CHARGE, TAPER_SHARE) * np.interp(
            kelvin - CELSIUS_ZERO_K, LIMIT_C, LIMIT_1_H
        )
        c_rate = np.minimum(by_charger, by_cells)
        heat_w = cell_heat_w(-c_rate * cell.nominal_capacity_ah, ohm, kelvin, at.cell)
        heat_w = heat_w + heat_from_air_w(kelvin, parameters)
        # Warmth is of use where it lifts the limit of the cells.
        heated = (by_cells < by_charger) & (kelvin < LIMIT_C[-1] + CELSIUS_ZERO_K)
        heat_w = heat_w + heated * parameters.cooling.heater_performance * heater_w / cells
        return c_rate, heat_w / cell.heat_capacity_j_k, heated

    for middle in middles.tolist():
        c_rate, warming_k_s, _ = rates(middle, kelvin)
        half_s = 0.5 * step / c_rate * SECONDS_PER_HOUR
        between = np.minimum(kelvin + half_s * warming_k_s, limits.max_temperature_k)
        between = np.where(kelvin > limits.max_temperature_k, kelvin, between)
        c_rate, warming_k_s, heated = rates(middle, between)
        step_s = step / c_rate * SECONDS_PER_HOUR
        warmer = np.minimum(kelvin + step_s * warming_k_s, limits.max_temperature_k)
        kelvin = np.where(kelvin > limits.max_temperature_k, kelvin, warmer)
        heater_j = heater_j + heated * heater_w * step_s
        durations.append(step_s)
        temperatures.append(between)
        c_rates.append(c_rate)
    return FastCharge(
        middles, np.array(durations), np.array(temperatures), np.array(c_rates), heater_j
    )


def arrival_cost_eur(
    stop: ChargingStopSettings,
    parameters: ModelParameters,
    electricity_eur_kwh: float = AgingSettings.electricity_eur_kwh,
) -> str:
    """Return what the minutes at the charger cost, as the setting ``arrival_cost_eur`` of a trip."""
    minutes = fast_charge(np.array(_COST_C) + CELSIUS_ZERO_K, stop, parameters).minutes
    eur = minutes * stop.charging_minute_kwh * electricity_eur_kwh
    return ", ".join(f"{at!r}:{each!r}" for at, each in zip(_COST_C, eur.tolist(), strict=True))
