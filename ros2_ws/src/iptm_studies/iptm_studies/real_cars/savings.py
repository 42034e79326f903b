"""The saving of the default strategy for the paper's car and real ones, as runs and as rows of a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iptm_core.metrics import RunMetrics, at_equal_end
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_studies.campaign import CaseState
from iptm_studies.drives import DEFAULT, STRATEGIES, drive
from iptm_studies.run_spec import SolverSpec
from iptm_studies.study import Case, Study

ROLES = tuple(STRATEGIES)
OTHERS = tuple(role for role in ROLES if role != DEFAULT)
CYCLE = "wltc_class3b"
CARS = (DEFAULT_SET, "bmw_i3", "chevrolet_bolt", "tesla_model_3")
CLIMATES_C = (-10.0, 10.0, 25.0, 35.0)
HEADWAY = "gap.max_time_headway_s"
SHIPPED_GAP, SHORT_HEADWAY = 0.0, 3.0
"""Largest time headways in s; 0 is none, the largest gap counts alone."""


@dataclass(frozen=True)
class Extent:
    """How much is driven.

    Attributes:
        trips: measured trips, as paths of drive files.
        cars: parameter sets.
        climates_c: temperatures of the air.
        simplifications: number of the simplifications that are tried.
        duration_s: where all trips are cut, None for their ends.
        compile_code: whether controllers are compiled.
    """

    trips: tuple[str, ...]
    cars: tuple[str, ...] = CARS
    climates_c: tuple[float, ...] = CLIMATES_C
    simplifications: int | None = None
    duration_s: float | None = None
    compile_code: bool = True

    @classmethod
    def short(cls, trips: Sequence[str]) -> Extent:
        """Return a little of everything, in seconds."""
        car, climate = CARS[1:2], CLIMATES_C[-1:]
        return cls(tuple(trips[:2]), car, climate, 1, 20.0, compile_code=False)

    def solver(self, smoothing_factor: float = 1.0) -> SolverSpec:
        """Return the solver of a run."""
        return SolverSpec(compile_code=self.compile_code, smoothing_factor=smoothing_factor)


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


def savings_study(extent: Extent) -> Study:
    """Return all runs that the tables of the savings need."""
    cases = []
    for car in extent.cars:
        for ambient_c in extent.climates_c:
            for trip in (CYCLE, *extent.trips):
                for role in ROLES:
                    for headway_s in _headways(role):
                        labels = _labels(car, ambient_c, trip, role, headway_s)
                        spec = drive(
                            role,
                            car,
                            ambient_c,
                            cycle=trip,
                            overrides={HEADWAY: headway_s} if headway_s else None,
                            duration_s=extent.duration_s,
                            solver=extent.solver(),
                        )
                        cases.append(Case("/".join(map(str, labels.values())), labels, spec))
    return Study(
        "savings",
        "Saving of the default strategy for real cars",
        "The paper's car and real ones on WLTC and on measured trips, from cold to hot.",
        tuple(cases),
    )


def _headways(role: str) -> tuple[float, ...]:
    """Return the limits under which a role is driven: what is compared with keeps its own distance."""
    return (SHIPPED_GAP, SHORT_HEADWAY) if role == DEFAULT else (SHIPPED_GAP,)


def _labels(
    car: str, ambient_c: float, trip: str, role: str, headway_s: float
) -> dict[str, str | float]:
    return {
        "car": car,
        "ambient_c": ambient_c,
        "trip": Path(trip).stem,
        "role": role,
        "headway_s": headway_s,
    }


def savings_on(extent: Extent, states: Sequence[CaseState], trips: Sequence[str]) -> pd.DataFrame:
    """Return the savings on some trips, as far as all of their runs are there.

    Returns:
        A row per ``car``, ``ambient_c`` and limit of the ``gap``, with the ``consumption`` of the
        default strategy, its savings by what it is compared with (``reference_aging`` and so on, see
        `saving`), and of the saving in ageing on single trips ``_least``, ``_median`` and ``_most``.
    """
    runs = {tuple(state.case.labels.values()): state.metrics for state in states}
    rows = []
    for car in extent.cars:
        parameters = load_parameters(car).values
        for ambient_c in extent.climates_c:
            for headway_s in (SHIPPED_GAP, SHORT_HEADWAY):
                driven: dict[str, list[RunMetrics]] = {}
                for role in ROLES:
                    limit_s = headway_s if headway_s in _headways(role) else SHIPPED_GAP
                    found = [
                        runs.get(tuple(_labels(car, ambient_c, trip, role, limit_s).values()))
                        for trip in trips
                    ]
                    driven[role] = [run for run in found if run is not None]
                if trips and all(len(found) == len(trips) for found in driven.values()):
                    gap = f"{headway_s:g} s" if headway_s else "120 m"
                    labels = {"car": car, "ambient_c": ambient_c, "gap": gap}
                    rows.append(labels | _savings(driven, parameters))
    return pd.DataFrame(rows)


def _savings(
    runs: Mapping[str, Sequence[RunMetrics]], parameters: ModelParameters
) -> dict[str, float]:
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
