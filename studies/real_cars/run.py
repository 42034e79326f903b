"""The saving for real cars on measured trips, and what a simpler model of the controller costs.

The vehicle has all laws that the measurements ask for. Some of them the controller's model leaves out: there
the shipped controller is compared with one that has them, or has the number that they would give
it. The others it shares with the vehicle: there the cost is the one of a controller without them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.drives import DEFAULT, STRATEGIES, trip
from studies.measured_cycles import trip_cycles
from studies.road_space.run import EQUAL, EQUAL_ROAD
from studies.savings import COLUMNS, PREVIEWS, PRODUCTION, road_taken, savings
from studies.session import Case, Session

from iptm_core.markdown import table_of
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saved_share import saved_percent
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.units import J_PER_KWH

ROLES = tuple(STRATEGIES)
CYCLE, CAR = "wltc_class3b", "bmw_i3"
CARS: tuple[str, ...] = (DEFAULT_SET, CAR, "chevrolet_bolt", "tesla_model_3")
CLIMATES_C: tuple[float, ...] = (-10.0, 10.0, 25.0, 35.0)
GAPS: Mapping[str, Mapping[str, Any]] = {"120 m": {}, EQUAL_ROAD: EQUAL}
"""Settings of the default by the distance that it keeps; all others keep their own."""
FAR = next(iter(GAPS))
SHORT_S = 20.0
LARGEST_LOSS = 0.5
"""Percentage points of the saving that a simplification may cost."""

_MODEL = "controller_overrides"
_NO_LIMITS = {"regeneration.torque_nm": 0.0}
_ZETA = "powertrain.regenerative_efficiency"
_LINEAR = {"cell.resistance_exponent_1_k": 0.0}
_NO_AIR = {"cooling.air_exchange_w_k": 0.0}
_NO_DRAG = {"powertrain.drag_loss_w_s2_rad2": 0.0}
_NO_CHARGE = {
    "charge.resistance_slope": 0.0,
    **{f"charge.voltage_share_{percent}": 1.0 for percent in range(0, 101, 10)},
}
_LOW = {"charge.initial_charge": 0.3}
_ZETA_LAW = "limits of regeneration, blending with the friction brakes"
_CHARGE_LAW = "open-circuit voltage and resistance at"


SIMPLIFICATIONS: Mapping[str, tuple[str, str, Mapping[str, Any], Mapping[str, Any]]] = {
    "charge": (
        f"{_CHARGE_LAW} the charge in the middle of the trip (85 %)",
        "at the charge at which the trip begins (90 %)",
        {},
        {_MODEL: {"charge.initial_charge": 0.85}},
    ),
    "kinks": (
        "kinks smoothed over a quarter of the widths",
        "kinks smoothed over the shipped widths",
        {},
        {"smoothing_factor": 0.25},
    ),
    "cells": (
        "the vehicle has the first and the last cell, too (idealised)",
        "first and last cell for the 12 cells of a coolant channel of the vehicle",
        {"thermal_model": "full_channel"},
        {},
    ),
    "resistance": (
        "resistance exponential in temperature",
        "linear, -0.8 % per kelvin",
        {_MODEL: _LINEAR},
        {},
    ),
    "wrong_charge": (
        f"{_CHARGE_LAW} 30 % charge, where this trip begins",
        "at 90 %",
        {"overrides": _LOW, _MODEL: {"charge.initial_charge": 0.9}},
        {"overrides": _LOW},
    ),
    "constant_voltage": (
        f"{_CHARGE_LAW} the charge at which the trip begins",
        "those at half charge, always",
        {_MODEL: _NO_CHARGE},
        {},
    ),
    "best_zeta": (
        _ZETA_LAW,
        "best constant share, 0.69",
        {_MODEL: {**_NO_LIMITS, _ZETA: 0.69}},
        {},
    ),
    "papers_zeta": (
        _ZETA_LAW,
        "the paper's constant share, 0.3",
        {_MODEL: {**_NO_LIMITS, _ZETA: 0.3}},
        {},
    ),
    "air": ("heat exchange of the pack with the air", "none", {_MODEL: _NO_AIR}, {}),
    "drag": ("drag loss of the motor", "none", {_MODEL: _NO_DRAG}, {}),
    "all": (
        "all of these laws",
        "none: the paper's equations with the numbers of the car and its 0.3",
        {_MODEL: {**_LINEAR, **_NO_CHARGE, **_NO_LIMITS, **_NO_AIR, **_NO_DRAG, _ZETA: 0.3}},
        {},
    ),
}
"""Refined law, what stands in its place, and settings with the simple and with the refined model."""


def totals(runs: Sequence[RunMetrics]) -> dict[str, float]:
    """Return sums over runs.

    Returns:
        ``aging``, the capacity loss of both cells; energies in J of ``cooling`` (compressor and
        auxiliaries) and ``traction``; ``consumption``, battery energy in kWh/100 km.
    """
    battery_j = math.fsum(run.battery_energy_j for run in runs)
    distance_m = math.fsum(run.distance_m for run in runs)
    return {
        "aging": math.fsum(run.degradation for run in runs),
        "cooling": math.fsum(run.cooling_energy_j for run in runs),
        "traction": math.fsum(run.traction_energy_j for run in runs),
        "consumption": battery_j / J_PER_KWH / (distance_m / 1e5),
    }


def as_driven(own: Sequence[RunMetrics], others: Sequence[RunMetrics]) -> dict[str, float]:
    """Return what runs save against others of the same trips, in percent, whatever their ends.

    Args:
        own: the runs.
        others: those with which they are compared, in the same order of trips.
    """
    mine, theirs = totals(own), totals(others)
    return {name: saved_percent(value, theirs[name]) for name, value in mine.items()}


def savings_cases(
    trips: Sequence[str], cars: Sequence[str], climates_c: Sequence[float]
) -> list[Case]:
    """Return all trips that the tables of the savings need."""
    cases = []
    for car, ambient_c, cycle, role, distance in product(
        cars, climates_c, (CYCLE, *trips), ROLES, GAPS
    ):
        if role == DEFAULT or distance == FAR:
            name = f"{car}/{ambient_c}/{Path(cycle).stem}/{role}/{distance}"
            labels = {"car": car, "ambient_c": ambient_c, "trip": Path(cycle).stem, "role": role}
            call = trip(cycle, role, car, ambient_c, **GAPS[distance])
            cases.append(Case(name, {**labels, "distance": distance}, call))
    return cases


def savings_on(found: pd.DataFrame, trips: Sequence[str]) -> pd.DataFrame:
    """Return the savings on some trips.

    Returns:
        A row per ``car``, ``ambient_c`` and limit of the ``distance``, with the ``consumption`` of the
        default strategy, the road that it takes, its savings by what it is compared with (`savings`;
        with ``_driven`` `as_driven`), and of the saving in ageing on single trips ``_least``, ``_median``
        and ``_most``. Rows that lack a trip are left out.
    """
    found = found.dropna(subset="metrics")
    found = found[found.trip.isin([Path(cycle).stem for cycle in trips])]
    rows = []
    for (car, ambient_c), part in found.groupby(["car", "ambient_c"], sort=False):
        for distance in GAPS:
            kept = part.role.map({DEFAULT: distance}).fillna(FAR)
            runs = part[part.distance == kept].groupby("role").run.agg(list)
            if all(len(runs.get(role, ())) == len(trips) for role in ROLES):
                labels = {"car": car, "ambient_c": ambient_c, "distance": distance}
                rows.append(labels | _savings(runs, load_parameters(car).values))
    return pd.DataFrame(rows)


def _savings(runs: pd.Series, parameters: ModelParameters) -> dict[str, Any]:
    metrics = {role: [run.metrics for run in runs[role]] for role in ROLES}
    own = metrics.pop(DEFAULT)
    found: dict[str, Any] = {
        "preview": PREVIEWS[True],
        "consumption": totals(own)["consumption"],
        **road_taken([run.trajectory for run in runs[DEFAULT]]),
        **savings(own, metrics, parameters),
    }
    for role, others in metrics.items():
        of_all = as_driven(own, others)
        pairs = zip(own, others, strict=True)
        of_each = [as_driven([mine], [other])["aging"] for mine, other in pairs]
        of_all |= {
            "least": min(of_each),
            "median": float(np.median(of_each)),
            "most": max(of_each),
        }
        found |= {f"{role}_driven_{name}": value for name, value in of_all.items()}
    return found


def simplification_cases(names: Sequence[str], climates_c: Sequence[float]) -> list[Case]:
    """Return all trips that the table of the simplifications needs."""
    cases = []
    for name, ambient_c in product(names, climates_c):
        *_, simple, refined = SIMPLIFICATIONS[name]
        # A controller with which the default strategy is compared has the shipped model.
        shipped = {key: refined[key] for key in refined if key not in {_MODEL, "smoothing_factor"}}
        for side, role, settings in (
            ("simple", DEFAULT, simple),
            ("refined", DEFAULT, refined),
            ("production", PRODUCTION, shipped),
        ):
            labels = {"simplification": name, "side": side, "ambient_c": ambient_c}
            call = trip(CYCLE, role, CAR, ambient_c, **settings)
            cases.append(Case(f"{name}/{side}/{ambient_c:g}", labels, call))
    return cases


def losses(found: pd.DataFrame) -> pd.DataFrame:
    """Return what simplifications cost.

    Returns:
        A row per ``simplification`` and ``ambient_c``, with the loss in saving in percentage points: of
        capacity loss (``aging``) and of battery energy per distance (``consumption``), both against the
        same trip of the production-like controller. Rows that lack a trip are left out.
    """
    rows = []
    for labels, part in found.dropna(subset="metrics").groupby(
        ["simplification", "ambient_c"], sort=False
    ):
        by = {side: totals([run]) for side, run in zip(part.side, part.metrics, strict=True)}
        if len(by) == 3:
            lost = {
                name: 100.0 * (by["simple"][name] - by["refined"][name]) / by["production"][name]
                for name in ("aging", "consumption")
            }
            rows.append({**dict(zip(("simplification", "ambient_c"), labels, strict=True)), **lost})
    return pd.DataFrame(rows, columns=["simplification", "ambient_c", "aging", "consumption"])


def is_shipped(name: str) -> bool:
    """Return whether the shipped controller has the simple model."""
    return _MODEL not in SIMPLIFICATIONS[name][2]


def losses_table(found: pd.DataFrame, *, shipped: bool) -> str:
    """Return the table of the simplifications that the shipped controller has, or of the others."""
    rows: list[dict[str, str]] = []
    for name, part in found.groupby("simplification", sort=False):
        if is_shipped(str(name)) == shipped:
            refined, simple, *_ = SIMPLIFICATIONS[str(name)]
            texts = {
                f"{row.ambient_c:g} °C": " / ".join(
                    f"{round(value, 2) + 0.0:+.2f}" for value in (row.aging, row.consumption)
                )
                for row in part.itertuples()
            }
            bar = "within" if part.aging.max() <= LARGEST_LOSS else "**beyond**"
            rows.append({"simple": simple, "refined": refined, **texts, "bar": bar})
    if not rows:
        return ""
    formats = {f"{head}:" if "°C" in head else head: f"{{{head}}}" for head in rows[0]}
    return table_of(rows, formats)


def run(session: Session) -> bool:
    """Run the study; returns whether every shipped simplification costs no more than it may."""
    trips = trip_cycles(session.scratch / "trips")
    cars, climates_c, names = CARS, CLIMATES_C, tuple(SIMPLIFICATIONS)
    if session.short:
        trips, cars, climates_c, names = trips[:2], (CAR,), CLIMATES_C[-1:], names[:1]
    parts = [
        savings_cases(trips, cars, climates_c),
        simplification_cases(names, [c for c in (-10.0, 35.0) if c in climates_c]),
    ]
    if session.short:
        parts = [[case.shortened(SHORT_S) for case in part] for part in parts]
    savings, simplifications = map(session.drive, parts)
    lost = losses(simplifications)
    sets = {car: load_parameters(car) for car in cars}
    session.render(
        columns=COLUMNS,
        cars=[
            {"car": car, "about": one.description, "mass_kg": one.values.body.mass_kg}
            for car, one in sets.items()
        ],
        cycle=savings_on(savings, [CYCLE]),
        road=savings_on(savings, trips),
        trips=len(trips),
        car=CAR,
        largest_loss=LARGEST_LOSS,
        shipped=losses_table(lost, shipped=True),
        shared=losses_table(lost, shipped=False),
    )
    worst = lost[lost.simplification.map(is_shipped)].groupby("simplification").aging.max()
    for name in worst[worst > LARGEST_LOSS].index:
        print(f"simplification {name} costs more than it may")
    return bool((worst <= LARGEST_LOSS).all())
