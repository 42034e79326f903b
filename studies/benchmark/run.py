"""The IPTM benchmark: entrants of several hands on eight tasks, judged from the rows of their trips.

A score is the percent by which a trip costs less than the reference, the intelligent driver model with a
thermostat, at the same mean gap: distance is no gain. Energy and capacity are one sum in EUR per 100 km.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.benchmark.driving import drive, judge
from studies.benchmark.entrants import ENTRANTS, REFERENCE, Entrant, entrant_of, learned
from studies.benchmark.judge import Found, score
from studies.benchmark.kinds import kinds_of, pulses_of
from studies.session import Session

import iptm
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.errors import ScenarioError
from iptm_core.routes.cycles import CYCLE_NAMES

TASKS = tuple(sorted((Path(__file__).parent / "tasks").glob("*.yaml")))
SHORT_TASKS, SHORT_S = ("hot", "radio"), 120.0
DRAWN = 8
HELD_OUT_SEED = 20261129
"""The day on which it was first driven, with `learned.json` as it was."""
LEARNED = "learned"


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
    seed, further = session.options.seed, session.options.entrant
    if session.options.page and (further or seed is not None):
        raise ScenarioError("--page with --seed or --entrant; allowed: one of them")
    tasks = [iptm.load_trip(path) for path in TASKS] if seed is None else drawn(seed)
    if session.short:
        chosen = [trip for trip in tasks if trip.name in SHORT_TASKS] or tasks[:1]
        tasks = [trip.changed(duration_s=SHORT_S) for trip in chosen]
    entrants = [*ENTRANTS, *map(entrant_of, further)]
    table = judged_table(session, tasks, entrants)
    ranked = table[~table.is_reference]
    best = ranked.loc[ranked.groupby("task").score.idxmax().dropna()]
    whole = summary(ranked)
    is_whole = seed is None and not session.short
    session.render(
        whole=whole,
        tasks=[(trip.name, trip.description or trip.heading) for trip in tasks],
        scores=scores_of(ranked),
        headings=headings_of(tasks),
        best=best,
        details=ranked,
        entrants=entrants,
        reference=table[table.is_reference],
        is_timed=not session.short,
        seed=seed,
        digest=learned().digest,
        held_out=held_out(session) if is_whole else None,
        kinds=kinds_of(session) if is_whole else None,
        pulses=pulses_of(session) if is_whole else None,
    )
    return not best.is_bad.any() and not whole.iloc[:1].is_bad.any()


def held_out(session: Session) -> dict[str, Any]:
    """Drive the tasks drawn by the seed of a day, and compare the learned policy with the reference."""
    tasks = drawn(HELD_OUT_SEED)
    ranked = judged_table(session, tasks, ENTRANTS).query("~is_reference")
    points = ranked[ranked.entrant == LEARNED].score
    return {
        "seed": HELD_OUT_SEED,
        "tasks": [(trip.name, trip.heading) for trip in tasks],
        "whole": summary(ranked),
        "scores": scores_of(ranked),
        "headings": headings_of(tasks),
        "mean": points.mean(),
        "median": points.median(),
        "better": int((points > 0.0).sum()),
    }


def headings_of(tasks: Sequence[iptm.Trip]) -> list[tuple[str, str]]:
    """Return heading and format of the column of each task."""
    return [(f"{trip.name}:", f"{{{trip.name}}}") for trip in tasks]


def judged_table(
    session: Session, tasks: Sequence[iptm.Trip], takes_part: Sequence[Entrant]
) -> pd.DataFrame:
    """Drive tasks with the reference and entrants; return a row of figures for each."""
    entrants = [*REFERENCE, *takes_part]
    pairs = [(trip, entrant) for trip in tasks for entrant in entrants]
    calls = [
        {"trip": trip, "entrant": each.source or each.name, "files": each.files}
        for trip, each in pairs
    ]
    names = [f"{trip.name}/{entrant.name}" for trip, entrant in pairs]
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
    return pd.DataFrame(rows)


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
            "unranked": ranked.task.nunique() - grouped.score.count(),
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
