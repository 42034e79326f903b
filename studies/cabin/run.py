"""What cabin and cold cost: three baselines, four refrigerants, causes, predictive control, the front table.

84 trips of baselines take two to three minutes, a trip one to two seconds.

Trips of real cars with a cabin. Comfort stands beside every saving of the predictive climate control.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.cabin import recorded, second_program
from studies.drives import DEFAULT, STRATEGIES
from studies.savings import PRODUCTION, saved
from studies.session import Session

import iptm
from iptm_cabin.cold_car import cold_overrides
from iptm_cabin.cycle_map import Refrigerant, cycle_map
from iptm_cabin.parameters import ClimateControl, read_cabin
from iptm_cabin.predictive import STEP_S, value_of_states_j_k
from iptm_cabin.thermal_model import CabinModel
from iptm_cabin.trips import comfort, drive_with_cabin, limited_s
from iptm_core.parameters import load_parameters
from iptm_core.units import CELSIUS_ZERO_K

CYCLES = ("wltc_class3b", "us06", "hwfet")
AIR_C = (-20.0, -10.0, 0.0, 10.0, 20.0, 35.0, 40.0)
CONTROLS = tuple(
    str(each) for each in (ClimateControl.RULE, ClimateControl.ALONE, ClimateControl.PUBLISHED)
)
CARS = {
    "tesla_model_3": "mid_size.cabin",
    "bmw_i3": "bmw_i3.cabin",
    "chevrolet_bolt": "chevrolet_bolt.cabin",
    "paper_calibrated": "mid_size.cabin",
}
GRID_CAR, FRONT_CAR, PREDICTED_CAR = "tesla_model_3", "paper_calibrated", "paper_calibrated"
SUNNY_C, SUN_W_M2 = 30.0, 700.0
WARM_C, COLD_C = 20.0, -10.0
PREDICTED_C, FRONT_C = (35.0, -5.0), (35.0, -10.0)
PRICES = {
    35.0: {"warm_up_price_w_k2": 16.0, "comfort_price_w_k2": 150.0, "set_point_c": 21.7},
    -5.0: {"warm_up_price_w_k2": 1.0, "comfort_price_w_k2": 130.0, "set_point_c": 22.3},
}
"""Of comfort, and the set point of the plan, with which rms and mean are the thermostat's or better."""
QUICK = {-5.0: {"warm_up_price_w_k2": 36.0}}
"""With which the cabin is within 2 K as early as the thermostat's, too, where it is not by `PRICES`."""
EQUAL: Mapping[str, Any] = {"value_beyond_trip": True}
HEADWAY = {"gap.desired_time_headway_s": 1.7}
COMPARED, COMPARED_QUICK = (
    ("rule", "alone", "predictive", "optimum"),
    ("predictive, quick", "optimum, quick"),
)
JUDGES = ("paper", "cells", "blast")
J_KWH, SHORT_S = 3.6e6, 60.0


def day(air_c: float) -> dict[str, float]:
    """Return the sun of a day at a temperature of the air."""
    return {"sun_w_m2": SUN_W_M2 if air_c >= SUNNY_C else 0.0}


def drive(
    cycle: str,
    car: str,
    air_c: float,
    changes: Mapping[str, Any],
    role: str = PRODUCTION,
    overrides: Mapping[str, float] | None = None,
    **settings: Any,
) -> tuple[iptm.Run, pd.DataFrame]:
    """Drive a trip of a car that stood in air of a temperature."""
    strategy, horizon = STRATEGIES[role]
    given = {name: value for name, value in settings.items() if value is not None}
    return drive_with_cabin(
        cycle,
        CARS[car],
        {**day(air_c), **changes},
        vehicle=car,
        strategy=strategy,
        horizon=horizon,
        overrides={**cold_overrides(car, air_c), **(overrides or {})},
        **given,
    )


