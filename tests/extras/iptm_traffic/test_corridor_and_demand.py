"""The corridor and its traffic as data; SUMO is not needed."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from iptm_core.errors import ScenarioError
from iptm_core.routes.road_line import east_north_m, step_deg
from iptm_core.state import FloatArray
from iptm_traffic.demand import (
    BEFORE_TRIP_S,
    EGO,
    LEADER,
    DemandSettings,
    TrafficScenario,
    signal_offsets_s,
    write_demand,
)
from iptm_traffic.ego_road import EgoRoad
from iptm_traffic.network import (
    BLOCK_M,
    BLOCKS,
    CORRIDOR,
    EGO_START_M,
    LIMITS_KM_H,
    MAIN_EDGES,
    ONCOMING_EDGES,
    SIGNALS,
)
from iptm_traffic.trip import TrafficDrive


def vehicles(folder: Path, scenario: TrafficScenario, seed: int = 1) -> dict[str, ET.Element]:
    folder.mkdir(exist_ok=True)
    file = write_demand(
        scenario,
        DemandSettings(traffic_seed=seed),
        120.0,
        15.0,
        0.5,
        folder,
        with_stand_in=scenario is TrafficScenario.FOLLOWING,
    )
    root = ET.parse(file).getroot()  # noqa: S314  written just now
    return {entry.get("id", ""): entry for entry in root.iter("vehicle")}


def edges_of(vehicle: ET.Element) -> list[str]:
    route = vehicle.find("route")
    assert route is not None
    return route.get("edges", "").split()


def test_the_corridor_is_that_of_its_files() -> None:
    nodes, edges = (
        ET.parse(CORRIDOR / f"corridor.{part}.xml").getroot()  # noqa: S314  our own
        for part in ("nod", "edg")
    )
    signals = [node for node in nodes if node.get("type") == "traffic_light"]
    assert [node.get("id") for node in signals] == list(SIGNALS)
    assert [float(node.get("x", "0")) for node in signals] == [
        BLOCK_M * number for number in range(1, BLOCKS)
    ]
    heights = [float(node.get("z", "0")) for node in signals]
    assert max(heights) - min(heights) > 5.0
    limits = {edge.get("id"): 3.6 * float(edge.get("speed", "0")) for edge in edges}
    expected = np.resize(LIMITS_KM_H, BLOCKS)
    assert [limits[name] for name in MAIN_EDGES] == pytest.approx(expected.tolist(), abs=1e-4)
    assert [limits[name] for name in ONCOMING_EDGES[::-1]] == pytest.approx(expected, abs=1e-4)


def test_a_trip_beyond_the_corridor_is_refused() -> None:
    with pytest.raises(ScenarioError, match="on the corridor; allowed: 634 s at most"):
        TrafficDrive(duration_s=700.0)


def test_a_seed_means_one_traffic(tmp_path: Path) -> None:
    same, again, other = (
        {name: ET.tostring(vehicle) for name, vehicle in found.items()}
        for found in (
            vehicles(tmp_path / "a", TrafficScenario.CUT_IN),
            vehicles(tmp_path / "b", TrafficScenario.CUT_IN),
            vehicles(tmp_path / "c", TrafficScenario.CUT_IN, seed=2),
        )
    )
    assert same == again != other
    offsets = [
        signal_offsets_s(TrafficScenario.CUT_IN, DemandSettings(traffic_seed=seed), 80.0)
        for seed in (1, 1, 2)
    ]
    assert offsets[0] == offsets[1] != offsets[2]


def test_the_scenarios_differ_in_the_leader_and_what_is_ahead_of_it(tmp_path: Path) -> None:
    following = vehicles(tmp_path, TrafficScenario.FOLLOWING)
    assert len(edges_of(following[LEADER])) == BLOCKS
    assert EGO in following  # its stand-in
    front_m = float(following[LEADER].get("departPos", "0"))
    assert front_m - 4.5 - EGO_START_M == pytest.approx(15.0)
    turning = vehicles(tmp_path, TrafficScenario.TURN_OFF)
    assert EGO not in turning
    assert edges_of(turning[LEADER])[-1] == "south_out_2"
    queue = vehicles(tmp_path, TrafficScenario.RED_LIGHT_QUEUE)
    assert sum("queued" in name for name in queue) == 5
    # No vehicle drives through the standing ego vehicle from behind.
    behind = [
        float(entry.get("depart", "0")) - BEFORE_TRIP_S
        for name, entry in queue.items()
        if edges_of(entry)[0] == "main_0" and name != LEADER and "queued" not in name
    ]
    assert behind
    assert not [time_s for time_s in behind if -10.0 < time_s < 0.0]


def test_points_are_seen_from_the_road_as_by_hand() -> None:
    # 100 m east, then 50 m north, with stated lengths of 110 m and 55 m.
    road = EgoRoad(
        np.array([0.0, 100.0, 100.0]),
        np.array([0.0, 0.0, 50.0]),
        np.zeros(3),
        np.array([0.0, 110.0, 165.0]),
        {},
        (),
    )
    along, aside = road.along_and_aside_m(
        np.array([50.0, 97.0, -10.0, 103.0]), np.array([2.0, 20.0, 0.0, 60.0])
    )
    np.testing.assert_allclose(along, [55.0, 132.0, -11.0, 176.0])
    np.testing.assert_allclose(aside, [2.0, 3.0, 0.0, -3.0], atol=1e-12)
    line = road.road_line()
    np.testing.assert_allclose(line.positions_m, road.positions_m, atol=1e-8)


def test_steps_on_earth_are_the_inverse_of_distances() -> None:
    draws = np.random.default_rng(1)
    east: FloatArray = draws.uniform(-2000.0, 2000.0, 50)
    north: FloatArray = draws.uniform(-2000.0, 2000.0, 50)
    latitude, longitude = step_deg(np.full(50, 48.0), np.full(50, 10.0), east, north)
    back = east_north_m(latitude, longitude, (48.0, 10.0))
    np.testing.assert_allclose(back, (east, north), atol=1e-6)
