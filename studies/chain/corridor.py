"""A corridor of signals behind a driver who keeps them: what their announced phases show of the leader."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from studies.drives import DEFAULT, trip
from studies.empty_road.run import LINES
from studies.measured_cycles import write_drive
from studies.savings import PRODUCTION

import iptm
from iptm_core.settings import VEHICLE_LENGTH_M, LeaderSource
from iptm_v2x_bridge.prediction.road_rules import RoadRules, Signal
from iptm_v2x_bridge.rules_of_the_road import OF_THE_CYCLE

CYCLE, LENGTH_S = "udds", 600.0
NAME = "udds_with_stop_lines"


def careful_driver(folder: Path, duration_s: float) -> str:
    """Drive the corridor with `production` at its signals and limits, and write that as a leader's drive."""
    run = iptm.simulate(
        CYCLE,
        strategy=PRODUCTION,
        leader_source=LeaderSource.NONE,
        speed_limits_km_h=OF_THE_CYCLE,
        signals=LINES,
        duration_s=duration_s,
    )
    speeds = np.maximum(run.trajectory.speed_m_s, 0.0)
    return str(write_drive(folder / f"{NAME}.csv", 1.0, speeds))


def lines_ahead(initial_gap_m: float) -> RoadRules:
    """Return the signals where a leader that starts ahead of the ego vehicle has them."""
    ahead_m = initial_gap_m + VEHICLE_LENGTH_M
    found = []
    for line in LINES.split(","):
        place_m, *plan = map(float, line.split(":"))
        found.append(Signal.cyclic(place_m + ahead_m, *plan))
    return RoadRules(None, tuple(found))


def controls(
    cycle: str, duration_s: float, ambient_c: float, own: Mapping[str, Any]
) -> list[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    """Return name, settings and sources of each control behind that driver."""
    blind = {"preview_mode": "none"}

    def call(role: str, **settings: Any) -> dict[str, Any]:
        return trip(cycle, role, ambient_c=ambient_c, duration_s=duration_s, **settings)

    gap_m = iptm.Trip.of(**call(DEFAULT)).parameters.gap.initial_gap_m
    return [
        (PRODUCTION, call(PRODUCTION, **blind), {}),
        ("no preview", call(DEFAULT, **own, **blind), {}),
        ("perfect, 60 s", call(DEFAULT, **own), {}),
        ("announced signals", call(DEFAULT, **own), {"rules": lines_ahead(gap_m)}),
    ]