def figures(run: iptm.Run, table: pd.DataFrame, set_point_c: float = 22.0) -> dict[str, float]:
    """Return consumption, thermal energy, comfort, pack and limits of a trip."""
    frame = run.frame
    step_s = float(table.index[1] - table.index[0])
    ends_k = frame.cell_1_temperature_k.to_numpy(), frame.cell_n_temperature_k.to_numpy()
    return {
        "consumption": float(run.figures["consumption"]),
        "thermal_kwh": float(table.electric_w.sum()) * step_s / J_KWH,
        "ptc_kwh": float(table.ptc_w.sum()) * step_s / J_KWH,
        "aging": float(run.figures["total_degradation"]),
        "pack_end_c": 0.5 * (ends_k[0][-1] + ends_k[1][-1]) - CELSIUS_ZERO_K,
        "limited_s": limited_s(table),
        "compressor_s": limited_s(table, "is_compressor_limited"),
        **comfort(table, set_point_c),
    }


def ambient(
    cycle: str, air_c: float, control: str, refrigerant: str, duration_s: float | None
) -> dict[str, Any]:
    """Return a row of the grid of temperatures."""
    changes = {"control": control, "refrigerant": refrigerant}
    run, table = drive(cycle, GRID_CAR, air_c, changes, duration_s=duration_s)
    labels = {"cycle": cycle, "air_c": air_c, "control": control, "refrigerant": refrigerant}
    return {**labels, **figures(run, table)}


def causes(car: str, duration_s: float | None) -> dict[str, Any]:
    """Return what each cause adds at -10 degC, one after the other, in per cent of the consumption at 20."""
    cycle = CYCLES[0]
    strategy: dict[str, Any] = {"strategy": PRODUCTION, "duration_s": duration_s}
    warm_run, _ = drive(cycle, car, WARM_C, {"control": "alone"}, duration_s=duration_s)
    cold = cold_overrides(car, COLD_C)
    tyre = cold.pop("body.rolling_resistance")
    given = {key: value for key, value in strategy.items() if value is not None}
    base = iptm.simulate(cycle, vehicle=car, overrides=cold_overrides(car, WARM_C), **given)
    air = iptm.simulate(cycle, vehicle=car, overrides=cold, **given)
    tyres = iptm.simulate(
        cycle, vehicle=car, overrides={**cold, "body.rolling_resistance": tyre}, **given
    )
    alone, _ = drive(cycle, car, COLD_C, {"control": "alone"}, duration_s=duration_s)
    whole, table = drive(cycle, car, COLD_C, {"control": "rule"}, duration_s=duration_s)
    used = [float(each.figures["consumption"]) for each in (base, air, tyres, alone, whole)]
    warm = float(warm_run.figures["consumption"])
    return {
        "car": car,
        "warm": warm,
        "cold": used[-1],
        "more": 100.0 * (used[-1] / warm - 1.0),
        "air_cells": 100.0 * (used[1] - used[0]) / warm,
        "tyres": 100.0 * (used[2] - used[1]) / warm,
        "cabin": 100.0 * (used[3] - used[2] - (warm - used[0])) / warm,
        "pack": 100.0 * (used[4] - used[3]) / warm,
        "thermal_share": 100.0
        * figures(whole, table)["thermal_kwh"]
        * J_KWH
        / float(whole.metrics.battery_energy_j),
        "compressor_s": limited_s(table, "is_compressor_limited"),
    }


def controlled(control: str, air_c: float) -> dict[str, Any]:
    """Return the changes of a cabin's file for a climate control.

    ``optimum`` plans the whole trip, ``quick`` has the prices `QUICK`.
    """
    if control in CONTROLS:
        return {"control": control}
    changes: dict[str, Any] = {"control": "predictive", "way_ahead": CYCLES[0], **PRICES[air_c]}
    changes |= {"horizon_s": 1800.0} if "optimum" in control else {}
    return changes | (QUICK[air_c] if "quick" in control else {})


