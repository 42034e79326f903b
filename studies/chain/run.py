"""What the vehicle ahead of the leader is worth: forecasts held out, closed loop, lies and faults, time."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.chain.closed_loop import (
    FARTHER,
    MESSAGES,
    SECOND_TRACK,
    ChainScene,
    drive,
    scenes,
)
from studies.chain.corridor import BOTH_RULES, CYCLES, careful_driver, controls
from studies.chain.fit import fitted_law
from studies.chain.forecasts import EQUIPPED, SHOWN_S, errors, of_equipped
from studies.chain.in_traffic import CORRIDORS, LENGTH_S, traffic_scene
from studies.chain.platoons import HELD_OUT, instants, joined
from studies.chain.trials import SETTINGS, chain_trials
from studies.collisions.family_trials import summary
from studies.drives import DEFAULT, trip
from studies.road_space.run import DESIRED_S
from studies.savings import PRODUCTION, kept, road_taken, saved
from studies.session import Session
from studies.speed.harness import quantiles

from iptm_core.lead_track import RangeTrack
from iptm_core.settings import PreviewSettings
from iptm_core.state import NS_PER_S
from iptm_its.car_following import shipped_law
from iptm_its.chain import ChainBridge
from iptm_v2x_bridge.range_sensor import RangeSensorBridge

AMBIENT_C = 35.0
PLACE = 3
"""Place in the platoon of the leaders that are followed."""
NONE, PERFECT = "no preview", "perfect, {:g} s"
PREVIEWS_S = (60.0, 5.0, 2.0)
DETAILED = "2 s"
"""Headway at which all sources are priced."""
HEADWAYS: Mapping[str, Mapping[str, float]] = {
    "2 s": {"gap.desired_time_headway_s": DESIRED_S},
    "1.5 s": {"gap.desired_time_headway_s": 1.15, "gap.time_headway_s": 1.0},
}
SOURCES: Mapping[str, Mapping[str, Any]] = {
    SECOND_TRACK: {"source": SECOND_TRACK},
    MESSAGES: {"source": MESSAGES},
    FARTHER: {"source": FARTHER},
    "messages, 0.3 s late, 30 % lost": {"source": MESSAGES, "delay_s": 0.3, "loss": 0.3},
}
TOGETHER = "second track, signals and limits"
SHARED = ("energy", "energy_share", "ageing", "ageing_share", "below_s")
BARS = {SECOND_TRACK: 40.0, BOTH_RULES: 40.0}
EQUIPPED_BAR, EQUIPPED_SHARE = 50.0, 20.0
TRIALS, SEED = 11, 57
SHORT_ROWS, SHORT_S = 400, 60.0
TIMED_TICKS = 2000
_Control = tuple[str, Mapping[str, Any], Mapping[str, Any]]
"""Name, arguments of `iptm.simulate`, and sources of knowledge about the leader."""


def run(session: Session) -> bool:
    """Run the study; returns whether forecasts and trials held."""
    short = session.short
    rows = SHORT_ROWS if short else None
    forecast, equipped = errors(rows), of_equipped(rows)
    prices = priced(session)
    settings = SETTINGS[:1] if short else SETTINGS
    count = 1 if short else TRIALS
    calls = [{"setting": setting, "count": count, "seed": SEED} for setting in settings]
    found = session.compute(chain_trials, calls, [setting.name for setting in settings])
    trials = pd.concat([table for table in found if table is not None], ignore_index=True)
    families = summary(trials)
    ahead = forecast[2]
    holds = {
        "error at 2 and 5 s at least 30 % smaller": min(ahead["less_2"], ahead["less_5"]) >= 30.0,
        "90 % bounds hold in 85 to 95 %": all(
            85.0 <= ahead[f"inside_{lead_s:g}"] <= 95.0 for lead_s in SHOWN_S
        ),
        "no avoidable collision": not families.avoidable.sum(),
    }
    corridors = [] if short else behind_signals(session)
    traffic = [] if short else in_traffic(session)
    detailed = [row | {"road": "OpenACC"} for row in prices if row["headway"] == DETAILED]
    shares = [] if short else of_senders([*detailed, *traffic])
    session.render(
        forecast=forecast,
        shown_s=SHOWN_S,
        equipped=equipped,
        prices=prices,
        corridors=corridors,
        traffic=traffic,
        shares=shares,
        bars=bars(prices, corridors, traffic, shares),
        families=families.to_dict("records"),
        trials=len(trials),
        holds=holds,
        held_out=HELD_OUT,
        fitted_to=shipped_law().fitted_to,
        times=None if short else tick_times_us(),
        ambient_c=AMBIENT_C,
    )
    return all(holds.values()) or short


def priced(session: Session) -> list[dict[str, Any]]:
    """Return a row per headway and source: road, savings against `production`, margins, share of the gap."""
    found = scenes(PLACE)
    headways = dict(HEADWAYS)
    if session.short:
        found, headways = found[-1:], {DETAILED: HEADWAYS[DETAILED]}
    cases = [
        (headway, name, scene, call, sources)
        for headway, scene in product(headways, found)
        for name, call, sources in _controls(session, scene, headways[headway])
    ]
    calls = [
        {"call": call, "scene": scene if sources else None, **sources}
        for *_, scene, call, sources in cases
    ]
    names = [f"{headway}, {name}, {scene.name}" for headway, name, scene, *_ in cases]
    driven = session.compute(drive, calls, names)
    table = pd.DataFrame(
        {"headway": headway, "control": name, "scene": scene.name, "run": out[0]}
        for (headway, name, scene, *_), out in zip(cases, driven, strict=True)
        if out is not None
    )
    return [
        row
        for headway, group in table.groupby("headway", sort=False)
        for row in _rows(str(headway), group)
    ]


def behind_signals(session: Session) -> list[dict[str, Any]]:
    """Return the rows of two corridors of signals behind drivers who keep them."""
    own = {"overrides": HEADWAYS[DETAILED], "value_beyond_trip": True}
    rows = []
    for cycle in CYCLES:
        leads = careful_driver(session.scratch / "leads", cycle)
        rows += _on_road(session, cycle, controls(cycle, leads, AMBIENT_C, own))
    return rows


def in_traffic(session: Session) -> list[dict[str, Any]]:
    """Return the rows of two corridors in simulated traffic."""
    rows = []
    own: dict[str, Any] = {"overrides": HEADWAYS[DETAILED], "value_beyond_trip": True}
    names = list(CORRIDORS)
    found = session.compute(traffic_scene, [{"corridor": name} for name in names], names, 1)
    for name, (scene, rules) in zip(names, filter(None, found), strict=True):
        leads = scene.write(session.scratch / "leads")
        given: dict[str, Any] = {"ambient_c": AMBIENT_C, "duration_s": LENGTH_S}
        blind = trip(leads, DEFAULT, **given, **own, preview_mode="none")
        ahead = trip(leads, DEFAULT, **given, **own)
        cases: list[_Control] = [
            (PRODUCTION, trip(leads, PRODUCTION, **given, preview_mode="none"), {}),
            (NONE, blind, {}),
            (PERFECT.format(PREVIEWS_S[0]), ahead, {}),
            *((each, ahead, {"scene": scene, **SOURCES[each]}) for each in SOURCES),
            (TOGETHER, ahead, {"scene": scene, "source": SECOND_TRACK, "rules": rules}),
        ]
        rows += _on_road(session, name, cases)
    return rows


def _on_road(session: Session, road: str, cases: Sequence[_Control]) -> list[dict[str, Any]]:
    calls = [{"call": call, **sources} for _, call, sources in cases]
    driven = session.compute(drive, calls, [f"{road}, {name}" for name, *_ in cases])
    table = pd.DataFrame(
        {"control": name, "run": out[0]}
        for (name, *_), out in zip(cases, driven, strict=True)
        if out is not None
    )
    return [{"road": road, **row} for row in _rows(DETAILED, table)]


def of_senders(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a row per road and share of vehicles that send, each of them independently.

    The nearest vehicle ahead of the leader that sends counts, of two; without one there is no preview.
    """
    found = []
    for road, share in product(dict.fromkeys(row["road"] for row in rows), EQUIPPED):
        by_control = {row["control"]: row for row in rows if row["road"] == road}
        parts = {MESSAGES: share, FARTHER: share * (1.0 - share), NONE: (1.0 - share) ** 2}
        mean = {
            key: sum(part * by_control[name][key] for name, part in parts.items()) for key in SHARED
        }
        found.append({"road": road, "share": 100.0 * share, **mean})
    return found


