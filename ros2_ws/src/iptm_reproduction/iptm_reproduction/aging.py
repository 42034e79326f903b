"""The aging model: its map over current and temperature, and how long cooling takes to pay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import CELSIUS_ZERO_K, ModelParameters
from iptm_core.physics.cell import SECONDS_PER_HOUR, capacity_loss_rate_1_s, cell_resistance_ohm
from iptm_core.physics.electrical import cell_current_a, pack_current_a, pack_resistance_ohm
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_reproduction.figures import MEAN_COP
from iptm_reproduction.runs import ReportRun

CURRENT_STEPS = 41
TEMPERATURE_STEPS = 31
LARGEST_RATE_1_H = 2.0
"""The figure reaches 10 A = 2C."""


@dataclass(frozen=True, eq=False)
class AgingMap:
    """Capacity loss per hour at the initial loss of the parameters.

    Attributes:
        currents_a: cell currents, shape (n,), from 0 to 2C.
        temperatures_c: cell temperatures, shape (m,), over the permitted range.
        loss_per_hour: capacity loss in one hour as a fraction of nominal, shape (m, n).
        nominal_capacity_ah: what 1C is.
    """

    currents_a: FloatArray
    temperatures_c: FloatArray
    loss_per_hour: FloatArray
    nominal_capacity_ah: float


def aging_map(parameters: ModelParameters) -> AgingMap:
    """Evaluate the aging model over current and temperature.

    Args:
        parameters: the aging model, the cell and the permitted temperatures.

    Returns:
        The map.
    """
    capacity_ah = parameters.cell.nominal_capacity_ah
    currents = np.linspace(0.0, LARGEST_RATE_1_H * capacity_ah, CURRENT_STEPS, dtype=np.float64)
    temperatures = np.linspace(
        parameters.limits.min_temperature_k,
        parameters.limits.max_temperature_k,
        TEMPERATURE_STEPS,
        dtype=np.float64,
    )
    rates = capacity_loss_rate_1_s(
        currents[np.newaxis, :],
        temperatures[:, np.newaxis],
        parameters.aging.initial_capacity_loss,
        parameters.aging,
        parameters.cell,
    )
    return AgingMap(
        currents_a=currents,
        temperatures_c=temperatures - CELSIUS_ZERO_K,
        loss_per_hour=np.asarray(rates) * SECONDS_PER_HOUR,
        nominal_capacity_ah=capacity_ah,
    )


_POWER_STEP_W = 10.0
_TEMPERATURE_STEP_K = 0.1


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


def cooling_payback(run: ReportRun, percentiles: tuple[float, ...]) -> Payback | None:
    """Work out the payback of cooling on a trip.

    Args:
        run: the trip.
        percentiles: where in the distribution of the positive battery power the compressor runs.

    Returns:
        The figures; None if the compressor never ran.
    """
    cop = run.values.get(MEAN_COP.key)
    trip, parameters = run.trajectory, run.parameters
    power = trip.battery_power_w[1:]
    if cop is None or not np.any(power > 0.0):
        return None
    pack = parameters.pack
    cells = pack.modules * pack.cells_per_channel
    kelvin_per_joule = cop / (cells * parameters.cell.heat_capacity_j_k)
    temperature = _mean_temperature_k(trip)
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


def _mean_temperature_k(trip: Trajectory) -> FloatArray:
    """Return the mean of both cells at the end of every interval, shape (n - 1,)."""
    mean: FloatArray = 0.5 * (trip.cell_1_temperature_k[1:] + trip.cell_n_temperature_k[1:])
    return mean


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
