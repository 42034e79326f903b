"""A corridor of signals behind a driver who keeps them: what their announced phases show of the leader."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from studies.drives import DEFAULT, trip
from studies.empty_road.run import ADVISED, LINES
from studies.measured_cycles import write_drive
from studies.savings import PRODUCTION

import iptm
from iptm_core.road_ahead import SpeedLimits
from iptm_core.settings import VEHICLE_LENGTH_M, LeaderSource
from iptm_core.units import KM_H_PER_M_S
from iptm_v2x_bridge.prediction.road_rules import RoadRules
from iptm_v2x_bridge.rules_of_the_road import OF_THE_CYCLE, given_rules

BOTH_RULES = "signals and limits"
CYCLES, LENGTH_S = ("udds", "wltc_class3b"), 600.0


def _driver(cycle: str) -> dict[str, Any]:
    return {
        "cycle": cycle,
        "strategy": PRODUCTION,
        "leader_source": LeaderSource.NONE,
        "speed_limits_km_h": OF_THE_CYCLE,
        "signals": LINES,
        "duration_s": LENGTH_S,
    }


def careful_driver(folder: Path, cycle: str) -> str:
    """Drive the corridor with `production` at its signals and limits, and write that as a leader's drive."""
    run = iptm.simulate(**_driver(cycle))
    speeds = np.maximum(run.trajectory.speed_m_s, 0.0)
    return str(write_drive(folder / f"{cycle}_with_stop_lines.csv", 1.0, speeds))


def rules_ahead(cycle: str, initial_gap_m: float) -> RoadRules:
    """Return limits and signals where a leader that starts ahead of the ego vehicle has them."""
    trip_alone = iptm.Trip.of(**_driver(cycle))
    rules = given_rules(trip_alone.rules, trip_alone.route)
    if rules.limits is None:
        raise AssertionError("a corridor of this study has limits")
    ahead_m = initial_gap_m + VEHICLE_LENGTH_M
    starts_m = rules.limits.starts_m + ahead_m
    starts_m[0] = 0.0
    signals = tuple(replace(each, stop_line_m=each.stop_line_m + ahead_m) for each in rules.signals)
    return RoadRules(SpeedLimits(starts_m, rules.limits.limits_m_s), signals)


def controls(
    cycle: str, leads: str, ambient_c: float, own: Mapping[str, Any]
) -> list[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    """Return name, settings and sources of each control behind that driver."""
    blind = {"preview_mode": "none"}

    def call(role: str, **settings: Any) -> dict[str, Any]:
        return trip(leads, role, ambient_c=ambient_c, duration_s=LENGTH_S, **settings)

    gap_m = iptm.Trip.of(**call(DEFAULT)).parameters.gap.initial_gap_m
    rules = rules_ahead(cycle, gap_m)
    lines = (line.partition(":") for line in LINES.split(", "))
    ahead_m = gap_m + VEHICLE_LENGTH_M
    own_road = {
        "ego_keeps_rules": True,
        "speed_limits_km_h": _as_text(rules.limits),
        "signals": ", ".join(f"{float(at_m) + ahead_m:g}:{plan}" for at_m, _, plan in lines),
    }
    return [
        (PRODUCTION, call(PRODUCTION, **blind), {}),
        (PRODUCTION + ADVISED, call(PRODUCTION, **blind, **own_road), {"advised": True}),
        ("no preview", call(DEFAULT, **own, **blind), {}),
        ("perfect, 60 s", call(DEFAULT, **own), {}),
        ("signals", call(DEFAULT, **own), {"rules": replace(rules, limits=None)}),
        (BOTH_RULES, call(DEFAULT, **own), {"rules": rules}),
    ]


def _as_text(limits: SpeedLimits | None) -> str:
    if limits is None:
        return ""
    parts = zip(limits.starts_m, KM_H_PER_M_S * limits.limits_m_s, strict=True)
    return ", ".join(f"{start_m:g}:{limit:g}" for start_m, limit in parts)
