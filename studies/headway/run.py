"""Savings at the headways of production cars, with a preview and with the range sensor alone.

The controller is drawn to a desired headway (`gap.desired_time_headway_s`) with which it takes the road of
`production`, and a kelvin keeps its value beyond the trip. Each trip is judged at equal ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.figures import jerk_m_s3
from studies.acc.run import LONG_S, LONG_SCENES
from studies.acc.scenes import SHORTEST_S, Scene, long_scenes
from studies.acc.variants import CARS, CLIMATES_C
from studies.drives import DEFAULT, trip
from studies.headway.behind import STRING_CARS, cars_behind
from studies.headway.disturbed import disturbed_trials
from studies.headway.effects import BLIND, BOTH, BRIEF_S, WHOLE_S, effects
from studies.road_space.run import DESIRED_S, EQUAL
from studies.savings import (
    BASELINE,
    PREVIEWS,
    PRODUCTION,
    PRODUCTION_SIMPLE,
    RULE_PREVIEW,
    kept,
    road_taken,
    saved,
)
from studies.session import Case, Session

import iptm
from iptm_core.routes.cycles import CYCLE_NAMES
from iptm_core.state import FloatArray

SHORT_CYCLES, SHORT_S = ("us06",), 60.0
BRAKING_M_S2 = 2.05
"""Harder than the limit of comfort."""
LEVEL, HILLS, MEASURED = "published cycle", "the same on hills up to 6 %", "OpenACC, 20 minutes"


@dataclass(frozen=True)
class Setting:
    """Settings of the trips of the default and of `production`, and what is driven."""

    name: str
    own: Mapping[str, Any]
    base: Mapping[str, Any]
    previews: tuple[bool, ...] = (False, True)
    climates_c: tuple[float, ...] = CLIMATES_C[:1]
    cars: tuple[str, ...] = CARS
    kinds: tuple[str, ...] = (LEVEL, HILLS, MEASURED)


SHORT_DESIRED_S, SHORT_ACC_S = 1.15, 1.1
DRY, QUICK_M_S3 = 0.9, 2.0
QUICK = {"limits.max_jerk_m_s3": QUICK_M_S3}
AT_2_S = Setting("2 s", EQUAL, {}, climates_c=CLIMATES_C)
SETTINGS = (
    AT_2_S,
    Setting(
        "1.5 s",
        {
            **EQUAL,
            "overrides": {
                "gap.desired_time_headway_s": SHORT_DESIRED_S,
                "gap.time_headway_s": 1.0,
            },
        },
        {"acc_time_headway_s": SHORT_ACC_S},
        kinds=(LEVEL, MEASURED),
    ),
    Setting(
        f"2 s, jerk up to {QUICK_M_S3:g} m/s³",
        {**EQUAL, "overrides": {**EQUAL["overrides"], **QUICK}},
        {"overrides": QUICK},
    ),
    Setting(
        "2 s, known dry road",
        {**EQUAL, "road_friction": DRY},
        {"road_friction": DRY},
        (False,),
        cars=CARS[:1],
    ),
)


def cases_of(session: Session, scenes: list[Scene]) -> Iterator[Case]:
    """Yield the trips per setting, leader, car and climate: the default by preview, and both bases."""
    cycles = SHORT_CYCLES if session.short else CYCLE_NAMES
    leaders: list[tuple[str, str, str, dict[str, Any], int]] = [
        *((LEVEL, name, name, {}, 0) for name in cycles),
        *((HILLS, name, name, {"slope": "large"}, 0) for name in cycles),
    ]
    for scene in scenes:
        drive = {"duration_s": float(scene.duration_s)}
        path = scene.write(session.scratch / "leads")
        leaders.append((MEASURED, scene.name, path, drive, scene.run_in_s))
    most = 1 if session.short else None
    places = [
        (setting, *place)
        for setting in SETTINGS[: 2 if session.short else None]
        for place in product(leaders, setting.cars[:most], setting.climates_c[:most])
        if place[0][0] in setting.kinds
    ]
    for setting, leader, car, ambient_c in places:
        kind, name, cycle, drive, begin = leader
        place = {"setting": setting.name, "kind": kind, "leader": name, "car": car}
        labels = {**place, "ambient_c": ambient_c, "begin": begin}
        roles = [(PRODUCTION, False), *((DEFAULT, perfect) for perfect in setting.previews)]
        if setting is AT_2_S:
            roles += [(PRODUCTION_SIMPLE, False), (BASELINE, False), (RULE_PREVIEW, True)]
        for role, perfect in roles:
            own = setting.own if role == DEFAULT else setting.base
            call = trip(cycle, role, car, ambient_c, **own, **drive)
            call["preview_mode"] = "full" if perfect else "none"
            where = "/".join(str(label) for label in labels.values())
            yield Case(
                f"{where}/{role}/{perfect}", {**labels, "role": role, "perfect": perfect}, call
            )


def run(session: Session) -> bool:
    """Run the study; returns whether no lead vehicle was touched, but where that was unavoidable."""
    extent = (1, SHORTEST_S) if session.short else (LONG_SCENES, LONG_S)
    scenes, _ = long_scenes(*extent)
    cases = list(cases_of(session, scenes))
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    keys = ["setting", "kind", "leader", "car", "ambient_c"]
    table = pd.DataFrame(
        row for _, trips in driven.groupby(keys, sort=False) for row in _rows(trips)
    )
    overall = _summary(table, ["setting", "role", "perfect", "preview"])
    table = table[table.role == DEFAULT]
    groups = _summary(table, ["setting", "perfect", "preview", "kind", "car", "ambient_c"])
    measured = table[table.kind == MEASURED]
    origins, shares = effects(session)
    disturbed, collisions = disturbed_trials(
        session, {each.name: each.own for each in SETTINGS[: 2 if session.short else 3]}
    )
    session.render(
        groups=groups[groups.setting == AT_2_S.name],
        overall=overall[overall.role == DEFAULT],
        headline=overall[overall.setting == AT_2_S.name],
        lowest=groups.groupby(["setting", "preview"], sort=False)[
            ["ageing_median", "energy_median"]
        ].min(),
        measured=_summary(measured, ["setting", "perfect", "preview"]),
        people=_people(scenes),
        table=table[table.setting == AT_2_S.name],
        previews=PREVIEWS,
        behind=cars_behind(session),
        disturbed=disturbed,
        collisions=collisions,
        cars=STRING_CARS,
        origins=origins,
        share=shares[BOTH],
        blind_share=shares[BLIND],
        whole_s=WHOLE_S,
        brief_s=BRIEF_S,
        desired_s=DESIRED_S,
        short_desired_s=SHORT_DESIRED_S,
        short_acc_s=SHORT_ACC_S,
        quick_m_s3=QUICK_M_S3,
        dry=DRY,
    )
    return bool((table.smallest_gap_m > 0.0).all() and not disturbed.avoidable.any())


def _rows(trips: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield a row per trip against `production` behind the same leader."""
    if trips.run.isna().any():
        return
    by_role = trips.drop_duplicates("role").set_index("role").run
    base: iptm.Run = by_role[PRODUCTION]
    rule = by_role.get(RULE_PREVIEW)
    for each in trips[trips.role != PRODUCTION].itertuples():
        own, before = (_behaviour(run, each.begin) for run in (each.run, base))
        percent = saved([each.run.metrics], [base.metrics], each.run.parameters)
        names = ("setting", "role", "kind", "leader", "car", "ambient_c", "perfect")
        yield {
            **{name: getattr(each, name) for name in names},
            "preview": PREVIEWS[each.perfect],
            **own,
            **{f"base_{name}": value for name, value in before.items()},
            "off_s": own["headway_s"] - before["headway_s"],
            **percent,
            **{
                f"rule_{kind}": value
                for kind, value in _over(each.run, rule if each.perfect else None).items()
            },
        }


