"""Parked hours planned, against three rules: capacity after eight years, by two judges.

Judges are the law that planned and BLAST-Lite. Trips are those of the car of today; what differs is when and
how far the pack is charged, and when it is cooled while the car stands. All weeks of a rule and of the plan
pass in the same simulation.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.drives import DEFAULT, trip
from studies.plan import doors
from studies.savings import PRODUCTION
from studies.session import Session

import iptm
from iptm.climate import CLIMATES, climate_of
from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.parameters.model import ModelParameters
from iptm_core.units import CELSIUS_ZERO_K
from iptm_judges.blast_lite import MODELS, models
from iptm_life.life import SERVICE_YEARS, driven_map
from iptm_life.trip_map import START_C, TripMap
from iptm_life.year import USAGES
from iptm_plan.day_plan import Fineness
from iptm_plan.rules import RULES
from iptm_plan.years import PLAN, PlannedYears, Weeks

JUDGES = {
    "NCA": "NCA (Panasonic)",
    "NMC111": "NMC111 (Kokam)",
    "NMC111 (18650)": "NMC111 (Sanyo)",
    "NMC622": "NMC622 (DENSO)",
    "LFP": "LFP (250 Ah)",
}
"""Cells with their judges. NMC811-Si loses half of its capacity in these years, which no test covers."""
EQUAL: Mapping[str, Any] = {
    "overrides": {"gap.desired_time_headway_s": 1.7},
    "value_beyond_trip": True,
}
MONTHS = (0, 6)
"""January and July stand for half a year each."""
POINTS, ENERGY = 0.05, 0.01
"""By which a plan may be worse than the best rule: percentage points of capacity, share of the energy."""
WANTED_POINTS, WANTED_SIGNS = 5.0, 0.9
SHORT_S, SHORT_START_C = 60.0, (22.0, 36.0)
SHORT_FINENESS = Fineness(21, 3.0, (0.0, 1.0), (1.0,), passes=2)
_REFERENCE = ("NCA", "Phoenix", "commuter")


@lru_cache(maxsize=4)
def _trips(cycle: str, control: str, *, short: bool) -> tuple[TripMap, ModelParameters]:
    more: Mapping[str, Any] = EQUAL if control == DEFAULT else {}
    run = iptm.simulate(**trip(cycle, control, **more, duration_s=SHORT_S if short else None))
    return driven_map(run, SHORT_START_C if short else START_C), run.parameters


def years(
    cell: str, climate: str, usage: str, control: str, *, short: bool
) -> list[dict[str, Any]]:
    """Return a row for each rule and the plan: capacity lost by both judges in %, energy, and cost."""
    law, habit = AGING_CELLS[cell].law, next(each for each in USAGES if each.name == usage)
    driven, parameters = _trips(habit.cycle, control, short=short)
    rows: list[dict[str, Any]] = []
    weeks_of: dict[str, Weeks] = {}
    for by in (*RULES, PLAN):
        planned = PlannedYears(habit, by, months=MONTHS)
        if short:
            planned = replace(planned, fineness=SHORT_FINENESS)
        weeks = planned.weeks(law, climate_of(climate), driven, parameters)
        weeks_of[by] = weeks
        charges = [np.mean(week.charge) for _, week in weeks.parts]
        rows.append(
            {
                "cell": cell,
                "climate": climate,
                "usage": usage,
                "control": control,
                "by": by,
                "own": 100.0 * weeks.loss(law, parameters),
                "kwh": weeks.grid_kwh(parameters),
                "eur": weeks.cost_eur(law, planned.prices, parameters),
                "charge": 100.0 * float(np.mean(charges)),
            }
        )
    least = min(rows[:-1], key=lambda row: float(row["own"]))["by"]
    everywhere = (cell, climate, usage) == _REFERENCE
    for row in rows:  # the judge takes a while
        judged = everywhere or row["by"] in {least, PLAN}
        row["judged"] = 100.0 * judged_loss(cell, weeks_of[row["by"]]) if judged else np.nan
    return rows


def judged_loss(cell: str, weeks: Weeks) -> float:
    """Return the loss after the years of service by BLAST-Lite, which counts cycles itself."""
    times, charges, celsius, begin_s = [], [], [], 0.0
    for days, week in weeks.parts:
        duration_s, _, kelvin, _, charge = week.rows.T
        ends_s = np.cumsum(duration_s)
        for _ in range(round(days / 7.0)):
            times.append(begin_s + ends_s - 0.5 * duration_s)
            charges.append(charge)
            celsius.append(kelvin - CELSIUS_ZERO_K)
            begin_s += float(ends_s[-1])
    columns = [np.concatenate(each) for each in (times, charges, celsius)]
    columns = [np.append(each[0] * (number > 0), each) for number, each in enumerate(columns)]
    model = getattr(models, MODELS[JUDGES[cell]])()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy, about names that it still has
        model.simulate_battery_life(
            dict(zip(("Time_s", "SOC", "Temperature_C"), columns, strict=True)),
            threshold_time=SERVICE_YEARS,
            is_conserve_energy_throughput=False,
        )
    return 1.0 - float(model.outputs["q"][-1])


def cases(*, short: bool, whole: bool) -> Iterator[dict[str, Any]]:
    """Yield the arguments of `years`."""
    names = ("cell", "climate", "usage")
    reference = dict(zip(names, _REFERENCE, strict=True))
    uses = USAGES if whole else USAGES[:1]
    for cell, climate, usage in () if short else product(JUDGES, CLIMATES, uses):
        place = {"cell": cell, "climate": climate.name, "usage": usage.name}
        yield {**place, "control": PRODUCTION, "short": False}
    yield (
        {**reference, "control": PRODUCTION, "short": True}
        if short
        else {**reference, "control": DEFAULT, "short": False}
    )


def run(session: Session) -> bool:
    """Run the study; returns whether every year was computed."""
    form = {"short": session.short, "whole": session.options.whole}
    calls, trips = list(cases(**form)), doors.calls(**form)
    found = session.compute(years, calls, [_name(each) for each in calls])
    arrived = session.compute(doors.arrival, trips, [_name(each) for each in trips])
    if session.failures:
        return False
    rows = pd.DataFrame(row for part in found for row in part)
    table = pd.DataFrame(_compared(rows))
    session.render(
        table=table,
        verdict=_verdict(table),
        reference=_reference(rows),
        points=POINTS,
        energy=100.0 * ENERGY,
        service=SERVICE_YEARS,
        **doors.values(arrived),
    )
    return True


def _name(call: Mapping[str, Any]) -> str:
    return ", ".join(str(each) for each in call.values())


def _compared(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    keys = ["cell", "climate", "usage", "control"]
    for place, part in rows.groupby(keys, sort=False):
        by = part.set_index("by")
        plan, rules = by.loc[PLAN], by.loc[list(RULES)]
        best = rules.loc[rules.eur.idxmin()]
        least = rules.loc[rules.own.idxmin()]
        yield {
            **dict(zip(keys, place, strict=True)),
            **{f"own_{number}": float(rules.own.iloc[number]) for number in range(len(RULES))},
            "own": plan.own,
            "judged": plan.judged,
            "best": best.name,
            "saved": least.own - plan.own,
            "saved_judged": least.judged - plan.judged,
            "energy": 100.0 * (plan.kwh / least.kwh - 1.0),
            "eur": (best.eur - plan.eur) / SERVICE_YEARS,
            "charge": plan.charge,
        }


def _verdict(table: pd.DataFrame) -> Mapping[str, Any]:
    shown = table[table.control == PRODUCTION]
    clear = shown[shown.saved.abs() > POINTS]
    confirmed = (clear.saved * clear.saved_judged > 0.0).mean() if len(clear) else np.nan
    return {
        "cases": len(shown),
        "not_worse": int((shown.saved >= -POINTS).sum()),
        "thrifty": int((shown.energy <= 100.0 * ENERGY).sum()),
        "most_energy": float(shown.energy.max()),
        "thirsty_eur": float(shown.eur[shown.energy > 100.0 * ENERGY].min()),
        "cheaper": int((shown.eur >= 0.0).sum()),
        "least_eur": float(shown.eur.min()),
        "signs": len(clear),
        "confirmed": 100.0 * confirmed,
        "median": float(shown.saved.median()),
        "median_judged": float(shown.saved_judged.median()),
    }


def _reference(rows: pd.DataFrame) -> list[dict[str, Any]]:
    cell, climate, usage = _REFERENCE
    at = rows[(rows.cell == cell) & (rows.climate == climate) & (rows.usage == usage)]
    base = at[(at.control == PRODUCTION) & (at.by == next(iter(RULES)))].iloc[0]
    return [
        {
            "control": each.control,
            "by": each.by,
            "own": each.own,
            "judged": each.judged,
            "saved": base.own - each.own,
            "saved_judged": base.judged - each.judged,
            "kwh": each.kwh,
            "charge": each.charge,
        }
        for each in at.itertuples()
    ]
