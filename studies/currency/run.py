"""The default and the strategy `prices` against the cars of today: energy, ageing, distance kept, and worth.

Twelve cycles (six published ones, level and on hills) at the headway of `production`, with a perfect preview
and without one, by three cars in three climates. Ageing is judged by laws of measured cells and by
BLAST-Lite, worth by energy and capacity in one currency.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.drives import DEFAULT, trip
from studies.road_space.run import DESIRED_S, EQUAL
from studies.savings import (
    PREVIEWS,
    PRODUCTION,
    PRODUCTION_SIMPLE,
    RULE_PREVIEW,
    kept,
    road_taken,
    saved,
)
from studies.session import Case, Session
from studies.whole_trip import drive_whole_trip

import iptm
from iptm_controller.ocp.stages import NEARLY_DESIRED_M
from iptm_core.metrics.trip_cost import M_PER_100_KM
from iptm_core.parameters import DEFAULT_SET
from iptm_core.physics.car_following import desired_gap_m
from iptm_core.routes.cycles import CYCLE_NAMES
from iptm_core.units import SECONDS_PER_HOUR

PRICES, COOLER = "prices", "prices, pack down to 20 °C"
COOLER_K = {"limits.min_temperature_k": 293.15}
"""Lower limit of the controller only: how far cooling pays in the currency."""
CARS = (DEFAULT_SET, "bmw_i3", "tesla_model_3")
CLIMATES_C = (35.0, 25.0, 10.0)
ROADS: tuple[dict[str, Any], ...] = ({}, {"slope": "large"})
WHOLE = "prices, optimum of the whole trip"
PARTS_OF_COST = ("energy_eur", "driving_eur", "parked_eur", "headway_eur")
USUAL = (CARS[0], CLIMATES_C[0])
"""Where the cooler variant is driven, too, and each trip has a row of its own."""
PLACE = ["car", "ambient_c", "cycle"]
BLAST = "blast"
DRIVERS = (
    (PRODUCTION, False),
    (PRODUCTION_SIMPLE, False),
    (RULE_PREVIEW, True),
    (DEFAULT, True),
    (DEFAULT, False),
    (PRICES, True),
    (PRICES, False),
    (COOLER, True),
    (COOLER, False),
)
"""Control, and whether it has a preview."""
SHORT_S = 60.0
LONGER_S, DEEPER_M = 0.5, 0.05
"""Seconds and metres below s_min by which a car may exceed `production` and count as equal."""
EQUAL_S = 0.1
USUAL_PLACE, OTHER_PLACES = "paper's car, 35 °C", "other cars and climates"


def call_of(
    cycle: str, role: str, car: str, ambient_c: float, *, perfect: bool, road: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a trip."""
    settings = dict(road) if perfect else {**road, "preview_mode": "none"}
    if role not in {DEFAULT, PRICES, COOLER}:
        return trip(cycle, role, car, ambient_c, **settings)
    found = trip(cycle, DEFAULT, car, ambient_c, **EQUAL, **settings)
    further = {} if role == DEFAULT else {"strategy": PRICES}
    return {**found, **further, **({"controller_overrides": COOLER_K} if role == COOLER else {})}


def cases_of(session: Session) -> Iterator[Case]:
    """Yield the trips."""
    cycles, roads = (("us06",), ROADS[:1]) if session.short else (CYCLE_NAMES, ROADS)
    places = product([USUAL] if session.short else product(CARS, CLIMATES_C), roads)
    for ((car, ambient_c), road), cycle in product(places, cycles):
        name = f"{cycle}, hills" if road else cycle
        for role, perfect in DRIVERS:
            if role == COOLER and (car, ambient_c) != USUAL:
                continue
            labels = {
                "car": car,
                "ambient_c": ambient_c,
                "cycle": name,
                "role": role,
                "perfect": perfect,
            }
            call = call_of(cycle, role, car, ambient_c, perfect=perfect, road=road)
            where = "/".join(map(str, labels.values()))
            yield Case(where, labels, call)


