"""Trips whose end has the price that the hours behind it make, against the constant price of a law.

Both are controlled by the strategy that prices energy, ageing and headway, with the law of an NCA cell. What
is compared is what the trip costs in all: energy at its price on arrival, ageing on the way, and what the
temperature on arrival costs in the hours that follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from studies.drives import trip
from studies.life.charging_stop import HEATER_W, arrival_k
from studies.life.fast_charge import ChargingStopSettings, arrival_cost_eur

import iptm
from iptm_controller.arrival import ArrivalCost
from iptm_core.aging_laws.cells import NCA
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_life.trip_map import compressor_j, mean_cell_k
from iptm_plan.day_plan import DayPlan
from iptm_plan.pack import AgingPrice, ParkedPack
from iptm_plan.profile import arrival_table
from iptm_plan.schedule import Departure, Schedule, trip_of

CYCLES = ("us06", "wltc_class3b")
HOT_C, COLD_C = 35.0, -5.0
PARKED_LONG, NIGHT, SHORT_STOP, CHARGE = (
    "9 h without a plug",
    "night at the plug",
    "half an hour",
    "fast charge",
)
SITUATIONS = (
    (PARKED_LONG, HOT_C),
    (NIGHT, HOT_C),
    (SHORT_STOP, HOT_C),
    (CHARGE, HOT_C),
    (PARKED_LONG, COLD_C),
    (CHARGE, COLD_C),
)
CONSTANT, PLANNED = "constant", "planned"
MINUTE_KWH = 0.8
"""A minute at the fast charger: 0.2 EUR at 0.25 EUR/kWh, 12 EUR an hour: chosen."""
HOME_W = 7400.0
TRIP_KWH, TRIP_S = 4.0, 1800.0
_HOURS = 48


def calls(*, short: bool, whole: bool) -> list[dict[str, Any]]:
    """Return the arguments of `arrival`."""
    cycles = CYCLES if whole else CYCLES[:1]
    situations = SITUATIONS[-1:] if short else SITUATIONS
    duration_s = 120.0 if short else None
    return [
        {"cycle": cycle, "ahead": ahead, "air_c": air_c, "duration_s": duration_s}
        for cycle, (ahead, air_c) in product(cycles, situations)
    ]


def arrival(cycle: str, ahead: str, air_c: float, duration_s: float | None) -> list[dict[str, Any]]:
    """Return a row for the trip at the constant and at the planned price of its end."""
    heater = {"limits.max_heater_power_w": HEATER_W, "gap.desired_time_headway_s": 1.7}
    call = trip(cycle, ambient_c=air_c, overrides=heater, duration_s=duration_s)
    call |= {"strategy": "prices", "aging_law": "nca"}
    parameters = load_parameters(overrides=call["overrides"]).values
    price = AgingPrice.of(NCA.law, AgingSettings(aging_law="nca"), parameters)
    text = cost_on_arrival(ahead, air_c, parameters, price)
    cost = ArrivalCost.parse(text)
    if cost is None:
        raise AssertionError("a cost was made")
    rows = []
    for priced, given in ((CONSTANT, ""), (PLANNED, text)):
        run = iptm.simulate(**call, arrival_cost_eur=given)
        driven, kelvin = run.trajectory, mean_cell_k(run.trajectory)
        step_s = driven.intervals_s
        kwh = run.metrics.battery_energy_j / J_PER_KWH
        c_rate = np.diff(driven.state_of_charge) / step_s * 3600.0
        end_c = arrival_k(run) - CELSIUS_ZERO_K
        at = driven.state_of_charge[1:], kelvin[1:]
        aging = price.calendar_eur_s(*at) + price.cyclic_eur_s(*at, c_rate)
        parts = {
            "energy_eur": kwh * AgingSettings.electricity_eur_kwh,
            "aging_eur": float(np.dot(aging, step_s)),
            "arrival_eur": float(np.interp(end_c, cost.celsius, cost.eur)),
        }
        rows.append(
            {
                "cycle": cycle,
                "ahead": ahead,
                "air_c": air_c,
                "price": priced,
                "end_c": end_c,
                "thermal_kwh": thermal_kwh(run),
                "kwh": kwh,
                **parts,
                "eur": sum(parts.values()),
            }
        )
    return rows


def thermal_kwh(run: iptm.Run) -> float:
    """Return the energy of compressor and heater, the heater's negative."""
    return compressor_j(run.trajectory) / J_PER_KWH


@lru_cache(maxsize=16)
def cost_on_arrival(
    ahead: str, air_c: float, parameters: ModelParameters, price: AgingPrice
) -> str:
    """Return the cost of each temperature on arrival, as the setting of a trip."""
    if ahead == CHARGE:
        return arrival_cost_eur(ChargingStopSettings(charging_minute_kwh=MINUTE_KWH), parameters)
    leaves: Mapping[str, float] = {PARKED_LONG: 9.0, NIGHT: 13.0, SHORT_STOP: 0.5}
    plug_w = HOME_W if ahead == NIGHT else 0.0
    next_trip = trip_of(TRIP_KWH * J_PER_KWH, TRIP_S, parameters)
    steps = 4 * _HOURS
    first = Departure(round(4.0 * leaves[ahead]), next_trip, charger_w=HOME_W)
    schedule = Schedule(
        np.full(steps, air_c + CELSIUS_ZERO_K),
        np.full(steps, AgingSettings.electricity_eur_kwh),
        plug_w,
        (first,),
    )
    plan = DayPlan(schedule, ParkedPack(parameters), price)
    return arrival_table(plan, 0, 0, parameters.charge.initial_charge)


def values(arrived: Sequence[list[dict[str, Any]]]) -> dict[str, Any]:
    """Return what the page shows of the arrivals: a row for each trip, and how many are better."""
    rows = []
    for before, after in arrived:
        more = {f"{name}_planned": value for name, value in after.items()}
        rows.append({**before, **more, "saved": 100.0 * (1.0 - after["eur"] / before["eur"])})
    saved = [row["saved"] for row in rows]
    return {
        "arrivals": rows,
        "arrived": {
            "trips": len(rows),
            "better": sum(each > 0.0 for each in saved),
            "least": min(saved),
            "minute_eur": MINUTE_KWH * AgingSettings.electricity_eur_kwh,
        },
    }
