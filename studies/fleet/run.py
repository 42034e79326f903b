"""The cars behind in simulated traffic: energy, flow and travel time, at several shares of equipped cars.

Needs requirements/traffic.txt.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.road_space.run import DESIRED_S, EQUAL
from studies.savings import PRODUCTION
from studies.session import Session

from iptm.parts import DEFAULT_SET, DEFAULT_STRATEGY, load_parameters, saved_percent
from iptm_traffic.demand import DemandSettings
from iptm_traffic.fleet import FleetCar, FleetDrive, FleetResult, drive_fleet
from iptm_vehicle_interface.drive_meter import DriveMeter

EVERY = {"5 %": 20, "20 %": 5, "100 %": 1}
"""Distance between equipped cars among those that go all the way, by their share."""
BEHIND = 10
SEEDS = 3
HEADWAY_S = 6.0
DURATION_S, SHORT_S = 420.0, 60.0
STRETCH_M, SHORT_M = 3000.0, 200.0
"""Length that is counted from where a car enters."""


def drive(strategy: str, every: int, seed: int, duration_s: float) -> FleetResult:
    """Drive the corridor with equipped cars of a strategy, the default at the headway of `production`."""
    own = strategy == DEFAULT_STRATEGY
    overrides = EQUAL["overrides"] if own else {}
    return drive_fleet(
        FleetDrive(
            strategy,
            every,
            duration_s,
            DemandSettings(main_headway_s=HEADWAY_S, traffic_seed=seed),
            value_beyond_trip=own,
        ),
        load_parameters(DEFAULT_SET, overrides).values,
    )


def run(session: Session) -> bool:
    """Run the study; returns whether no equipped car met another one."""
    seeds, duration_s, stretch_m = SEEDS, DURATION_S, STRETCH_M
    shares = dict(EVERY)
    if session.short:
        seeds, duration_s, stretch_m, shares = 1, SHORT_S, SHORT_M, {"20 %": 5}
    calls = [
        {"strategy": strategy, "every": every, "seed": seed, "duration_s": duration_s}
        for every, seed, strategy in product(
            shares.values(), range(1, seeds + 1), (DEFAULT_STRATEGY, PRODUCTION)
        )
    ]
    names = ["/".join(str(value) for value in call.values()) for call in calls]
    found = session.compute(drive, calls, names)
    if session.failures:
        return False
    driven = {
        (call["every"], call["strategy"], call["seed"]): result
        for call, result in zip(calls, found, strict=True)
    }
    rows = []
    for share, every in shares.items():
        own, base = (
            [driven[every, strategy, seed] for seed in range(1, seeds + 1)]
            for strategy in (DEFAULT_STRATEGY, PRODUCTION)
        )
        rows.append({"share": share, **against(own, base, stretch_m)})
    table = pd.DataFrame(rows)
    session.render(
        table=table,
        seeds=seeds,
        headway_s=HEADWAY_S,
        stretch_km=stretch_m / 1e3,
        minutes=duration_s / 60.0,
        desired_s=DESIRED_S,
        behind=BEHIND,
    )
    return not (table.collisions + table.base_collisions).any()


def against(
    own: Sequence[FleetResult], base: Sequence[FleetResult], stretch_m: float
) -> dict[str, float]:
    """Return what traffic with equipped cars of one strategy saves against the same with another one."""
    of_own, of_base = (
        pd.DataFrame(
            {"seed": seed, **row}
            for seed, result in enumerate(results)
            for row in rows_of(result.cars, stretch_m)
        )
        for results in (own, base)
    )
    both = of_own.merge(of_base, on=["seed", "name"], suffixes=("", "_base")).dropna()
    percent: dict[str, float] = {}
    for part, rows in {
        "equipped": both[both.equipped],
        "behind": both[both.is_behind],
        "all": both,
    }.items():
        percent[part] = len(rows)
        for kind in ("energy_j", "ageing"):
            percent[f"{part}_{kind}"] = saved_percent(rows[kind].sum(), rows[f"{kind}_base"].sum())
        percent[f"{part}_time_s"] = float((rows.time_s - rows.time_s_base).mean())
    ways_m = [
        sum(
            float(np.minimum(car.driven_m[-1], stretch_m))
            for result in results
            for car in result.cars
        )
        for results in (own, base)
    ]
    gaps_m = [
        [car.smallest_gap_m for result in results for car in result.cars] for results in (own, base)
    ]
    return {
        **percent,
        "flow": 100.0 * ways_m[0] / ways_m[1],
        "smallest_gap_m": min(gaps_m[0]),
        "base_smallest_gap_m": min(gaps_m[1]),
        "collisions": sum(len(result.collisions) for result in own),
        "base_collisions": sum(len(result.collisions) for result in base),
    }


def rows_of(cars: Sequence[FleetCar], stretch_m: float) -> Iterable[dict[str, Any]]:
    """Yield time (NaN where a car did not reach the end), energy and ageing of each car on the stretch."""
    places = [place for place, car in enumerate(cars) if car.equipped]
    for place, car in enumerate(cars):
        meter = DriveMeter(load_parameters().values)
        on_it = car.driven_m <= stretch_m
        for time_s, speed_m_s in zip(car.time_s[on_it], car.speed_m_s[on_it], strict=True):
            meter.take(float(time_s), float(speed_m_s))
        reached = bool(car.driven_m[-1] >= stretch_m)
        end_s = float(np.interp(stretch_m, car.driven_m, car.time_s)) if reached else np.nan
        yield {
            "name": car.name,
            "equipped": car.equipped,
            "is_behind": any(0 < place - ahead <= BEHIND for ahead in places),
            "time_s": end_s - float(car.time_s[0]),
            "energy_j": meter.reading.battery_energy_j,
            "ageing": meter.reading.capacity_loss,
        }
