"""What is saved at equal road space: against a car of today, and against a strong baseline without V2X.

Each saving stands beside the road that it takes and the preview that it needs, see `studies.savings`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.scenes import LONGEST_S, SCENES, SHORTEST_S, measured_scenes
from studies.measured_cycles import LONGEST_TRIP_S, TRIPS, trip_cycles
from studies.savings import (
    BASELINE,
    BASES,
    CAR_LENGTH_M,
    COLUMNS,
    PREVIEWS,
    PRODUCTION,
    PRODUCTION_SIMPLE,
    RULE_COLUMN,
    RULE_PREVIEW,
    road_taken,
    savings,
)
from studies.session import Case, Session

import iptm
from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.metrics.following import MOVING_M_S
from iptm_core.routes.cycles import CYCLE_NAMES

CYCLES = ("wltc_class3b", "us06", "hwfet")
TUNED_ON = ("udds", "sc03", "nycc")
"""Of the strong baseline; not in the table of savings."""
DEFAULT, REFERENCE = "default", "reference"
HEADWAY = "gap.max_time_headway_s"
EQUAL_ROAD_S, SHORTER_S = 3.0, 2.0
DESIRED_S = 1.7
EQUAL: dict[str, Any] = {
    "overrides": {"gap.desired_time_headway_s": DESIRED_S},
    "value_beyond_trip": True,
}
"""The default that takes the road of `production`, with a preview and without."""
EQUAL_ROAD = f"{DESIRED_S:g} s desired"
FRONT = ((DEFAULT, True, EQUAL_ROAD), (DEFAULT, False, EQUAL_ROAD))
"""Control, preview and distance of the rows of the front table, in order."""
HILLS = "published cycle on hills up to 6 %"
BELOW_S_MIN_M = 0.05
SHORT_S = 60.0


def drives() -> list[tuple[str, bool, str, Mapping[str, Any]]]:
    """Return name, preview, limit of the distance, and settings of each row, the bases first."""
    none = {"preview_mode": "none"}
    single = {"strategy": REFERENCE, "horizon": "15x1"}
    rows: list[tuple[str, bool, str, Mapping[str, Any]]] = [
        (PRODUCTION, False, "1.6 s", {"strategy": PRODUCTION, **none}),
        (PRODUCTION_SIMPLE, False, "1.6 s", {"strategy": PRODUCTION_SIMPLE, **none}),
        (RULE_PREVIEW, True, "1.6 s", {"strategy": RULE_PREVIEW}),
        (BASELINE, False, "3.5 s", {"strategy": BASELINE, **none}),
    ]
    for preview in (False, True):
        known = {} if preview else none
        rows.append((DEFAULT, preview, EQUAL_ROAD, {**EQUAL, **known}))
        for headway_s in (SHORTER_S, EQUAL_ROAD_S):
            settings = {"overrides": {HEADWAY: headway_s}, **known}
            rows.append((DEFAULT, preview, f"at most {headway_s:g} s", settings))
    return [
        *rows,
        (DEFAULT, False, "120 m", none),
        (REFERENCE, True, "120 m", single),
        (DEFAULT, True, "120 m", {}),
    ]


def following(run: iptm.Run) -> dict[str, float]:
    """Return how a run kept its distance: smallest margin above s_min, seconds below it, smallest gap."""
    margins_m = gap_margins_m(run.trajectory, run.parameters)
    return {
        "margin_m": float(np.min(margins_m)),
        "below_s": int(np.sum(margins_m < -BELOW_S_MIN_M)),
        "smallest_gap_m": float(run.trajectory.gap_m.min()),
        "interventions": float(run.metrics.interventions),
        "leader_brakes_m_s2": -float(np.gradient(run.trajectory.leader_speed_m_s).min()),
    }


def run(session: Session) -> bool:
    """Run the study; returns whether the strong baseline kept its distance.

    That is: it touched no lead vehicle, and was below s_min for no longer than the default.
    """
    cycles = CYCLES[:1] if session.short else CYCLES
    cases = [
        Case(
            f"{cycle}/{number}",
            {"cycle": cycle, "strategy": name, "perfect": preview, "distance": distance},
            {"cycle": cycle, **settings},
        )
        for cycle in cycles
        for number, (name, preview, distance, settings) in enumerate(drives())
    ]
    leaders = _leader_cases(session)
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
        leaders = [case.shortened(SHORT_S) for case in leaders]
    driven = session.drive([*cases, *leaders])
    table = pd.DataFrame(
        row
        for _, group in driven[: len(cases)].groupby("cycle", sort=False)
        for row in _rows(group)
    )
    kept, below = _kept(driven[len(cases) :])
    of_place = table.groupby(["strategy", "perfect", "distance"], sort=False)
    front = [of_place.get_group(place) for place in FRONT]
    session.render(
        columns=COLUMNS,
        more=(RULE_COLUMN,),
        table=table,
        front=pd.concat(front, ignore_index=True),
        cells=len(AGING_CELLS),
        reserved=of_place.get_group((DEFAULT, False, f"at most {EQUAL_ROAD_S:g} s")),
        far=of_place.get_group((DEFAULT, True, "120 m")),
        kept=kept,
        below=below,
        desired_s=DESIRED_S,
        tuned_on=", ".join(TUNED_ON),
        trip_s=LONGEST_TRIP_S,
        car_length_m=CAR_LENGTH_M,
        moving_m_s=MOVING_M_S,
    )
    below_s = kept.groupby("strategy").below_s.sum()
    touched = (kept.smallest_gap_m <= 0.0).any()
    return bool(not touched and below_s[BASELINE] <= below_s[DEFAULT])


def _leader_cases(session: Session) -> list[Case]:
    """Return the trips behind cycles and measured lead vehicles, of three controls without a preview."""
    extent = (1, SHORTEST_S) if session.short else (SCENES, LONGEST_S)
    published = () if session.short else CYCLE_NAMES
    routes = trip_cycles(session.scratch / "trips", 1 if session.short else TRIPS)
    trips: list[tuple[str, str, dict[str, Any]]] = [
        *(("published cycle", name, {"cycle": name}) for name in published),
        *((HILLS, f"{name}, hills", {"cycle": name, "slope": "large"}) for name in published),
        *(("trip of an i3", Path(route).stem, {"cycle": route}) for route in routes),
        *(
            (
                "OpenACC leader",
                scene.name,
                {
                    "cycle": scene.write(session.scratch / "leads"),
                    "duration_s": float(scene.duration_s),
                },
            )
            for scene in measured_scenes(*extent)
        ),
    ]
    strategies: dict[str, dict[str, str]] = {
        BASELINE: {"strategy": BASELINE},
        PRODUCTION: {"strategy": PRODUCTION},
        DEFAULT: {},
    }
    return [
        Case(
            f"{leader}/{strategy}",
            {"cycle": leader, "strategy": strategy, "kind": kind},
            {**trip, **settings, "preview_mode": "none"},
        )
        for kind, leader, trip in trips
        for strategy, settings in strategies.items()
    ]


def _rows(group: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a cycle."""
    if group.run.isna().any():
        return []
    by_strategy = group.drop_duplicates("strategy").set_index("strategy").run
    bases = {name: [by_strategy[name].metrics] for name in (*BASES, RULE_PREVIEW)}
    return [
        {
            "cycle": each.cycle,
            "strategy": each.strategy,
            "perfect": each.perfect,
            "preview": PREVIEWS[each.perfect],
            "distance": each.distance,
            **road_taken([each.run.trajectory]),
            **savings([each.metrics], bases, each.run.parameters),
        }
        for each in group.itertuples()
    ]


def _kept(driven: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return how each control kept its distance by kind of lead vehicle, and where the default did not."""
    each = pd.DataFrame(
        {"strategy": one.strategy, "kind": one.kind, "leader": one.cycle, **following(one.run)}
        for one in driven.itertuples()
        if one.run is not None
    )
    summed = each.groupby(["kind", "strategy"], sort=False).agg(
        trips=("margin_m", "size"),
        margin_m=("margin_m", "min"),
        below_s=("below_s", "sum"),
        smallest_gap_m=("smallest_gap_m", "min"),
        interventions=("interventions", "sum"),
    )
    return summed.reset_index(), each[(each.strategy == DEFAULT) & (each.below_s > 0)]