def run(session: Session) -> bool:
    """Run the study; returns whether no lead vehicle was touched."""
    cases = list(cases_of(session))
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    optima = _optima(session, cases)
    rows = pd.DataFrame(
        row for _, trips in driven.groupby(PLACE, sort=False) for row in _rows(trips)
    )
    rows[BLAST] = rows.case.map(_by_blast(session, driven))
    shown = rows[rows.role != PRODUCTION]
    keys = ["car", "ambient_c", "role", "perfect", "preview"]
    session.render(
        table=shown[_is_usual(shown)],
        summary=pd.DataFrame(
            _summary(place, part) for place, part in shown.groupby(keys, sort=False)
        ),
        verdicts=list(_verdicts(rows)),
        costs=list(costs(pd.concat([driven, optima], ignore_index=True))),
        equal_s=EQUAL_S,
    )
    return bool((rows.smallest_gap_m > 0.0).all())


def whole_trip(call: Mapping[str, Any]) -> iptm.Run:
    """Return the optimum of a whole trip, which is known from its start on."""
    return drive_whole_trip(iptm.Trip.of(**call))[0]


def _optima(session: Session, cases: list[Case]) -> pd.DataFrame:
    """Return the optima of the level trips at the usual place, in the columns of driven trips."""
    chosen = [
        case
        for case in cases
        if (case.labels["car"], case.labels["ambient_c"]) == USUAL
        and case.labels["role"] == PRICES
        and case.labels["perfect"]
        and "slope" not in case.call
    ]
    names = [f"{case.name}, whole trip" for case in chosen]
    runs = session.compute(whole_trip, [{"call": case.call} for case in chosen], names)
    return pd.DataFrame(
        {**case.labels, "role": WHOLE, "case": name, "run": run}
        for case, name, run in zip(chosen, names, runs, strict=True)
    )


