"""Traffic demand of the corridor: vehicles drawn once from a seed and written as SUMO routes.

Drivers differ in how fast they like to go and are not random otherwise, so that a simulation repeats exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.settings import MAX_SEED, VEHICLE_LENGTH_M
from iptm_traffic.network import BLOCKS, EGO_LANE, EGO_START_M, MAIN_EDGES, ONCOMING_EDGES, SIGNALS

BEFORE_TRIP_S = 120.0
"""Time for which the traffic drives before the trip begins."""
EGO, LEADER = "ego", "leader"
CAR, EGO_KIND = "car", "ego"
"""SUMO's types of vehicles."""
MAIN_PREFIX = "main"
MAIN_NAMES = (MAIN_PREFIX, LEADER)
"""What the names of the vehicles that drive along the main road begin with."""

_CAR = {
    "length": f"{VEHICLE_LENGTH_M:g}",
    "minGap": "2.5",
    "carFollowModel": "IDM",
    "accel": "1.6",
    "decel": "1.6",
    "emergencyDecel": "4.5",
    "tau": "1.3",
    "sigma": "0",
    "speedDev": "0",
}
# What others see of the ego vehicle when they move in front of it: its jerk limit lets it brake only gently.
_EGO = {"tau": "3", "decel": "0.8"}
_QUIET_S = (-14.0, 6.0)
"""No car starts behind or over the standing ego, s of trip time."""
_SHORTEST_HEADWAY_S = 2.5


class TrafficScenario(TextEnum):
    """What happens around the ego vehicle."""

    FOLLOWING = "following"
    """A leader drives ahead in ordinary traffic."""
    CUT_IN = "cut_in"
    """Cars of the other lane move in between, again and again."""
    TURN_OFF = "turn_off"
    """The leader turns off, and so does every leader after it."""
    RED_LIGHT_QUEUE = "red_light_queue"
    """The first lines close in front of a queue that the ego vehicle arrives at."""


@dataclass(frozen=True)
class DemandSettings(Settings):
    """How much traffic there is."""

    main_headway_s: float = parameter(
        9.0, "mean time between two cars that enter the main road", "s", 3.0, 600.0
    )
    oncoming_headway_s: float = parameter(
        20.0, "mean time between two cars that enter from the other end", "s", 3.0, 600.0
    )
    cross_headway_s: float = parameter(
        40.0, "mean time between two cars on each arm of a cross street", "s", 5.0, 600.0
    )
    turning_share: float = parameter(
        0.3, "share of the cars of the main road that turn off somewhere", "", 0.0, 1.0
    )
    traffic_seed: int = parameter(1, "seed of cars and signal offsets", "", 0, MAX_SEED)


_Trip = tuple[float, str, tuple[str, ...], float, dict[str, str]]
"""Departure (s of SUMO's time), name, edges, speed in speed limits and way of starting of a vehicle."""


def signal_offsets_s(
    scenario: TrafficScenario, settings: DemandSettings, cycle_s: float
) -> tuple[float, ...]:
    """Return for each signal a trip time at which the main road turns green."""
    draws = np.random.default_rng([settings.traffic_seed, 1])
    offsets = draws.integers(0, round(cycle_s), len(SIGNALS)).astype(float).tolist()
    if scenario is TrafficScenario.RED_LIGHT_QUEUE:
        # They close some seconds before the leader would arrive, and stay closed for long.
        offsets[0] = 130.0
    return tuple(offsets)


def write_demand(
    scenario: TrafficScenario,
    settings: DemandSettings,
    duration_s: float,
    gap_m: float,
    step_s: float,
    folder: Path,
    *,
    with_stand_in: bool,
) -> Path:
    """Write all vehicles and return the file.

    Args:
        scenario: what the leader does.
        settings: how many there are.
        duration_s: length of the trip.
        gap_m: from the ego vehicle to its leader at the start.
        step_s: SUMO's step; the cars that stand at trip time 0 are put in by the one that ends then.
        folder: for the file.
        with_stand_in: put a car that SUMO drives where the ego vehicle would be.
    """
    draws = np.random.default_rng([settings.traffic_seed, 2])
    end_s = BEFORE_TRIP_S + duration_s
    standing_s = BEFORE_TRIP_S - step_s
    trips = [_leader(scenario, standing_s, gap_m)]
    if scenario is TrafficScenario.RED_LIGHT_QUEUE:
        trips += [_queued(number, standing_s, gap_m) for number in range(1, 6)]
    if with_stand_in:
        trips.append((standing_s, EGO, MAIN_EDGES, 1.0, _standing(0.0)))
    for number, time_s in enumerate(_instants(draws, settings.main_headway_s, end_s)):
        edges, factor = MAIN_EDGES, _factor(draws)
        if draws.random() < settings.turning_share:
            last = int(draws.integers(1, BLOCKS))
            edges = (*edges[:last], f"south_out_{last}")
        if not _QUIET_S[0] < time_s - BEFORE_TRIP_S < _QUIET_S[1]:
            trips.append((time_s, f"{MAIN_PREFIX}_{number}", edges, factor, _MOVING))
    for name, edges, headway_s in _other_ways(settings):
        trips += [
            (time_s, f"{name}_{number}", edges, _factor(draws), _MOVING)
            for number, time_s in enumerate(_instants(draws, headway_s, end_s))
        ]
    return _written(trips, folder)


