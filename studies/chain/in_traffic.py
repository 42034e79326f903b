"""Leaders in simulated traffic (SUMO) on two corridors with signals, and the vehicles ahead of them.

Needs requirements/traffic.txt.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
from studies.chain.closed_loop import ChainScene

from iptm_core.parameters import load_parameters
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import FloatArray
from iptm_traffic.demand import (
    BEFORE_TRIP_S,
    LEADER,
    DemandSettings,
    TrafficScenario,
    signal_offsets_s,
    write_demand,
)
from iptm_traffic.network import CYCLE_S, build_network
from iptm_traffic.radio import Rehearsal, rehearse
from iptm_traffic.simulation import TrafficSimulation
from iptm_v2x_bridge.prediction.road_rules import RoadRules

CORRIDORS: Mapping[str, tuple[TrafficScenario, int]] = {
    "SUMO, ordinary traffic": (TrafficScenario.FOLLOWING, 1),
    "SUMO, a queue at the first line": (TrafficScenario.RED_LIGHT_QUEUE, 2),
}
"""Scenario and seed of traffic and signal offsets."""
MAIN_HEADWAY_S = 4.0
LENGTH_S, STEP_S = 600.0, 0.5
SAME_LANE_M, SEEN_M = 1.6, 150.0
"""A vehicle is ahead of the leader if it is in its lane and no farther than a sensor sees."""


def traffic_scene(corridor: str) -> tuple[ChainScene, RoadRules]:
    """Simulate a corridor; returns the leader with the vehicles ahead of it, and limits and signals."""
    scenario, seed = CORRIDORS[corridor]
    settings = DemandSettings(main_headway_s=MAIN_HEADWAY_S, traffic_seed=seed)
    gap_m = load_parameters().values.gap.initial_gap_m
    with tempfile.TemporaryDirectory() as name:
        offsets = signal_offsets_s(scenario, settings, CYCLE_S)
        network = build_network(Path(name), offsets, BEFORE_TRIP_S)
        given = scenario, settings, LENGTH_S, gap_m, STEP_S, Path(name)
        demand = write_demand(*given, with_stand_in=True)
        with closing(TrafficSimulation(network, demand, STEP_S, with_ego=False)) as simulation:
            driven = rehearse(simulation, LENGTH_S + 1.0)
    return _scene(corridor, driven), network.rules


def _scene(corridor: str, driven: Rehearsal) -> ChainScene:
    seconds: FloatArray = np.linspace(1.0, LENGTH_S, round(LENGTH_S), dtype=np.float64)
    names = [LEADER, *(name for name in driven if name != LEADER)]
    moved = np.array([_at(driven[name], seconds) for name in names])
    fronts, aside, speeds = np.moveaxis(moved, 1, 0)
    gaps = fronts[1:] - fronts[0] - VEHICLE_LENGTH_M
    ahead = (np.abs(aside[1:] - aside[0]) < SAME_LANE_M) & (gaps > 0.0)
    gaps = np.where(ahead, gaps, np.inf)
    nearest = np.argsort(gaps, axis=0)[:2]
    near = np.take_along_axis(gaps, nearest, axis=0)
    near[near >= SEEN_M] = np.nan
    speed = np.where(np.isnan(near), np.nan, np.take_along_axis(speeds[1:], nearest, axis=0))
    # The trip begins a second earlier, at rest.
    speed, near, nearest = (np.hstack([each[:, :1], each]) for each in (speed, near, nearest))
    return ChainScene(
        corridor.replace(",", "").replace(" ", "_"),
        np.append(0.0, speeds[0]),
        speed[0],
        near[0],
        speed[1],
        near[1],
        nearest,
    )


def _at(drive: FloatArray, seconds: FloatArray) -> FloatArray:
    """Return front, place beside the road and speed at whole seconds, NaN where it is not there."""
    times, along, aside = drive
    if times.size < 2:
        return np.full((3, seconds.size), np.nan)
    speeds = np.maximum(np.gradient(along, times), 0.0)
    columns = [np.interp(seconds, times, each, np.nan, np.nan) for each in (along, aside, speeds)]
    return np.array(columns)
