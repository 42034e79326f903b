"""The default and the strategy `prices` against the cars of today: energy, ageing, distance kept, and worth.

Twelve cycles (six published ones, level and on hills) at the headway of `production`, with a perfect preview
and without one; and the six level ones with other cars and in other climates. Ageing is judged by laws of
measured cells, worth by energy and capacity in one currency.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.currency import bound
from studies.drives import DEFAULT, trip
from studies.road_space.run import EQUAL
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

import iptm
from iptm_core.parameters import DEFAULT_SET
from iptm_core.routes.cycles import CYCLE_NAMES

PRICES, COOLER = "prices", "prices, pack down to 20 °C"
COOLER_K = {"limits.min_temperature_k": 293.15}
"""Lower limit of the controller only: how far cooling pays in the currency."""
CARS = (DEFAULT_SET, "bmw_i3", "tesla_model_3")
CLIMATES_C = (35.0, 25.0, 10.0)
ROADS: tuple[dict[str, Any], ...] = ({}, {"slope": "large"})
USUAL = (CARS[0], CLIMATES_C[0])
OTHERS = (*((car, CLIMATES_C[0]) for car in CARS[1:]), *((CARS[0], c) for c in CLIMATES_C[1:]))
"""Where the level cycles are driven, too, without the cooler variant."""
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
    places = [(USUAL, road) for road in roads]
    if session.options.whole:
        places = list(product(product(CARS, CLIMATES_C), roads))
    elif not session.short:
        places += [(other, ROADS[0]) for other in OTHERS]
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


def _bound_calls(*, short: bool) -> Iterator[dict[str, Any]]:
    """Yield the arguments of `bound.costs` for the level cycles."""
    car, ambient_c = USUAL
    for cycle in ("us06",) if short else CYCLE_NAMES:
        trips = {
            name: call_of(cycle, role, car, ambient_c, perfect=perfect, road=ROADS[0])
            | ({"duration_s": SHORT_S} if short else {})
            for name, role, perfect in (
                ("production", PRODUCTION, False),
                ("priced", PRICES, True),
                ("unseen", PRICES, False),
            )
        }
        yield {"cycle": cycle, **trips}


def run(session: Session) -> bool:
    """Run the study; returns whether no lead vehicle was touched."""
    cases = list(cases_of(session))
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    places = ["car", "ambient_c", "cycle"]
    rows = pd.DataFrame(
        row for _, trips in driven.groupby(places, sort=False) for row in _rows(trips)
    )
    calls = list(_bound_calls(short=session.short))
    names = [f"{each['cycle']}, whole trip" for each in calls]
    bounds = [each for each in session.compute(bound.costs, calls, names) if each is not None]
    shown = rows[rows.role != PRODUCTION]
    keys = ["car", "ambient_c", "role", "perfect", "preview"]
    session.render(
        table=shown,
        summary=pd.DataFrame(
            _summary(place, part) for place, part in shown.groupby(keys, sort=False)
        ),
        verdicts=list(_verdicts(rows)),
        bounds=bounds,
        equal_s=EQUAL_S,
    )
    return bool((rows.smallest_gap_m > 0.0).all())


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
    places = ["car", "ambient_c", "cycle"]
    base = rows[rows.role == PRODUCTION].set_index(places)
    best = rows[rows.role == RULE_PREVIEW].set_index(places).worth_eur
    simple = rows[rows.role == PRODUCTION_SIMPLE].set_index(places).worth_eur
    where = np.where(_is_usual(rows), USUAL_PLACE, OTHER_PLACES)
    for (place, role, perfect), part in rows.groupby([where, "role", "perfect"], sort=False):
        if role not in {DEFAULT, PRICES, COOLER}:
            continue
        own = part.set_index(places)
        cars = base.loc[own.index]
        rivals = simple.loc[own.index].clip(lower=0.0)
        if perfect:
            rivals = np.maximum(rivals, best.loc[own.index])
        kept = {
            "energy is saved": own.energy > 0.0,
            "ageing is saved in the median of the laws": own.cells > 0.0,
            "median and the paper's law agree in sign": np.sign(own.cells) == np.sign(own.ageing),
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


def _name(car: str, ambient_c: float, cycle: str) -> str:
    """Return the place of a trip, short for the paper's car on a hot day."""
    return cycle if (car, ambient_c) == USUAL else f"{cycle} ({car}, {ambient_c:g} °C)"


def _is_usual(rows: pd.DataFrame) -> pd.Series:
    return (rows.car == USUAL[0]) & (rows.ambient_c == USUAL[1])
