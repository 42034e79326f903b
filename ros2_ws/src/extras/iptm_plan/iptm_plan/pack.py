"""The pack of a parked car over one step: charging, air, fan, chiller and heater; energy, ageing in money.

All functions take numbers or arrays that broadcast, so that one plan and one simulation have one physics.
Calendar ageing is counted by the trapezoidal rule, half at the beginning and half at the end of a step.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from iptm_core.aging_laws.law import AgingLaw, Load, Mechanism
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging, capacity_price_eur
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, cell_heat_w, cell_resistance_ohm
from iptm_core.physics.pack_limits import current_limits_a
from iptm_core.physics.power_thermal import CellPair
from iptm_core.physics.powertrain import pack_current_a, pack_resistance_ohm, terminal_power_w
from iptm_core.state import FloatArray
from iptm_life.trip_map import TripMap, nominal_energy_j
from iptm_life.year import (
    COOLING_COP,
    FREE_COOLING_FAN_W,
    FREE_COOLING_W_K,
    PARKED_TIME_CONSTANT_S,
    UPPER_LIMIT_K,
)

CHARGER_EFFICIENCY = 0.92
"""Of a charger on board from the plug to the pack: chosen, 0.9 to 0.94 are usual."""
CHILLER_W = 1000.0
"""Largest power of the chiller of a parked car: chosen, a quiet one."""


@dataclass(frozen=True)
class AgingPrice:
    """Money that ageing costs, with the marginal loss of a mechanism at the end of service.

    The loss is concave in the damage, so that a plan at the marginal costs of another use is never worse than
    that use, by loss and energy together.

    Attributes:
        weights: change of the loss over the one of the damage, one for each mechanism.
        eur: price of the whole capacity of the pack.
        depth: of a usual day's cycle.
        mean_1_h: mean C-rate of such a day.
        charging_1_h: mean C-rate of its charging.
    """

    law: AgingLaw
    weights: tuple[float, ...]
    eur: float
    depth: float
    mean_1_h: float
    charging_1_h: float

    @classmethod
    def of(cls, law: AgingLaw, use: AgingSettings, parameters: ModelParameters) -> AgingPrice:
        """Return the price of ageing for a use as stated in the settings of a controller."""
        parked = ParkedAging(law, use, parameters.environment.ambient_temperature_k)
        return cls(
            law,
            parked.weights,
            capacity_price_eur(use, parameters),
            use.daily_discharge,
            2.0 * use.daily_discharge / 24.0,
            use.charging_c_rate_1_h,
        )

    def calendar_eur_s(self, charge: Any, kelvin: Any) -> Any:
        """Return the cost of a second at rest."""
        return self._eur_s(Load(kelvin, 0.0, charge), Mechanism.CALENDAR)

    def cyclic_eur_s(self, charge: Any, kelvin: Any, c_rate_1_h: Any) -> Any:
        """Return the cost of a second with current."""
        load = Load(kelvin, c_rate_1_h, charge, self.depth, self.mean_1_h, self.charging_1_h)
        return self._eur_s(load, Mechanism.CYCLIC)

    def _eur_s(self, load: Load, mechanism: Mechanism) -> Any:
        return self.eur * sum(
            weight * part.damage_rate_1_s(load)
            for part, weight in zip(self.law.mechanisms, self.weights, strict=True)
            if part.mechanism is mechanism
        )


@dataclass(frozen=True)
class PlannedStep:
    """What is done in a step; numbers, or arrays that broadcast.

    Attributes:
        charging: share of the power of the charger that goes into the pack.
        thermal_w: power of the chiller from the plug, negative of the heater.
        fan: 1 while the fan blows air through the radiator, from the plug or the pack; else 0.
    """

    charging: Any = 0.0
    thermal_w: Any = 0.0
    fan: Any = 0.0


@dataclass(frozen=True)
class Stand:
    """A step of standing.

    Attributes:
        gained: state of charge at its end less the one at its beginning.
        warmed_k: change of temperature, but for the air.
        kept: share of the difference to the air that is left.
        grid_j: energy from the plug.
        thermal_j: electric energy of chiller, heater and fan, from the plug or the pack.
        c_rate_1_h: of charging, positive.
    """

    gained: Any
    warmed_k: Any
    kept: Any
    grid_j: Any
    thermal_j: Any
    c_rate_1_h: Any


@dataclass(frozen=True, eq=False)
class Driven:
    """Trips in a row; arrays of shape (n,), one value per sample.

    Attributes:
        durations_s: of the samples.
        kelvin: mean of the two cells.
        c_rate_1_h: mean magnitude.
        drawn: share of the nominal energy drawn since the start.
        end_k: temperature at the end.
        cooling_j: energy of the compressor.
    """

    durations_s: FloatArray
    kelvin: FloatArray
    c_rate_1_h: FloatArray
    drawn: FloatArray
    end_k: float
    cooling_j: float


@dataclass(frozen=True)
class ParkedPack:
    """A pack between trips.

    Attributes:
        parameters: of the car; the air is given for each step instead.
        has_fan: a radiator and a fan for the parked pack.
        chiller_w: largest power of the chiller while the car stands, 0 for none.
    """

    parameters: ModelParameters
    has_fan: bool = False
    chiller_w: float = CHILLER_W
    capacity_j_k: float = field(init=False)
    energy_j: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "capacity_j_k", self.parameters.pack_heat_capacity_j_k)
        object.__setattr__(self, "energy_j", nominal_energy_j(self.parameters))

    @property
    def heater_w(self) -> float:
        """Largest power of the heater."""
        return self.parameters.limits.max_heater_power_w

    def stand(
        self, charge: Any, kelvin: Any, charger_w: float, decision: PlannedStep, step_s: float
    ) -> Stand:
        """Stand for a step.

        Args:
            charge: state of charge at its beginning.
            kelvin: temperature of the pack at its beginning.
            charger_w: largest power from the plug, 0 without one: then there is a fan only.
        """
        parameters, cell = self.parameters, self.parameters.cell
        fan_w = FREE_COOLING_FAN_W * decision.fan
        charge, kelvin = np.broadcast_arrays(charge, kelvin)
        thermal_w = decision.thermal_w if charger_w else 0.0 * decision.thermal_w
        # Below its lower temperature limit a pack is not cooled by the chiller.
        above_k = np.maximum(kelvin - parameters.limits.min_temperature_k, 0.0)
        thermal_w = np.minimum(thermal_w, above_k * self.capacity_j_k / COOLING_COP / step_s)
        drawn_w = np.abs(thermal_w) + fan_w
        from_pack = 0.0 if charger_w else drawn_w * step_s / self.energy_j
        conductance_w_k = (
            self.capacity_j_k / PARKED_TIME_CONSTANT_S + FREE_COOLING_W_K * decision.fan
        )
        kept = np.exp(-step_s * conductance_w_k / self.capacity_j_k)
        moved_w = np.where(thermal_w > 0.0, COOLING_COP, parameters.cooling.heater_performance) * (
            -thermal_w
        )
        if not charger_w:
            zero = np.zeros(np.shape(charge))
            warmed_k = zero + moved_w * step_s / self.capacity_j_k
            return Stand(zero - from_pack, warmed_k, kept, zero, drawn_w * step_s, zero)
        at = at_charge(parameters, charge)
        loss = parameters.aging.initial_capacity_loss
        ohm = cell_resistance_ohm(kelvin, loss, at.cell)
        into_w = decision.charging * CHARGER_EFFICIENCY * np.maximum(charger_w - drawn_w, 0.0)
        pack = pack_resistance_ohm(ohm, at.pack), kelvin, at.cell, at.pack
        per_1_h = cell.nominal_capacity_ah * at.pack.parallel
        least_a: Any = -np.inf
        if parameters.pack_limits.limited:
            least_a, _ = current_limits_a(CellPair(kelvin, kelvin, loss, loss), charge, at)
        to_full_1_h = np.maximum(1.0 - charge, 0.0) * 3600.0 / step_s
        c_rate = np.minimum(-pack_current_a(-into_w, *pack), -least_a) / per_1_h
        c_rate = np.minimum(c_rate, to_full_1_h)
        charging_w = -terminal_power_w(-c_rate * per_1_h, *pack)
        heat_w = at.pack.cells * cell_heat_w(
            -c_rate * cell.nominal_capacity_ah, ohm, kelvin, at.cell
        )
        return Stand(
            c_rate * step_s / 3600.0,
            (heat_w + moved_w) * step_s / self.capacity_j_k,
            kept,
            (charging_w / CHARGER_EFFICIENCY + drawn_w) * step_s,
            drawn_w * step_s,
            c_rate,
        )

    def driven(self, trip: TripMap, kelvin: float, repeats: int = 1) -> Driven:
        """Return trips in a row from a temperature.

        Above the upper limit the pack is cooled whatever the control.
        """
        parts, drawn, cooling_j = [], 0.0, 0.0
        for _ in range(repeats):
            one = trip.from_start(kelvin)
            capped_k = np.minimum(one.temperature_k[0], UPPER_LIMIT_K)
            parts.append((one.durations_s, capped_k, one.c_rate_1_h[0], drawn + one.drawn[0]))
            end_k = float(one.end_k[0])
            above_k = max(end_k - UPPER_LIMIT_K, 0.0)
            kelvin, drawn = end_k - above_k, drawn + float(one.drawn[0, -1])
            cooling_j += float(one.compressor_j[0]) + above_k * self.capacity_j_k / COOLING_COP
        durations_s, kelvins, c_rates, shares = map(np.concatenate, zip(*parts, strict=True))
        return Driven(durations_s, kelvins, c_rates, shares, kelvin, cooling_j)

    def driven_eur(self, driven: Driven, charge: Any, price: AgingPrice) -> Any:
        """Return what trips cost by ageing, from each state of charge, shape of these."""
        charges = np.asarray(charge)[..., np.newaxis] - driven.drawn
        rate = price.calendar_eur_s(charges, driven.kelvin)
        rate = rate + price.cyclic_eur_s(charges, driven.kelvin, driven.c_rate_1_h)
        return np.sum(rate * driven.durations_s, axis=-1)
