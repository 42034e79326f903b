"""The saving of the default strategy for the paper's car and real ones, as runs and as rows of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from iptm_core.metrics import RunMetrics
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_studies.campaign import CaseState
from iptm_studies.real_cars.drives import (
    CYCLE,
    DEFAULT,
    HEADWAY,
    ROLES,
    Extent,
    Saving,
    Totals,
    drive,
)
from iptm_studies.study import Case, Study

SHIPPED_GAP, SHORT_HEADWAY = 0.0, 3.0
"""Largest time headways in s; 0 is none, the largest gap counts alone."""


@dataclass(frozen=True)
class Row:
    """A line of a table: one car in one climate under one limit of the gap, on one trip or several.

    Attributes:
        car: parameter set.
        ambient_c: temperature of the air.
        headway_s: largest time headway, 0 for none.
        consumption_kwh_100_km: of the default strategy.
        savings: of the default strategy by what it is compared with.
        by_trip: saving in aging on each trip.
    """

    car: str
    ambient_c: float
    headway_s: float
    consumption_kwh_100_km: float
    savings: Mapping[str, Saving]
    by_trip: Mapping[str, tuple[float, ...]]


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


def rows_on(extent: Extent, states: Sequence[CaseState], trips: Sequence[str]) -> list[Row]:
    """Return the rows on some trips, as far as all of their runs are there."""
    runs = {tuple(state.case.labels.values()): state.metrics for state in states}
    rows = []
    for car in extent.cars:
        parameters = load_parameters(car).values
        for ambient_c in extent.climates_c:
            for headway_s in (SHIPPED_GAP, SHORT_HEADWAY):
                driven = {
                    role: [
                        runs.get(tuple(_labels(car, ambient_c, trip, role, limit_s).values()))
                        for trip in trips
                    ]
                    for role in ROLES
                    for limit_s in [headway_s if headway_s in _headways(role) else SHIPPED_GAP]
                }
                there = {
                    role: [run for run in found if run is not None]
                    for role, found in driven.items()
                }
                if trips and all(len(found) == len(trips) for found in there.values()):
                    rows.append(_row(car, ambient_c, headway_s, there, parameters))
    return rows


def _row(
    car: str,
    ambient_c: float,
    headway_s: float,
    runs: Mapping[str, list[RunMetrics]],
    parameters: ModelParameters,
) -> Row:
    own = runs[DEFAULT]
    others = {role: found for role, found in runs.items() if role != DEFAULT}
    return Row(
        car,
        ambient_c,
        headway_s,
        Totals.of(own).consumption_kwh_100_km,
        {role: Saving.of(own, found, parameters) for role, found in others.items()},
        {
            role: tuple(
                Saving.of([mine], [other], parameters).aging
                for mine, other in zip(own, found, strict=True)
            )
            for role, found in others.items()
        },
    )