def bars(
    prices: Sequence[Mapping[str, Any]],
    corridors: Sequence[Mapping[str, Any]],
    traffic: Sequence[Mapping[str, Any]],
    shares: Sequence[Mapping[str, Any]],
) -> list[dict[str, Any]]:
    """Return how much of the gap is closed, beside the bars for energy and ageing."""
    rows: list[Mapping[str, Any]] = [
        {**row, "road": f"OpenACC, {row['headway']}"} for row in prices
    ]
    rows += [*corridors, *traffic]
    asked = [(row, row["control"], BARS[row["control"]]) for row in rows if row["control"] in BARS]
    asked += [
        (row, f"messages, {row['share']:.0f} % send", EQUIPPED_BAR)
        for row in shares
        if row["share"] == EQUIPPED_SHARE
    ]
    below_s = {row["road"]: row["below_s"] for row in rows if row["control"] == PRODUCTION}
    below_s["OpenACC"] = below_s.get(f"OpenACC, {DETAILED}", np.nan)
    return [
        {
            "what": f"{row['road']}, {what}",
            "asked": f"{share:.0f} %",
            "energy": row["energy_share"],
            "ageing": row["ageing_share"],
            "reached": min(row["energy_share"], row["ageing_share"]) >= share,
            "below_s": row["below_s"],
            "production_s": below_s[row["road"]],
        }
        for row, what, share in asked
    ]