def costs(trips: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield what the problem of `prices` counts, in EUR per 100 km, where its optimum is known.

    The share is what a trip gets of the difference between `production` and the optimum.
    """
    for _, part in trips[trips.run.notna()].groupby(PLACE, sort=False):
        runs = {(each.role, each.perfect): each.run for each in part.itertuples()}
        if (WHOLE, True) not in runs:
            continue
        base, best = runs[PRODUCTION, False], runs[WHOLE, True]
        first, least = (sum(_cost_of(run, base)) for run in (base, best))
        for each in part[part.role != COOLER].itertuples():
            cost = _cost_of(each.run, base)
            yield {
                "cycle": each.cycle,
                "role": each.role,
                "preview": PREVIEWS[bool(each.perfect)],
                **dict(zip(PARTS_OF_COST, cost, strict=True)),
                "eur": sum(cost),
                "share": 100.0 * (first - sum(cost)) / (first - least),
                **saved([each.run.metrics], [base.metrics], each.run.parameters),
                "headway_s": road_taken([each.run.trajectory])["headway_s"],
            }


def _cost_of(run: iptm.Run, base: iptm.Run) -> tuple[float, ...]:
    """Return energy, capacity lost on the way and in the hours after, and headway, in EUR per 100 km."""
    use, cost, way = base.aging_use, run.cost(base.aging_use), run.trajectory
    gap = replace(run.parameters.gap, desired_time_headway_s=DESIRED_S)
    error = (way.gap_m - desired_gap_m(way.speed_m_s, gap))[1:] / NEARLY_DESIRED_M
    squared_m2_s = float(np.sum((np.hypot(1.0, error) - 1.0) * way.intervals_s))
    squared_m2_s *= 2.0 * NEARLY_DESIRED_M**2
    way_100_km = (way.position_m[-1] - way.position_m[0]) / M_PER_100_KM
    headway_eur = use.headway_eur_m2_h / SECONDS_PER_HOUR * squared_m2_s / way_100_km
    return cost.energy_eur, cost.driving_eur, cost.parked_eur, headway_eur


def blast_median(run: iptm.Run, other: iptm.Run) -> float:
    """Return the median saving of ageing by the cells of BLAST-Lite, in percent."""
    return float(run.judge(other, (BLAST,)).summary["median [%]"].iloc[0])


def _by_blast(session: Session, driven: pd.DataFrame) -> dict[str, float]:
    """Return the median of BLAST-Lite for each trip of the default, by its case."""
    if session.short:
        return {}
    base = driven[driven.role == PRODUCTION].set_index(PLACE).run
    own = driven[driven.role == DEFAULT]
    calls = [
        {"run": each.run, "other": base[each.car, each.ambient_c, each.cycle]}
        for each in own.itertuples()
    ]
    names = [f"BLAST-Lite of {case}" for case in own.case]
    return dict(zip(own.case, session.compute(blast_median, calls, names), strict=True))


def _rows(trips: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield a row per trip against `production` on the same road."""
    base = trips[trips.role == PRODUCTION].run.iloc[0]
    if base is None:
        return
    before = road_taken([base.trajectory])
    for each in trips.itertuples():
        if each.run is None:
            continue
        own: iptm.Run = each.run
        costs = own.cost(base.aging_use), base.cost(base.aging_use)
        road = road_taken([own.trajectory])
        yield {
            "case": each.case,
            "car": each.car,
            "ambient_c": each.ambient_c,
            "cycle": each.cycle,
            "role": each.role,
            "perfect": each.perfect,
            "preview": PREVIEWS[bool(each.perfect)],
            **saved([own.metrics], [base.metrics], own.parameters),
            "worth_eur": costs[1].eur - costs[0].eur,
            **road,
            "off_s": road["headway_s"] - before["headway_s"],
            **kept([own.metrics]),
            "smallest_gap_m": float(own.trajectory.gap_m.min()),
            "end_c": own.metrics.final_temperature_k - 273.15,
        }


def _summary(place: tuple[Any, ...], part: pd.DataFrame) -> dict[str, Any]:
    """Return medians and the worst trip of a control."""
    names = ("energy", "energy_as_driven", "ageing", "cells", "worth_eur", "off_s")
    return {
        **dict(zip(("car", "ambient_c", "role", "perfect", "preview"), place, strict=True)),
        "trips": len(part),
        **{name: part[name].median() for name in names},
        **{f"{name}_low": part[name].min() for name in ("energy", "cells", "worth_eur")},
        "below_s": part.below_s.sum(),
        "longest_s": part.longest_s.max(),
        "deepest_m": part.deepest_m.max(),
    }


def _verdicts(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield how many trips of a control keep what is asked of it, and which do not."""
    base = rows[rows.role == PRODUCTION].set_index(PLACE)
    best = rows[rows.role == RULE_PREVIEW].set_index(PLACE).worth_eur
    simple = rows[rows.role == PRODUCTION_SIMPLE].set_index(PLACE).worth_eur
    where = np.where(_is_usual(rows), USUAL_PLACE, OTHER_PLACES)
    for (place, role, perfect), part in rows.groupby([where, "role", "perfect"], sort=False):
        if role not in {DEFAULT, PRICES, COOLER}:
            continue
        own = part.set_index(PLACE)
        cars = base.loc[own.index]
        rivals = simple.loc[own.index].clip(lower=0.0)
        if perfect:
            rivals = np.maximum(rivals, best.loc[own.index])
        kept = {
            "energy is saved": own.energy > 0.0,
            "ageing is saved in the median of the laws": own.cells > 0.0,
            "median and the paper's law agree in sign": np.sign(own.cells) == np.sign(own.ageing),
            **_blast_agrees(own),
            "worth more than the rules": own.worth_eur > rivals,
            "below s_min for no longer": own.below_s <= cars.below_s + LONGER_S,
            "no longer at a stretch": own.longest_s <= cars.longest_s + LONGER_S,
            "no deeper": own.deepest_m <= cars.deepest_m + DEEPER_M,
            "headway within 0.1 s": own.off_s.abs() <= EQUAL_S,
        }
        for what, holds in kept.items():
            missed = own.index[~holds]
            yield {
                "place": place,
                "role": role,
                "preview": PREVIEWS[bool(perfect)],
                "what": what,
                "kept": f"{int(holds.sum())} of {len(holds)}",
                "missed": "; ".join(_name(*place) for place in missed) or "-",
            }


def _blast_agrees(own: pd.DataFrame) -> dict[str, pd.Series]:
    if own[BLAST].isna().all():
        return {}
    return {
        "BLAST-Lite's median and the cells' agree in sign": np.sign(own.cells)
        == np.sign(own[BLAST])
    }


def _name(car: str, ambient_c: float, cycle: str) -> str:
    """Return the place of a trip, short for the paper's car on a hot day."""
    return cycle if (car, ambient_c) == USUAL else f"{cycle} ({car}, {ambient_c:g} °C)"


def _is_usual(rows: pd.DataFrame) -> pd.Series:
    return (rows.car == USUAL[0]) & (rows.ambient_c == USUAL[1])
