"""Cost of a trip in one currency: energy, and capacity by the law of a cell.

    EUR = p_E (E_b - E_kin) + p_Q (Q_trip + Q_parked)

with the battery energy E_b, the kinetic energy at the end, assumed to be recovered in full, and the mean of
both cells' capacity loss at the end of service. Q_trip is lost while driving. Q_parked is what the parked
pack loses because it arrives warmer than it settles, negative where it arrives cooler (`ParkedAging`). The
price of capacity p_Q spreads the price of the battery over the loss at which it is replaced.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import (
    PRICED_LAW,
    AgingSettings,
    ParkedAging,
    capacity_price_eur,
)
from iptm_core.metrics.saving import TripEnd
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory
from iptm_core.units import J_PER_KWH, SECONDS_PER_HOUR

M_PER_100_KM = 1e5


@dataclass(frozen=True)
class TripCost:
    """What a trip costs, in EUR per 100 km; NaN where the distance or the state of charge is not known.

    Attributes:
        energy_eur: of the battery.
        driving_eur: capacity lost while driving.
        parked_eur: capacity lost after it beyond what the settled pack loses.
    """

    energy_eur: float
    driving_eur: float
    parked_eur: float

    @property
    def eur(self) -> float:
        """All of it."""
        return self.energy_eur + self.driving_eur + self.parked_eur


def trip_cost(
    run: Trajectory,
    end: TripEnd,
    parameters: ModelParameters,
    use: AgingSettings,
    law: str = "",
) -> TripCost:
    """Return the cost of a trip.

    Args:
        run: its rows.
        end: its figures.
        parameters: pack and air.
        use: prices, and how the car is used between trips.
        law: law of a cell; empty for the one of the use, or `PRICED_LAW`.
    """
    priced = LAWS[law] if law else use.law() or PRICED_LAW
    parked = ParkedAging(priced, use, parameters.environment.ambient_temperature_k)
    spent_s = run.intervals_s
    c_rates_1_h = -np.diff(run.state_of_charge) / spent_s * SECONDS_PER_HOUR
    cells_k = (run.cell_1_temperature_k, run.cell_n_temperature_k)
    lost = [
        float(np.sum(parked.loss_1_s(kelvin[1:], c_rates_1_h, run.state_of_charge[1:]) * spent_s))
        for kelvin in cells_k
    ]
    arrival_k = np.array([end.final_temperature_k])
    later = float(parked.kelvin_price_1_k(arrival_k)[0]) * (
        end.final_temperature_k - parked.parked_k
    )
    share = M_PER_100_KM / end.distance_m if end.distance_m > 0.0 else math.nan
    capacity_eur = share * capacity_price_eur(use, parameters)
    energy_j = end.battery_energy_j - end.final_kinetic_energy_j
    return TripCost(
        share * energy_j / J_PER_KWH * use.electricity_eur_kwh,
        capacity_eur * 0.5 * sum(lost),
        capacity_eur * later,
    )
