"""Reward of a trip: minus its cost in EUR, tick by tick.

    energy  p_E (E_b - E_kin),   ageing  p_Q (Q_trip + Q_parked),   road  p_H integral (d - d_des)^2 dt

Energy and ageing are those of `iptm_core.metrics.trip_cost`, with its prices: their sum over an episode is
`Run.cost` times the distance, less the Q_parked of the pack at the beginning. The motion and the warmth of a
tick count at once, as differences, so no reward waits for the end. What a long gap saves is paid for by the
road price, `headway_eur_m2_h`: without it an ego vehicle that stands would cost least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.aging_laws.parking import (
    PRICED_LAW,
    AgingSettings,
    ParkedAging,
    capacity_price_eur,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import VehicleState
from iptm_core.units import J_PER_KWH, SECONDS_PER_HOUR
from iptm_plant_sim.interval import PlantStep


@dataclass(frozen=True)
class TickCost:
    """What a tick costs, in EUR."""

    energy_eur: float
    aging_eur: float
    road_eur: float

    @property
    def eur(self) -> float:
        """All of it."""
        return self.energy_eur + self.aging_eur + self.road_eur


class TickCosts:
    """Costs of the ticks of a trip.

    Args:
        model: vehicle, pack and air.
        use: prices, law and use of the car between trips.
        headway_s: time headway of the gap without a price, beyond the gap at standstill.
    """

    def __init__(self, model: ModelParameters, use: AgingSettings, headway_s: float) -> None:
        ambient_k = model.environment.ambient_temperature_k
        self._parked = ParkedAging(use.law() or PRICED_LAW, use, ambient_k)
        self._model, self._use, self._headway_s = model, use, headway_s
        self._capacity_eur = capacity_price_eur(use, model)
        self._joule_eur = use.electricity_eur_kwh / J_PER_KWH
        self._last: tuple[VehicleState, float] | None = None

    def of(self, before: PlantStep, after: PlantStep, gap_m: float) -> TickCost:
        """Return what an interval costs.

        Args:
            gap_m: at its end.
        """
        state, elapsed_s = after.state, after.state.time_s - before.state.time_s
        spent_j = after.powers.battery_power_w * elapsed_s
        spent_j -= self._kinetic_j(state) - self._kinetic_j(before.state)
        lost = self._lost(before.state, state, elapsed_s)
        lost_parked = self._lost_parked(state)
        lost += lost_parked - self._before(before.state)
        self._last = state, lost_parked
        desired_m = self._model.gap.standstill_gap_m + self._headway_s * state.speed_m_s
        road = self._use.headway_eur_m2_h * (gap_m - desired_m) ** 2 * elapsed_s / SECONDS_PER_HOUR
        return TickCost(self._joule_eur * spent_j, self._capacity_eur * lost, road)

    def _kinetic_j(self, state: VehicleState) -> float:
        body = self._model.body
        return 0.5 * body.mass_kg * body.rotational_inertia_factor * state.speed_m_s**2

    def _lost(self, before: VehicleState, state: VehicleState, elapsed_s: float) -> float:
        """Return the capacity lost in an interval, mean of both cells."""
        cells_k = np.array([state.cell_1_temperature_k, state.cell_n_temperature_k])
        discharge = before.state_of_charge - state.state_of_charge
        c_rate_1_h, charge = (
            np.full(cells_k.shape, value)
            for value in (discharge / elapsed_s * SECONDS_PER_HOUR, state.state_of_charge)
        )
        return float(np.mean(self._parked.loss_1_s(cells_k, c_rate_1_h, charge))) * elapsed_s

    def _before(self, state: VehicleState) -> float:
        """Return the capacity lost parked from the state at the beginning of a tick, the end of the last."""
        if self._last is not None and self._last[0] is state:
            return self._last[1]
        return self._lost_parked(state)

    def _lost_parked(self, state: VehicleState) -> float:
        """Return what a pack loses beyond a settled one if it is parked now."""
        arrival_k = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        price_1_k = float(self._parked.kelvin_price_1_k(np.array([arrival_k]))[0])
        return price_1_k * (arrival_k - self._parked.parked_k)
