"""Trips of the default strategy with the ageing law of a cell, as a function of the price of a kelvin.

What the strategy does with a law depends on the capacity that a kelvin more on arrival costs, and hardly on
the rest of the law: trips are driven at a few prices of a kelvin, which the time constant of the parked pack
makes under one law, and interpolated to the price of a cell, a climate, a month and a habit of charging.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from studies.drives import DEFAULT
from studies.life.trips import trip_case
from studies.session import Case

from iptm.climate import HOUR_S, Climate
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.parameters import load_parameters
from iptm_core.units import CELSIUS_ZERO_K
from iptm_life.life import SERVICE_YEARS
from iptm_life.trip_map import START_C, TripMap, heat_capacity_j_k
from iptm_life.year import (
    CITY,
    FREE_COOLING_W_K,
    MOTORWAY,
    PARKED_TIME_CONSTANT_S,
    Activity,
    Usage,
    Year,
)

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


def priced_cases(start_c: Sequence[float] = START_C) -> list[Case]:
    """Return the trips of the default strategy of all cycles, prices of a kelvin and temperatures."""
    return [
        trip_case(cycle, DEFAULT, celsius, _carrier(hours), _name(hours))
        for cycle in (CITY, MOTORWAY)
        for hours in PARKED_H
        for celsius in start_c
    ]


def _carrier(parked_h: float) -> AgingSettings:
    return replace(_CARRIER, parked_time_constant_h=parked_h)


def _name(parked_h: float) -> str:
    return f"parked_{parked_h:g}"


def kelvin_price_1_k(use: AgingSettings, arrival_k: float) -> float:
    """Return what a kelvin more on arrival costs, as a share of nominal capacity."""
    parked = ParkedAging(LAWS[use.aging_law], use, use.parking_air_k)
    return float(parked.kelvin_price_1_k(np.array([arrival_k]))[0])


def priced_trips(trips: Mapping[tuple[str, str], TripMap], cycle: str) -> list[TripMap]:
    """Return the trips of a cycle at the prices of `PARKED_H`, from those by cycle and control."""
    return [trips[cycle, _name(hours)] for hours in PARKED_H]


def trip_at_price(priced: Sequence[TripMap], price_1_k: float, arrival_k: float) -> TripMap:
    """Return the trip at a price: linear in its square root, beyond the driven ones the nearest.

    Args:
        priced: the trips at the prices of `PARKED_H`.
        price_1_k: price of a kelvin, as a share of nominal capacity.
        arrival_k: temperature on arrival at which that is the price.
    """
    driven = [kelvin_price_1_k(_carrier(hours), arrival_k) for hours in PARKED_H]
    places = np.arange(len(driven))
    place = float(np.interp(np.sqrt(max(price_1_k, 0.0)), np.sqrt(driven), places))
    low = min(int(place), len(driven) - 2)
    return priced[low].towards(priced[low + 1], place - low)


def trip_at(priced: Sequence[TripMap], use: AgingSettings) -> TripMap:
    """Return the trip at the price of a use."""
    arrival_k = use.parking_air_k + use.pack_above_air_k + ARRIVAL_ABOVE_PARKED_K
    return trip_at_price(priced, kelvin_price_1_k(use, arrival_k), arrival_k)


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


def uses_of(cell: str, usage: Usage, climate: Climate, year: Year) -> list[AgingSettings]:
    """Return the settings of the controller for a cell in every month of a use.

    Args:
        cell: name of the law of the cell.
        usage: pattern of use.
        climate: place.
        year: a year of that use, for what the controller has to be given of it.
    """
    rests = year.activity == Activity.PARKED
    parked_k = np.average(
        np.asarray(year.load.temperature_k)[rests], weights=year.duration_s[rests]
    )
    above_air_k = float(parked_k) - CELSIUS_ZERO_K - float(np.mean(climate.monthly_c))
    capacity_j_k = heat_capacity_j_k(load_parameters().values)
    conductance_w_k = capacity_j_k / PARKED_TIME_CONSTANT_S
    if usage.free_cooling:
        conductance_w_k += FREE_COOLING_W_K
    discharge = float(np.max(np.asarray(year.load.depth)))
    later = 0.5 * discharge if usage.just_in_time else 0.0
    settings = {
        "pack_above_air_k": max(above_air_k, 0.0),
        "parked_time_constant_h": capacity_j_k / conductance_w_k / HOUR_S,
        "charging_target": usage.target - later,
        "charging_c_rate_1_h": usage.charging_c_rate_1_h,
        "daily_discharge": discharge,
    }
    return [use_in(cell, climate, month, **settings) for month in range(12)]