def predicted(air_c: float, control: str, duration_s: float | None) -> dict[str, Any]:
    """Return a trip with one climate control; ``optimum`` plans the whole trip once."""
    cycle, car = CYCLES[0], PREDICTED_CAR
    run, table = drive(cycle, car, air_c, controlled(control, air_c), duration_s=duration_s)
    found = figures(run, table)
    model = CabinModel(read_cabin(CARS[car]), load_parameters(car).values)
    value = value_of_states_j_k(model, air_c + CELSIUS_ZERO_K)
    last = table.iloc[-1]
    left_k = np.array([last.air_k, last.interior_k, last.core_k]) - (22.0 + CELSIUS_ZERO_K)
    left_kwh = float(np.dot(value[:3], left_k)) / J_KWH
    return {
        "air_c": air_c,
        "control": control,
        **found,
        "equal_kwh": found["thermal_kwh"] - left_kwh,
        "ohmic_kwh": float(run.metrics.cell_heat_j) / J_KWH,
    }


def front(cycle: str, air_c: float, duration_s: float | None) -> dict[str, Any]:
    """Return the savings of the default against the car of today, with the cabin on, at its road space."""
    trips = {
        role: drive(
            cycle,
            FRONT_CAR,
            air_c,
            {"control": "command"},
            role,
            HEADWAY if role == DEFAULT else None,
            duration_s=duration_s,
            **(EQUAL if role == DEFAULT else {}),
        )
        for role in (PRODUCTION, DEFAULT)
    }
    (base, of_base), (own, of_own) = trips[PRODUCTION], trips[DEFAULT]
    found = saved([own.metrics], [base.metrics], base.parameters)
    return {
        "cycle": cycle,
        "air_c": air_c,
        **found,
        "headway_s": float(own.figures["mean_headway"]),
        "base_headway_s": float(base.figures["mean_headway"]),
        "base_consumption": float(base.figures["consumption"]),
        "own_consumption": float(own.figures["consumption"]),
        "base_limited_s": limited_s(of_base),
        "own_limited_s": limited_s(of_own),
        "base_compressor_s": limited_s(of_base, "is_compressor_limited"),
        "own_compressor_s": limited_s(of_own, "is_compressor_limited"),
        "thermal_share": 100.0
        * figures(base, of_base)["thermal_kwh"]
        * J_KWH
        / float(base.metrics.battery_energy_j),
    }


def judged(
    car: str,
    air_c: float,
    control: str,
    against: str,
    by: tuple[str, ...],
    duration_s: float | None,
) -> dict[str, Any]:
    """Return what a climate control saves of the ageing of another one on WLTC, by each group of judges."""
    runs = [
        drive(CYCLES[0], car, air_c, controlled(each, air_c), duration_s=duration_s)[0]
        for each in (control, against)
    ]
    spread = runs[0].judge(runs[1], by).summary
    texts = {
        str(group): f"{row['median [%]']:.1f} ({row['lowest [%]']:.1f} to {row['highest [%]']:.1f})"
        for group, row in spread.iterrows()
    }
    return {"car": car, "air_c": air_c, "control": control, "against": against, **texts}


def grid(*, short: bool) -> Iterator[dict[str, Any]]:
    """Yield the arguments of `ambient`."""
    if short:
        yield _ambient(CYCLES[1], COLD_C, CONTROLS[0], Refrigerant.R1234YF, SHORT_S)
        return
    for cycle, air_c, control in product(CYCLES, AIR_C, CONTROLS):
        yield _ambient(cycle, air_c, control, Refrigerant.R1234YF)
    for air_c, other in product(AIR_C, (Refrigerant.R134A, Refrigerant.R290, Refrigerant.R744)):
        yield _ambient(CYCLES[0], air_c, CONTROLS[0], other)


def _ambient(
    cycle: str,
    air_c: float,
    control: str,
    refrigerant: Refrigerant,
    duration_s: float | None = None,
) -> dict[str, Any]:
    return {
        "cycle": cycle,
        "air_c": air_c,
        "control": control,
        "refrigerant": str(refrigerant),
        "duration_s": duration_s,
    }


