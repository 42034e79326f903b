"""Input of a predictor from the messages of a station."""

from __future__ import annotations

import math

import numpy as np

from iptm_core.routes.road_line import NEAR_M, RoadLine
from iptm_v2x_bridge.prediction.predictor import Knowledge, RoadPath
from iptm_v2x_bridge.stations.station import Station

MAX_PATH_AGE_MS = 10_000
"""Age up to which the last received path is used, as not every message carries one and some are lost."""
AROUND_M, AROUND_M_S = 200.0, 100.0
"""How far from a point of a path the next one is looked for, and how much farther with the time between."""
MAX_ASIDE_M = 10.0
"""A predicted path that leaves the road by more than this ends there: the leader means to turn off."""


def knowledge_of(station: Station, road: RoadLine, until_s: float = math.inf) -> Knowledge:
    """Return the observations of a station, and its predicted path as far as it stays on the road.

    Args:
        station: the station.
        road: the road of the ego vehicle.
        until_s: s of TimestampIts; what was observed later is left out where there is anything before.
    """
    length_m = station.message.front_to_rear_m
    stood_s = station.last.time_s - station.moved_s
    observations = tuple(station.observations)
    by_then = tuple(each for each in observations if each.time_s <= until_s)
    return Knowledge(by_then or observations[:1], _road_path(station, road), length_m, stood_s)


def _road_path(station: Station, road: RoadLine) -> RoadPath | None:
    if station.path is None or station.generated_ms - station.path[0] > MAX_PATH_AGE_MS:
        return None
    generated_ms, path, rear_m = station.path
    length_m = station.message.front_to_rear_m
    times, places = [generated_ms / 1000.0], [rear_m]
    near_m = rear_m + length_m
    points = zip(
        path.times_s.tolist(),
        path.latitudes_deg.tolist(),
        path.longitudes_deg.tolist(),
        strict=True,
    )
    for time_s, latitude, longitude in points:
        # Most of the time goes into the road that is looked at; no leader gets farther between two points.
        elapsed_s = generated_ms / 1000.0 + time_s - times[-1]
        around_m = min(AROUND_M + AROUND_M_S * elapsed_s, NEAR_M)
        fix = road.project(latitude, longitude, near_m, around_m)
        if abs(fix.lateral_m) > MAX_ASIDE_M:
            break
        near_m = fix.position_m
        times.append(generated_ms / 1000.0 + time_s)
        places.append(near_m - length_m)
    return RoadPath(np.array(times), np.array(places)) if len(times) > 1 else None
