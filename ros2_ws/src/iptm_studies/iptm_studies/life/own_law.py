"""Trips of the default strategy with the ageing law of a cell, as a function of what a kelvin is worth.

What the strategy does with a law depends on what a kelvin less on arrival is worth in capacity, and hardly on
the rest of the law: trips are driven at a few prices of a kelvin, which the time constant of the parked pack
makes under one law, and interpolated to the price of a cell, a climate, a month and a habit of charging.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_studies.life.losses import SERVICE_YEARS
from iptm_studies.life.trips import (
    CITY,
    DEFAULT,
    MOTORWAY,
    Extent,
    TripMap,
    heat_capacity_j_k,
    trip_case,
)
from iptm_studies.life.usage import HOUR_S, Charging, Climate, Usage
from iptm_studies.life.year import FREE_COOLING_W_K, PARKED_TIME_CONSTANT_S, Activity, Year
from iptm_studies.study import Study

PAPER = "paper"
"""The law of the paper, among the names of the cells."""
PARKED_H = (0.1, 1.0, 2.0, 4.0)
"""From a price at which nothing is cooled to one at which as much is cooled as the limits allow."""
ARRIVAL_ABOVE_PARKED_K = 5.0
"""Prices are compared where a trip may end: a price also depends on the temperature on arrival."""
_CARRIER = AgingSettings(
    aging_law="lfp",
    parking_air_k=27.0 + CELSIUS_ZERO_K,
    parking_air_swing_k=0.0,
    year_air_k=22.0 + CELSIUS_ZERO_K,
    year_air_swing_k=10.0,
)


def priced_study(extent: Extent) -> Study:
    """Return the trips of all cycles, prices and temperatures."""
    cases = [
        trip_case(extent, cycle, DEFAULT, start_c, _carrier(hours), _name(hours))
        for cycle in (CITY, MOTORWAY)
        for hours in PARKED_H
        for start_c in extent.start_c
    ]
    about = "Trips of the default strategy at several prices of a kelvin on arrival."
    return Study("life_prices", "Prices of a kelvin", about, tuple(cases))


def _carrier(parked_h: float) -> AgingSettings:
    return replace(_CARRIER, parked_time_constant_h=parked_h)


def _name(parked_h: float) -> str:
    return f"parked_{parked_h:g}"


def kelvin_price_1_k(use: AgingSettings, arrival_k: float) -> float:
    """Return what a kelvin more on arrival costs, as a share of nominal capacity."""
    parked = ParkedAging(LAWS[use.aging_law], use, use.parking_air_k)
    return float(parked.kelvin_price_1_k(np.array([arrival_k]))[0])


@dataclass(frozen=True)
class PricedTrips:
    """A trip as a function of the price of a kelvin.

    Attributes:
        trips: one for each of `PARKED_H`.
    """

    trips: tuple[TripMap, ...]

    def at(self, price_1_k: float, arrival_k: float) -> TripMap:
        """Return the trip at a price: linear in its square root, beyond those driven that of the nearest.

        Args:
            price_1_k: price of a kelvin, as a share of nominal capacity.
            arrival_k: temperature on arrival at which that is the price.
        """
        driven = [kelvin_price_1_k(_carrier(hours), arrival_k) for hours in PARKED_H]
        places = np.arange(len(driven))
        place = float(np.interp(np.sqrt(max(price_1_k, 0.0)), np.sqrt(driven), places))
        low = min(int(place), len(driven) - 2)
        return self.trips[low].towards(self.trips[low + 1], place - low)


def priced_trips(trips: Mapping[tuple[str, str], TripMap], cycle: str) -> PricedTrips:
    """Return the trips of a cycle by price, from those by cycle and control."""
    return PricedTrips(tuple(trips[cycle, _name(hours)] for hours in PARKED_H))


def trip_at(priced: PricedTrips, use: AgingSettings) -> TripMap:
    """Return the trip at the price of a use."""
    arrival_k = use.parking_air_k + use.pack_above_air_k + ARRIVAL_ABOVE_PARKED_K
    return priced.at(kelvin_price_1_k(use, arrival_k), arrival_k)


def use_in(cell: str, climate: Climate, month: int, **settings: float) -> AgingSettings:
    """Return the settings of the controller for a cell in a climate and a month, 0 for January."""
    monthly_c = climate.monthly_c
    return AgingSettings(
        aging_law=next(setting for setting, law in LAWS.items() if law.name == cell),
        parking_air_k=monthly_c[month] + CELSIUS_ZERO_K,
        parking_air_swing_k=0.5 * climate.daily_range_k,
        year_air_k=float(np.mean(monthly_c)) + CELSIUS_ZERO_K,
        year_air_swing_k=0.5 * (max(monthly_c) - min(monthly_c)),
        service_years=SERVICE_YEARS,
        **settings,
    )


@dataclass(frozen=True)
class OwnLaw:
    """A cell in a use, as the controller is set to it.

    Attributes:
        cell: name of the law of the cell.
        usage: pattern of use.
        climate: place.
        charging: habit of charging.
        year: a year of that use, for what the controller has to be given of it.
    """

    cell: str
    usage: Usage
    climate: Climate
    charging: Charging
    year: Year

    @cached_property
    def _above_air_k(self) -> float:
        rests = self.year.activity == Activity.PARKED
        kelvin = np.asarray(self.year.load.temperature_k)[rests]
        mean_k = float(np.average(kelvin, weights=self.year.duration_s[rests]))
        return max(mean_k - CELSIUS_ZERO_K - float(np.mean(self.climate.monthly_c)), 0.0)

    def use(self, month: int) -> AgingSettings:
        """Return the settings of the controller in a month, 0 for January."""
        capacity_j_k = heat_capacity_j_k(load_parameters().values)
        conductance_w_k = capacity_j_k / PARKED_TIME_CONSTANT_S
        if self.charging.free_cooling:
            conductance_w_k += FREE_COOLING_W_K
        discharge = float(np.max(np.asarray(self.year.load.depth)))
        later = 0.5 * discharge if self.charging.just_in_time else 0.0
        return use_in(
            self.cell,
            self.climate,
            month,
            pack_above_air_k=self._above_air_k,
            parked_time_constant_h=capacity_j_k / conductance_w_k / HOUR_S,
            charging_target=self.charging.target - later,
            charging_c_rate_1_h=self.usage.charging_c_rate_1_h,
            daily_discharge=discharge,
        )

    def trip(self, priced: PricedTrips, month: int) -> TripMap:
        """Return the trip of a month."""
        return trip_at(priced, self.use(month))