def _over(own: iptm.Run, rule: iptm.Run | None) -> dict[str, float]:
    """Return what a run saves over the rule with the same preview; NaN without one."""
    if rule is None:
        return {"ageing": np.nan, "energy": np.nan}
    return saved([own.metrics], [rule.metrics], own.parameters)


def _behaviour(run: iptm.Run, begin: int) -> dict[str, float]:
    """Return road taken, smallest gap and interventions of a run, and its comfort from an instant on."""
    motion = run.trajectory
    return {
        **road_taken([motion]),
        **kept([run.metrics]),
        "smallest_gap_m": float(motion.gap_m.min()),
        **_comfort(motion.speed_m_s[begin:]),
        "interventions": float(run.metrics.interventions),
        "hours": float(run.metrics.duration_s) / 3600.0,
    }


def _comfort(speeds_m_s: FloatArray) -> dict[str, float]:
    """Return seconds of hard braking and the jerk of speeds at steps of a second."""
    braking = np.diff(speeds_m_s) < -BRAKING_M_S2
    return {"braking_s": float(braking.sum()), "jerk_m_s3": jerk_m_s3(speeds_m_s)}


def _people(scenes: list[Scene]) -> dict[str, float]:
    """Return hard braking per hour and median jerk of the cars that followed the measured leaders."""
    real = pd.DataFrame(_comfort(scene.speed_m_s[scene.run_in_s :]) for scene in scenes)
    hours = sum(scene.duration_s - scene.run_in_s for scene in scenes) / 3600.0
    return {
        "braking_s": float(real.braking_s.sum()) / hours,
        "jerk_m_s3": float(real.jerk_m_s3.median()),
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
                "rule_ageing": rows.rule_ageing.dropna().median(),
                "rule_energy": rows.rule_energy.dropna().median(),
                **{
                    f"{who}{name}": rows[f"{who}{name}"].max()
                    for who in ("", "base_")
                    for name in ("longest_s", "deepest_m")
                },
                "smallest_gap_m": rows.smallest_gap_m.min(),
                **{
                    f"{who}{name}": rows[f"{who}{name}"].sum() / rows.hours.sum()
                    for who in ("", "base_")
                    for name in ("below_s", "braking_s", "interventions")
                },
                "jerk_m_s3": rows.jerk_m_s3.median(),
                "base_jerk_m_s3": rows.base_jerk_m_s3.median(),
            }
        )

    return table.groupby(by, sort=False).apply(of, include_groups=False).reset_index()
