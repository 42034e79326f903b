"""The saving of the default strategy for the paper's car and real ones, as runs and as rows of a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from iptm.studies.drives import DEFAULT, STRATEGIES, spec_of
from iptm.studies.study import Case, Label, Study
from iptm.studies.tables import results
from iptm_core.metrics import RunMetrics, at_equal_end
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.model import ModelParameters

ROLES = tuple(STRATEGIES)
OTHERS = tuple(role for role in ROLES if role != DEFAULT)
CYCLE = "wltc_class3b"
CARS = (DEFAULT_SET, "bmw_i3", "chevrolet_bolt", "tesla_model_3")
CLIMATES_C = (-10.0, 10.0, 25.0, 35.0)
HEADWAY = "gap.max_time_headway_s"
GAPS = {0.0: "120 m", 3.0: "3 s"}
"""Limits of the gap by the largest time headway in s; 0 is none, the largest gap counts alone."""


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
        "consumption": battery_j / 3.6e6 / (distance_m / 1e5),
    }


def saving(
    own: Sequence[RunMetrics], others: Sequence[RunMetrics], parameters: ModelParameters
) -> dict[str, float]:
    """Return what runs save against others of the same trips, in percent of those.

    Args:
        own: the runs.
        others: those they are compared with, in the same order of trips.
        parameters: of the vehicle.

    Returns:
        The savings of `totals`, and ``equal_end``: that of ageing with both packs at the temperature of
        the cooler one, NaN where that is below the lower limit of the temperature.
    """
    mine, theirs = totals(own), totals(others)
    found = {name: _percent(value, theirs[name]) for name, value in mine.items()}
    ends = [at_equal_end(*pair, parameters) for pair in zip(own, others, strict=True)]
    warm = [
        end
        for end in ends
        if end is not None and end[0].temperature_k >= parameters.limits.min_temperature_k
    ]
    found["equal_end"] = math.nan
    if len(warm) == len(ends):
        found["equal_end"] = _percent(
            sum(mine.capacity_loss for mine, _ in warm),
            sum(theirs.capacity_loss for _, theirs in warm),
        )
    return found


def _percent(own: float, other: float) -> float:
    return 100.0 * (1.0 - own / other)


def savings_study(
    trips: Sequence[str],
    cars: Sequence[str] = CARS,
    climates_c: Sequence[float] = CLIMATES_C,
) -> Study:
    """Return all runs that the tables of the savings need.

    Args:
        trips: measured trips, as paths of drive files.
        cars: parameter sets.
        climates_c: temperatures of the air.
    """
    cases = []
    for car, ambient_c, trip, role, headway_s in product(
        cars, climates_c, (CYCLE, *trips), ROLES, GAPS
    ):
        # What the default strategy is compared with keeps its own distance.
        if role == DEFAULT or not headway_s:
            overrides = {HEADWAY: headway_s} if headway_s else None
            spec = spec_of(trip, role, car, ambient_c, overrides)
            name = f"{car}/{ambient_c}/{Path(trip).stem}/{role}/{headway_s}"
            labels: dict[str, Label] = {"car": car, "ambient_c": ambient_c}
            labels |= {"trip": Path(trip).stem, "role": role, "headway_s": headway_s}
            cases.append(Case(name, labels, spec))
    return Study(
        "savings",
        "Saving of the default strategy for real cars",
        "The paper's car and real ones on WLTC and on measured trips, from cold to hot.",
        tuple(cases),
    )


def savings_on(states: Sequence[Case], trips: Sequence[str]) -> pd.DataFrame:
    """Return the savings on some trips, as far as all of their runs are there.

    Returns:
        A row per ``car``, ``ambient_c`` and limit of the ``gap``, with the ``consumption`` of the
        default strategy, its savings by what it is compared with (``reference_aging`` and so on, see
        `saving`), and of the saving in ageing on single trips ``_least``, ``_median`` and ``_most``.
    """
    found = results(states).dropna(subset="metrics")
    found = found[found.trip.isin([Path(trip).stem for trip in trips])]
    rows = []
    for (car, ambient_c), part in found.groupby(["car", "ambient_c"], sort=False):
        for headway_s, gap in GAPS.items():
            limit_s = part.role.map({DEFAULT: headway_s}).fillna(0.0)
            runs = part[part.headway_s == limit_s].groupby("role").metrics.agg(list)
            if all(len(runs.get(role, ())) == len(trips) for role in ROLES):
                labels = {"car": car, "ambient_c": ambient_c, "gap": gap}
                rows.append(labels | _savings(runs, load_parameters(car).values))
    return pd.DataFrame(rows)


def _savings(runs: pd.Series, parameters: ModelParameters) -> dict[str, float]:
    own = runs[DEFAULT]
    found = {"consumption": totals(own)["consumption"]}
    for role in OTHERS:
        of_all = saving(own, runs[role], parameters)
        pairs = zip(own, runs[role], strict=True)
        of_each = [saving([mine], [other], parameters)["aging"] for mine, other in pairs]
        of_all |= {
            "least": min(of_each),
            "median": float(np.median(of_each)),
            "most": max(of_each),
        }
        found |= {f"{role}_{name}": value for name, value in of_all.items()}
    return found