def _instants(draws: np.random.Generator, headway_s: float, end_s: float) -> list[float]:
    """Return when cars enter: random instants some mean time apart, and never too close."""
    mean_s = max(headway_s - _SHORTEST_HEADWAY_S, 0.1)
    found: list[float] = []
    time_s = 0.0
    while (time_s := time_s + _SHORTEST_HEADWAY_S + draws.exponential(mean_s)) < end_s:
        found.append(time_s)
    return found


def _factor(draws: np.random.Generator) -> float:
    """Return how fast a driver likes to go, in speed limits."""
    return float(np.clip(draws.normal(1.0, 0.08), 0.85, 1.15))


def _other_ways(
    settings: DemandSettings,
) -> Iterator[tuple[str, tuple[str, ...], float]]:
    """Yield name, edges and mean headway of the other ways through the corridor."""
    yield "oncoming", ONCOMING_EDGES, settings.oncoming_headway_s
    for number in range(1, BLOCKS):
        for arm, opposite in (("north", "south"), ("south", "north")):
            across = (f"{arm}_in_{number}", f"{opposite}_out_{number}")
            yield f"cross_{arm}_{number}", across, settings.cross_headway_s
        joining = (f"south_in_{number}", *MAIN_EDGES[number:])
        yield f"{MAIN_PREFIX}_joining_{number}", joining, 3.0 * settings.cross_headway_s


_MOVING = {"departSpeed": "max", "departLane": "best"}


def _standing(position_m: float) -> dict[str, str]:
    """Return how a car is put into the ego's lane at its front's distance ahead of the ego vehicle's."""
    place = f"{EGO_START_M + position_m:g}"
    return {"departLane": str(EGO_LANE), "departPos": place, "departSpeed": "0"}


def _leader(scenario: TrafficScenario, depart_s: float, gap_m: float) -> _Trip:
    edges = MAIN_EDGES
    if scenario is TrafficScenario.TURN_OFF:
        edges = (*edges[:2], "south_out_2")
    return (depart_s, LEADER, edges, 1.0, _standing(gap_m + VEHICLE_LENGTH_M))


def _queued(number: int, depart_s: float, gap_m: float) -> _Trip:
    ahead_m = gap_m + VEHICLE_LENGTH_M + number * (VEHICLE_LENGTH_M + gap_m)
    name = f"{MAIN_PREFIX}_queued_{number}"
    return (depart_s, name, MAIN_EDGES, 1.0, _standing(ahead_m))


def ego_kind() -> ET.Element:
    """Return the ego vehicle's type of vehicle."""
    return ET.Element("vType", {"id": EGO_KIND, **_CAR, **_EGO})


def _written(trips: list[_Trip], folder: Path) -> Path:
    root = ET.Element("routes")
    ET.SubElement(root, "vType", {"id": CAR, **_CAR})
    root.append(ego_kind())
    for depart_s, name, edges, factor, start in sorted(trips, key=lambda trip: trip[:2]):
        kind = EGO_KIND if name == EGO else CAR
        vehicle = ET.SubElement(root, "vehicle", {"id": name, "type": kind, **start})
        vehicle.set("depart", f"{depart_s:.2f}")
        vehicle.set("speedFactor", f"{factor:.4f}")
        ET.SubElement(vehicle, "route", edges=" ".join(edges))
    ET.indent(root)
    file = folder / "demand.rou.xml"
    ET.ElementTree(root).write(file, encoding="unicode")
    return file
