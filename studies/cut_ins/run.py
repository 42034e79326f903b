"""Cars that cut in, the more often the larger the gap that is left: by two laws, for each control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.variants import CLIMATES_C
from studies.drives import DEFAULT, trip
from studies.headway.run import SETTINGS
from studies.road_space.run import EQUAL
from studies.savings import PREVIEWS, PRODUCTION, road_taken, saved
from studies.session import Case, Session

import iptm
from iptm.faults.events import TRAFFIC_GAP_S, TRAFFIC_SPREAD
from iptm.parts import WHOLE_TRIP_S, Fault, FaultKind

CYCLES = ("wltc_class3b", "us06", "hwfet")
SEEDS = 5
LAWS = {
    FaultKind.LEADER_CUT_INS_BY_ROOM: "room",
    FaultKind.LEADER_CUT_INS_BY_HEADWAY: "headway",
}
SHORT_S = 60.0


def run(session: Session) -> bool:
    """Run the study; returns whether no vehicle was touched."""
    closer = next(setting for setting in SETTINGS if setting.name == "1.5 s")
    controls: list[tuple[str, str, str, bool, Mapping[str, Any]]] = [
        (PRODUCTION, "2 s", "2 s", False, {}),
        (PRODUCTION, "1.5 s", "1.5 s", False, closer.base),
        *(
            (DEFAULT, distance, base, perfect, settings)
            for distance, base, settings in (
                ("2 s", "2 s", EQUAL),
                ("1.5 s", "1.5 s", closer.own),
                ("120 m", "2 s", {}),
            )
            for perfect in (False, True)
        ),
    ]
    cycles, seeds = (CYCLES[1:2], 1) if session.short else (CYCLES, SEEDS)
    cases = [
        Case(
            f"cut-ins/{cycle}/{law}/{seed}/{role}/{distance}/{perfect}",
            {
                "law": LAWS[law],
                "role": role,
                "distance": distance,
                "base": base,
                "perfect": perfect,
            },
            trip(
                cycle,
                role,
                ambient_c=CLIMATES_C[0],
                **settings,
                preview_mode="full" if perfect else "none",
                faults=(Fault(law, duration_s=WHOLE_TRIP_S, seed=seed),),
            ),
        )
        for law, cycle, seed in product(LAWS, cycles, range(seeds))
        for role, distance, base, perfect, settings in controls
    ]
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    labels = ["law", "distance", "role", "perfect"]
    runs = driven.dropna(subset="run").groupby(labels, sort=False).run.agg(list)
    of_base = driven.drop_duplicates(labels).set_index(labels).base
    table = pd.DataFrame(
        {
            **dict(zip(labels, place, strict=True)),
            "preview": PREVIEWS[place[-1]],
            **_row(part, runs[place[0], of_base[place], PRODUCTION, False]),
        }
        for place, part in runs.items()
    )
    session.render(table=table, seeds=seeds, gap_s=TRAFFIC_GAP_S, spread=TRAFFIC_SPREAD)
    return not table.collisions.any()


def _row(runs: Sequence[iptm.Run], base: Sequence[iptm.Run]) -> dict[str, float]:
    """Return how often cars cut in ahead of some trips, what they save against others, and how they drive."""
    metrics = [run.metrics for run in runs]
    hours = sum(one.duration_s for one in metrics) / 3600.0
    return {
        "trips": len(runs),
        "per_100_km": 1e5 * sum(map(_cut_ins, runs)) / sum(one.distance_m for one in metrics),
        **road_taken([run.trajectory for run in runs]),
        **saved(metrics, [run.metrics for run in base], base[0].parameters),
        "interventions": sum(one.interventions for one in metrics) / hours,
        "smallest_gap_m": min(float(run.trajectory.gap_m.min()) for run in runs),
        "collisions": sum(bool((run.trajectory.gap_m <= 0.0).any()) for run in runs),
    }


def _cut_ins(run: iptm.Run) -> int:
    """Return how many cars came in between: how often the car ahead is nearer than it would have driven."""
    motion, trip = run.trajectory, run.trip
    if trip is None:
        raise AssertionError("a run that was driven has a trip")
    own_m = trip.route.leader.positions_at(motion.time_s)
    return int(np.count_nonzero(np.diff(motion.leader_position_m - own_m) < -1e-6))
