"""The IPTM benchmark: entrants of several hands on eight tasks, judged from the rows of their trips.

A score is the percent by which a trip costs less than the reference, the intelligent driver model with a
thermostat, at the same mean gap: distance is no gain. Energy and capacity are one sum in EUR per 100 km.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.benchmark.entrants import BY_NAME, ENTRANTS, REFERENCE, learned
from studies.benchmark.judge import ROWS, Found, judged, score
from studies.session import Session

import iptm
from iptm.closed_loop import TickController, decided
from iptm.driving import controller_for, trip_in_ticks
from iptm.own_parts import OwnController
from iptm_controller.arrival import ArrivalCost
from iptm_controller.decision import Decision
from iptm_core.aging_laws.cells import NCA, NMC811_SI
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.errors import ScenarioError
from iptm_core.routes.cycles import CYCLE_NAMES
from iptm_core.state import FloatArray

TASKS = tuple(sorted((Path(__file__).parent / "tasks").glob("*.yaml")))
SHORT_TASKS, SHORT_S = ("hot", "radio"), 120.0
LAWS = {cell.law.name: cell.law for cell in (NCA, NMC811_SI)}
DRAWN = 8


@dataclass(frozen=True, eq=False)
class Driven:
    """Rows of a trip by name, and how long decisions took (s): median and 99th percentile."""

    rows: Mapping[str, FloatArray]
    median_s: float
    late_s: float


class _Timed:
    def __init__(self, inner: TickController) -> None:
        self.options, self._inner, self.times_s = inner.options, inner, list[float]()

    def decide(self, measured: iptm.Measurements) -> Decision:
        began_s = time.perf_counter()
        decision = self._inner.decide(measured)
        self.times_s.append(time.perf_counter() - began_s)
        return decision


def drive(trip: iptm.Trip, entrant: str) -> Driven:
    """Drive a task with an entrant."""
    who = BY_NAME[entrant]
    trip = merged(trip, who.settings).checked()
    own = who.controller(trip)
    limits, tick_s = trip.parameters.limits, trip.conditions.period_s
    timed = _Timed(controller_for(trip) if own is None else OwnController(own, limits, tick_s))
    run = decided(trip_in_ticks(trip), timed)
    columns = run.trajectory.to_arrays()
    return Driven(
        {name: columns[name] for name in ROWS},
        float(np.median(timed.times_s)),
        float(np.quantile(timed.times_s, 0.99)),
    )


def merged(trip: iptm.Trip, settings: Mapping[str, Any]) -> iptm.Trip:
    """Return a task with the settings of a strategy; the climate of the task stays."""
    text = trip.vehicle.overrides
    added = ", ".join(f"{key}={value}" for key, value in settings.get("overrides", {}).items())
    return trip.changed(**{**settings, "overrides": ", ".join(filter(None, (text, added)))})


def drawn(seed: int, count: int = DRAWN) -> list[iptm.Trip]:
    """Return held-out trips: cycle, slope, temperature and radio are drawn."""
    rng = np.random.default_rng(seed)
    trips = []
    for number in range(count):
        cycle = str(rng.choice(CYCLE_NAMES))
        lossy = {"latency_s": 0.5, "dropout_probability": 0.3, "noise_std_m_s": 1.0}
        trip = iptm.Trip.of(
            cycle,
            slope=str(rng.choice(["flat", "small", "large"])),
            climate=float(np.round(rng.uniform(0.0, 38.0), 1)),
            preview_length_s=60.0,
            seed=int(rng.integers(2**31)),
            **(lossy if rng.random() < 0.5 else {}),
        )
        trips.append(trip.changed(name=f"{cycle}_{number + 1}"))
    return trips


def run(session: Session) -> bool:
    """Run the study; returns whether no entrant that is bad on purpose won a task or the whole."""
    seed = session.options.seed
    if seed is not None and session.options.page:
        raise ScenarioError("--page with --seed; allowed: one of them")
    tasks = [iptm.load_trip(path) for path in TASKS] if seed is None else drawn(seed)
    if session.short:
        chosen = [trip for trip in tasks if trip.name in SHORT_TASKS] or tasks[:1]
        tasks = [trip.changed(duration_s=SHORT_S) for trip in chosen]
    entrants = [*REFERENCE, *ENTRANTS]
    pairs = [(trip, entrant.name) for trip in tasks for entrant in entrants]
    calls = [{"trip": trip, "entrant": name} for trip, name in pairs]
    names = [f"{trip.name}/{name}" for trip, name in pairs]
    driven = session.compute(drive, calls, names)
    rows: list[dict[str, Any]] = []
    for place, trip in enumerate(tasks):
        of_task = driven[place * len(entrants) : (place + 1) * len(entrants)]
        found = [None if each is None else judge(each, trip) for each in of_task]
        reference = [each for each in found[: len(REFERENCE)] if each is not None]
        driven_only = [without_ending(each) for each in reference]
        for entrant, each, trip_driven in zip(entrants, found, of_task, strict=True):
            if each is None or not reference:
                continue
            points, reason = score(each, reference)
            rows.append(
                {
                    "task": trip.name,
                    "entrant": entrant.name,
                    "is_bad": entrant.is_bad,
                    "is_reference": entrant in REFERENCE,
                    "score": points,
                    "reason": reason,
                    "without_ending": score(without_ending(each), driven_only)[0],
                    **vars(each),
                    "law_eur": float(np.median(list(each.aging_eur.values()))),
                    "median_ms": 1e3 * trip_driven.median_s,
                    "late_ms": 1e3 * trip_driven.late_s,
                }
            )
    table = pd.DataFrame(rows)
    ranked = table[~table.is_reference]
    best = ranked.loc[ranked.groupby("task").score.idxmax().dropna()]
    whole = summary(ranked)
    session.render(
        whole=whole,
        tasks=[(trip.name, trip.description or trip.heading) for trip in tasks],
        scores=scores_of(ranked),
        headings=[(f"{trip.name}:", f"{{{trip.name}}}") for trip in tasks],
        best=best,
        details=ranked,
        entrants=ENTRANTS,
        reference=table[table.is_reference],
        is_timed=not session.short,
        seed=seed,
        digest=learned().digest,
    )
    return not best.is_bad.any() and not whole.iloc[:1].is_bad.any()


def judge(driven: Driven, trip: iptm.Trip) -> Found:
    """Judge a trip by the numbers of its task."""
    cost = ArrivalCost.parse(trip.controller.arrival_cost_eur)
    arrival = None if cost is None else (np.array(cost.celsius), np.array(cost.eur))
    return judged(driven.rows, trip.parameters, AgingSettings(), LAWS, arrival)


def without_ending(found: Found) -> Found:
    """Return the findings without the energy of cooling the pack down after the trip."""
    return replace(found, eur=found.eur - AgingSettings.electricity_eur_kwh * found.ending_kwh)


def summary(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return a row per entrant: median and quartiles of its scores, and what else was found; best first.

    An entrant without a score on a task is ranked behind all that have one on each.
    """
    grouped = ranked.groupby("entrant", sort=False)
    quartiles = grouped.score.quantile([0.25, 0.5, 0.75]).unstack()
    table = pd.DataFrame(
        {
            "is_bad": grouped.is_bad.first(),
            "low": quartiles[0.25],
            "median": quartiles[0.5],
            "high": quartiles[0.75],
            "mean": grouped.score.mean(),
            "without_ending": grouped.without_ending.mean(),
            "unranked": grouped.score.apply(lambda each: int(each.isna().sum())),
            "vehicles_h": grouped.vehicles_h.median(),
            "below_s": grouped.below_s.sum(),
            "interventions": grouped.interventions.sum(),
            "braking_s": grouped.braking_s.sum(),
            "jerk_m_s3": grouped.jerk_m_s3.median(),
            "median_ms": grouped.median_ms.median(),
            "late_ms": grouped.late_ms.max(),
        }
    )
    return table.sort_values(["unranked", "mean"], ascending=[True, False]).reset_index()


def scores_of(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return the scores as texts, a row per entrant and a column per task."""
    texts = ranked.assign(
        text=[
            reason or f"{points:.1f}"
            for points, reason in zip(ranked.score, ranked.reason, strict=True)
        ]
    )
    return texts.pivot_table(
        index="entrant", columns="task", values="text", aggfunc="first", sort=False
    ).reset_index()