def judgements(*, short: bool) -> Iterator[dict[str, Any]]:
    """Yield the arguments of `judged`."""
    pairs = [
        *(
            (PREDICTED_CAR, air_c, "predictive", other)
            for air_c in PREDICTED_C
            for other in CONTROLS[:2]
        ),
        *((GRID_CAR, air_c, CONTROLS[0], CONTROLS[1]) for air_c in AIR_C),
    ]
    by = JUDGES[: 1 if short else None]
    for car, air_c, control, against in pairs[: 1 if short else None]:
        yield {
            "car": car,
            "air_c": air_c,
            "control": control,
            "against": against,
            "by": by,
            "duration_s": SHORT_S if short else None,
        }


def run(session: Session) -> bool:
    """Run the study; returns whether every trip was driven."""
    short = session.short
    length = {"duration_s": SHORT_S if short else None}
    controls = [(air_c, control) for air_c in PREDICTED_C for control in COMPARED]
    controls += [(air_c, control) for air_c in QUICK for control in COMPARED_QUICK]
    parts: dict[str, tuple[Any, list[dict[str, Any]]]] = {
        "ambient": (ambient, list(grid(short=short))),
        "causes": (causes, [{"car": car, **length} for car in list(CARS)[: 1 if short else None]]),
        "predicted": (
            predicted,
            [
                {"air_c": air_c, "control": control, **length}
                for air_c, control in controls[: 3 if short else None]
            ],
        ),
        "front": (
            front,
            [
                {"cycle": cycle, "air_c": air_c, **length}
                for cycle, air_c in product(CYCLES, FRONT_C)
                if not short or (cycle, air_c) == (CYCLES[1], FRONT_C[1])
            ],
        ),
        "judged": (judged, list(judgements(short=short))),
        "second": (
            second_program.compared,
            [
                {"number": number, **length}
                for number in range(1 if short else second_program.CASES)
            ],
        ),
        "recorded": (
            recorded.judged,
            [{"trip": name} for name in recorded.TRIPS[: 1 if short else None]],
        ),
    }
    tables: dict[str, pd.DataFrame] = {}
    for name, (function, calls) in parts.items():
        names = [", ".join([name, *(str(each) for each in call.values())]) for call in calls]
        rows = session.compute(function, calls, names)
        tables[name] = pd.DataFrame(row for row in rows if row is not None)
    if session.failures:
        return False
    session.render(
        **tables,
        maps=pd.DataFrame(_maps()),
        savings=pd.DataFrame(_savings(tables["predicted"])),
        i3=recorded.summary(tables["recorded"]),
        step_s=STEP_S,
        groups=[
            (f"{name}:", f"{{{name}}}")
            for name in tables["judged"].columns
            if name not in {"car", "air_c", "control", "against"}
        ],
        grid_car=GRID_CAR,
        short=short,
    )
    return True


def _maps() -> Iterator[dict[str, Any]]:
    for fluid in Refrigerant:
        found = cycle_map(fluid)
        yield {
            "fluid": str(fluid),
            "rms_cop": 100.0 * found.rms[0],
            "rms_capacity": 100.0 * found.rms[1],
            "worst_cop": 100.0 * found.worst[0],
            "worst_capacity": 100.0 * found.worst[1],
        }


def _savings(table: pd.DataFrame) -> Iterator[dict[str, Any]]:
    for air_c, part in table.groupby("air_c", sort=False):
        by = part.set_index("control").equal_kwh
        for control in (COMPARED[2], COMPARED_QUICK[0]):
            if control in by:
                optimum = by.get(control.replace("predictive", "optimum"), np.nan)
                bases = {"rule": by["rule"], "alone": by["alone"], "optimum": optimum}
                saved_percent = {
                    name: 100.0 * (by[control] / base - 1.0) for name, base in bases.items()
                }
                bound = 100.0 * (optimum / by["alone"] - 1.0)
                yield {"air_c": air_c, "control": control, "bound": bound, **saved_percent}
