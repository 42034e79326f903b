"""Two runs of one trip, compared as if they had ended alike.

They end with different temperatures, speeds and distances, and each of these holds energy or ageing that the
figures of the trip do not show. The corrected figures of a run are

    E' = E_b + E_cool - E_kin,   E_kin = 1/2 delta m v^2,
    Q' = Q_loss + Q_cool,

with the battery energy E_b and the capacity loss Q_loss of the trip, and with delta, m and the final speed v.
E_cool and Q_cool bring the warmer pack, of N cells with mean temperature T, to the final temperature T* of
the other: at standstill, with a constant compressor power P, and with all rates at the middle temperature
(T + T*) / 2,

    t = N C_c (T - T*) / (Q_co - N q_bc),   E_cool = P_b t,   Q_cool = (dQ_loss/dt) t,

where Q_co is the heat that the chiller takes, q_bc the heat that a cell makes, P_b = (P + P_aux) / eta_b the
battery power, and P the power that takes the least energy, at the state of charge at the end. The kinetic
energy is taken as returned in full. Energies are compared per distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_heat_w, cell_resistance_ohm, heat_from_air_w
from iptm_core.physics.charge import at_charge
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.physics.coolant import reduce_channel
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates

POWER_STEP_W = 10.0


class TripEnd(Protocol):
    """Figures of a run that its comparison with another one needs; `RunMetrics` has them."""

    @property
    def duration_s(self) -> float:
        """From the first to the last row."""

    @property
    def distance_m(self) -> float:
        """Distance driven."""

    @property
    def battery_energy_j(self) -> float:
        """Energy taken from the pack."""

    @property
    def degradation(self) -> float:
        """Capacity lost by both cells together."""

    @property
    def hard_violations(self) -> int:
        """Rows that break a hard limit."""

    @property
    def final_kinetic_energy_j(self) -> float:
        """Energy of the motion at the end."""

    @property
    def final_temperature_k(self) -> float:
        """Mean of both cells at the end."""

    @property
    def final_cell_losses(self) -> tuple[float, float]:
        """Capacity losses of both cells at the end."""

    @property
    def final_charge(self) -> float:
        """State of charge at the end."""


def cool_down(
    run: TripEnd, temperature_k: float, parameters: ModelParameters
) -> tuple[float, float] | None:
    """Return what cooling the pack down at standstill takes; None where it cannot be.

    Returns:
        Energy in J, and the capacity loss of both cells together; zero if the pack is not warmer.
    """
    warmer_k = run.final_temperature_k - temperature_k
    if warmer_k <= 0.0:
        return 0.0, 0.0
    parameters = at_charge(parameters, run.final_charge)
    middle_k = run.final_temperature_k - 0.5 * warmer_k
    powers_w = np.arange(
        POWER_STEP_W,
        largest_useful_power_w(parameters.chiller, parameters.limits) + 1e-6,
        POWER_STEP_W,
    )
    losses = run.final_cell_losses
    rates = power_thermal_rates(
        0.0,
        0.0,
        0.0,
        powers_w,
        CellPair(middle_k, middle_k, *losses),
        parameters,
        reduce_channel(parameters.cooling, parameters.pack),
    )
    cell, cells = parameters.cell, parameters.pack.cells
    resistance_ohm = cell_resistance_ohm(middle_k, 0.5 * sum(losses), cell)
    heat_w = cells * (
        cell_heat_w(rates.cell_current_a, resistance_ohm, middle_k, cell)
        + heat_from_air_w(middle_k, parameters)
    )
    net_w = rates.coolant.cooling_rate_w - heat_w
    loss_1_s = rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s
    to_remove_j = cells * cell.heat_capacity_j_k * warmer_k
    durations_s = np.full(powers_w.shape, np.inf)
    np.divide(to_remove_j, net_w, out=durations_s, where=net_w > 0.0)
    energies_j = rates.battery_power_w * durations_s
    best = int(np.argmin(energies_j))
    if not np.isfinite(energies_j[best]):
        return None
    return float(energies_j[best]), float(loss_1_s[best] * durations_s[best])


@dataclass(frozen=True)
class CorrectedFigures:
    """What a run would have cost with the end of the other run; see the module.

    Attributes:
        temperature_k: final temperature of both runs: the one of the cooler run.
        capacity_loss: of both cells together.
        energy_per_distance_j_m: the same over the distance of the run; NaN for one that stands.
    """

    temperature_k: float
    capacity_loss: float
    energy_j: float
    energy_per_distance_j_m: float


def at_equal_end(
    own: TripEnd,
    other: TripEnd,
    parameters: ModelParameters,
    of_other: ModelParameters | None = None,
) -> tuple[CorrectedFigures, CorrectedFigures] | None:
    """Return the figures of two runs corrected for their ends; None where they cannot be.

    Args:
        own: figures of a run.
        other: figures of the other one.
        parameters: of the vehicle.
        of_other: of the vehicle of the other run; None for the same.
    """
    temperature_k = min(own.final_temperature_k, other.final_temperature_k)
    first = _corrected(own, temperature_k, parameters)
    second = _corrected(other, temperature_k, of_other or parameters)
    return None if first is None or second is None else (first, second)


def _corrected(
    run: TripEnd, temperature_k: float, parameters: ModelParameters
) -> CorrectedFigures | None:
    cooling = cool_down(run, temperature_k, parameters)
    if cooling is None:
        return None
    cooling_j, cooling_loss = cooling
    energy_j = run.battery_energy_j + cooling_j - run.final_kinetic_energy_j
    return CorrectedFigures(
        temperature_k=temperature_k,
        capacity_loss=run.degradation + cooling_loss,
        energy_j=energy_j,
        energy_per_distance_j_m=energy_j / run.distance_m if run.distance_m > 0.0 else math.nan,
    )