def _controls(
    session: Session, scene: ChainScene, overrides: Mapping[str, float]
) -> list[_Control]:
    cycle = scene.write(session.scratch / "leads")
    length_s = SHORT_S if session.short else scene.duration_s
    blind: dict[str, Any] = {"preview_mode": "none"}
    own: dict[str, Any] = {"overrides": overrides, "value_beyond_trip": True}

    def call(role: str, **settings: Any) -> Mapping[str, Any]:
        return trip(cycle, role, ambient_c=AMBIENT_C, duration_s=length_s, **settings)

    whole = not session.short and overrides == HEADWAYS[DETAILED]
    previews = PREVIEWS_S if whole else PREVIEWS_S[:1]
    sources = list(SOURCES) if whole else [SECOND_TRACK]
    return [
        (PRODUCTION, call(PRODUCTION, **blind), {}),
        (NONE, call(DEFAULT, **own, **blind), {}),
        *((PERFECT.format(s), call(DEFAULT, **own, preview_length_s=s), {}) for s in previews),
        *((name, call(DEFAULT, **own), SOURCES[name]) for name in sources),
    ]


def _rows(headway: str, group: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a headway; savings are of all scenes together, each brought to one end."""
    by_control = {name: list(part.run) for name, part in group.groupby("control", sort=False)}
    base = [run.metrics for run in by_control[PRODUCTION]]
    rows = []
    for name, runs in by_control.items():
        metrics = [run.metrics for run in runs]
        limited = [run.decisions.limiter_active for run in runs]
        rows.append(
            {
                "headway": headway,
                "control": name,
                **road_taken([run.trajectory for run in runs]),
                **saved(metrics, base, runs[0].parameters),
                **kept(metrics),
                "interventions": sum(each.interventions for each in metrics),
                "limited": 100.0 * float(np.concatenate(limited).mean()),
                "smallest_gap_m": min(float(run.trajectory.gap_m.min()) for run in runs),
            }
        )
    none = next(row for row in rows if row["control"] == NONE)
    whole = next(row for row in rows if row["control"] == PERFECT.format(PREVIEWS_S[0]))
    for row in rows:
        for kind in ("energy", "ageing"):
            gap = whole[kind] - none[kind]
            row[f"{kind}_share"] = 100.0 * (row[kind] - none[kind]) / gap if gap else np.nan
    return rows


def tick_times_us() -> dict[str, float]:
    """Return quantiles of the processor time of a tick's forecast, in microseconds, of 2,000 ticks."""
    sensor = RangeSensorBridge()
    chain = ChainBridge(sensor, PreviewSettings(), sensor=sensor)
    tracks = RangeTrack(40.0, 0.0, 0.0), RangeTrack(76.0, 0.0, 0.0)
    times = []
    for tick in range(TIMED_TICKS):
        sensor.take(tick * NS_PER_S, tracks)
        began_s = time.process_time()
        chain.answer(tick * NS_PER_S, 20.0 * tick, 20.0)
        times.append(1e6 * (time.process_time() - began_s))
    law, past = shipped_law(), instants().past
    one = type(past)(*(column[:1] for column in past))
    began_s = time.process_time()
    for _ in range(TIMED_TICKS):
        law.motion(one)
    alone = 1e6 * (time.process_time() - began_s) / TIMED_TICKS
    return {**quantiles(np.array(times)), "mean": statistics.mean(times), "law": alone}


def fit() -> str:
    """Return the shipped law anew, fitted to the runs that are not held out, one and two vehicles ahead."""
    both = joined([each.where(~np.isin(each.run, HELD_OUT)) for each in (instants(1), instants(2))])
    return fitted_law(both).as_json()
