"""Savings at the headway of production cars, with a preview and with the range sensor alone.

The controller is drawn to a desired headway (`gap.desired_time_headway_s`) with which it takes the road of
`production`, and a kelvin keeps its value beyond the trip. Each trip is judged at equal ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.run import LONG_S, LONG_SCENES
from studies.acc.scenes import SHORTEST_S, long_scenes
from studies.acc.variants import CARS, CLIMATES_C
from studies.drives import DEFAULT, trip
from studies.road_space.run import DESIRED_S, EQUAL
from studies.savings import PREVIEWS, PRODUCTION, road_taken, saved
from studies.session import Case, Session

import iptm
from iptm.parts import CYCLE_NAMES

SHORT_CYCLES, SHORT_S = ("us06",), 60.0
BRAKING_M_S2 = 2.05
"""Harder than the limit of comfort."""


LEVEL, HILLS, MEASURED = "published cycle", "the same on hills up to 6 %", "OpenACC, 20 minutes"


def cases_of(session: Session) -> Iterator[Case]:
    """Yield three trips per leader, car and climate: `production`, without preview, with one."""
    cars, climates_c = (CARS[:1], CLIMATES_C[:1]) if session.short else (CARS, CLIMATES_C)
    cycles = SHORT_CYCLES if session.short else CYCLE_NAMES
    leaders: list[tuple[str, str, str, dict[str, Any]]] = [
        *((LEVEL, name, name, {}) for name in cycles),
        *((HILLS, name, name, {"slope": "large"}) for name in cycles),
    ]
    extent = (1, SHORTEST_S) if session.short else (LONG_SCENES, LONG_S)
    scenes, _ = long_scenes(*extent)
    for scene in scenes:
        drive = {"duration_s": float(scene.duration_s)}
        leaders.append((MEASURED, scene.name, scene.write(session.scratch / "leads"), drive))
    for (kind, name, cycle, drive), car, ambient_c in product(leaders, cars, climates_c):
        labels = {"kind": kind, "leader": name, "car": car, "ambient_c": ambient_c}
        for role, perfect in ((PRODUCTION, False), (DEFAULT, False), (DEFAULT, True)):
            own = EQUAL if role == DEFAULT else {}
            call = trip(cycle, role, car, ambient_c, **own, **drive)
            call["preview_mode"] = "full" if perfect else "none"
            place = "/".join(str(label) for label in labels.values())
            varied = {**labels, "role": role, "perfect": perfect}
            yield Case(f"{place}/{role}/{perfect}", varied, call)


def run(session: Session) -> bool:
    """Run the study; returns whether no lead vehicle was touched."""
    cases = list(cases_of(session))
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    keys = ["kind", "leader", "car", "ambient_c"]
    table = pd.DataFrame(
        row for _, trips in driven.groupby(keys, sort=False) for row in _rows(trips)
    )
    session.render(
        groups=_summary(table, ["perfect", "preview", "kind", "car", "ambient_c"]),
        overall=_summary(table, ["perfect", "preview"]),
        table=table,
        previews=PREVIEWS,
        desired_s=DESIRED_S,
    )
    return bool((table.smallest_gap_m > 0.0).all())


def _rows(trips: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield a row per trip of the default against `production` behind the same leader."""
    if trips.run.isna().any():
        return
    base: iptm.Run = trips[trips.role == PRODUCTION].run.iloc[0]
    before = _behaviour(base)
    for each in trips[trips.role == DEFAULT].itertuples():
        own = _behaviour(each.run)
        percent = saved([each.run.metrics], [base.metrics], each.run.parameters)
        labels = {name: getattr(each, name) for name in ("kind", "leader", "car", "ambient_c")}
        yield {
            **labels,
            "perfect": each.perfect,
            "preview": PREVIEWS[each.perfect],
            **own,
            **{f"base_{name}": value for name, value in before.items()},
            "off_s": own["headway_s"] - before["headway_s"],
            **percent,
        }


def _behaviour(run: iptm.Run) -> dict[str, float]:
    """Return road taken, smallest gap, hard braking, jerk and interventions of the safety monitor."""
    motion = run.trajectory
    accelerations = motion.acceleration_m_s2
    return {
        **road_taken([motion]),
        "smallest_gap_m": float(motion.gap_m.min()),
        "braking_s": float(np.sum(accelerations < -BRAKING_M_S2)),
        "jerk_m_s3": float(np.sqrt(np.mean(np.diff(accelerations) ** 2))),
        "interventions": float(run.metrics.interventions),
        "hours": float(run.metrics.duration_s) / 3600.0,
    }


def _summary(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Return medians and quartiles of the savings and what they cost, by group."""

    def of(rows: pd.DataFrame) -> pd.Series:
        quartiles = rows[["ageing", "energy"]].quantile([0.25, 0.5, 0.75])
        return pd.Series(
            {
                "trips": len(rows),
                "headway_s": rows.headway_s.median(),
                "base_headway_s": rows.base_headway_s.median(),
                "off_s": rows.off_s.median(),
                **{
                    f"{name}_{label}": quartiles.loc[share, name]
                    for name in ("ageing", "energy")
                    for label, share in (("low", 0.25), ("median", 0.5), ("high", 0.75))
                },
                "smallest_gap_m": rows.smallest_gap_m.min(),
                **{
                    f"{who}{name}": rows[f"{who}{name}"].sum() / rows.hours.sum()
                    for who in ("", "base_")
                    for name in ("braking_s", "interventions")
                },
                "jerk_m_s3": rows.jerk_m_s3.median(),
                "base_jerk_m_s3": rows.base_jerk_m_s3.median(),
            }
        )

    return table.groupby(by, sort=False).apply(of, include_groups=False).reset_index()
