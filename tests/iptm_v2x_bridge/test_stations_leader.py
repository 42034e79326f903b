"""Which of the stations leads."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import ROAD, station

from iptm_core.routes.road_line import RoadLine, step_deg
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.stations.plausibility import Heard
from iptm_v2x_bridge.stations.station import Station
from iptm_v2x_bridge.stations.table import LeaderSelector

EGO_M = 50.0


class Traffic:
    """Cars at 20 m/s around an ego vehicle at 50 m, heard at 10 Hz; each keeps its distance."""

    def __init__(self) -> None:
        self.stations: dict[int, Station] = {}
        self.selector = LeaderSelector()
        self.time_ms = 0

    def hear(self, cars: dict[int, tuple[float, float]], heading_deg: float = 0.0) -> int | None:
        """Take one message of each car (rear end, left of the middle); return the leader."""
        self.time_ms += 100
        for identity, (rear_m, left_m) in cars.items():
            message = station(identity, self.time_ms, rear_m, 0.0, left_m, heading_deg=heading_deg)
            known = self.stations.get(identity)
            self.stations[identity] = taken(known, message, self.time_ms, ROAD, None)
        self.selector.select(self.stations.values(), EGO_M, self.time_ms / 1000.0)
        return self.selector.leader_id


def taken(
    known: Station | None, message: CamMessage, at_ms: int, road: RoadLine, near_m: float | None
) -> Station:
    """Take a message of a station, the first one or another."""
    if known is None:
        return Station(Heard(message, at_ms), road, near_m)
    known.update(Heard(message, at_ms))
    return known


def test_the_nearest_car_ahead_in_the_lane_leads() -> None:
    traffic = Traffic()
    cars = {1: (120.0, 0.0), 2: (80.0, 0.3), 3: (60.0, 3.5), 4: (30.0, 0.0), 5: (70.0, -3.5)}
    for _ in range(5):
        leader = traffic.hear(cars)
    assert leader == 2
    assert traffic.selector.changes == 1


def test_oncoming_traffic_leads_no_one() -> None:
    traffic = Traffic()
    for _ in range(5):
        leader = traffic.hear({1: (80.0, 0.0)}, heading_deg=180.0)
    assert leader is None


def test_a_cut_in_and_a_turn_off_change_the_leader_once_each() -> None:
    traffic = Traffic()
    leaders = []
    for number in range(60):
        # Car 2 moves in within two seconds, stays, and leaves again.
        left_m = max(3.5 - 0.175 * number, 0.0) + max(0.0, 0.175 * (number - 40))
        leaders.append(traffic.hear({1: (120.0, 0.0), 2: (80.0, left_m)}))
    assert leaders[0] == leaders[4] == 1
    assert leaders[8] == leaders[45] == 2
    assert leaders[-1] == 1
    assert traffic.selector.changes == 3


@pytest.mark.parametrize("lateral_m_s", [0.7, 1.0, 1.5])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_cut_in_is_noticed_when_the_edge_is_over_the_line(
    lateral_m_s: float, side: float
) -> None:
    """The line is 1.75 m away, and a car of 1.8 m reaches over it when its middle is 2.65 m away."""
    traffic, moved_s = Traffic(), 0.0
    for number in range(60):
        moved_s = max(0.1 * (number - 10), 0.0)
        left_m = side * max(3.5 - lateral_m_s * moved_s, 0.0)
        if traffic.hear({1: (120.0, 0.0), 2: (80.0, left_m)}) == 2:
            break
    assert 0.0 < moved_s - (3.5 - 2.65) / lateral_m_s < 0.35
    assert traffic.selector.changes == 2


def test_a_car_that_weaves_in_the_next_lane_does_not_cut_in() -> None:
    traffic = Traffic()
    for number in range(300):
        left_m = 2.9 + 0.35 * math.sin(2.0 * math.pi * number / 30.0)
        leader = traffic.hear({1: (120.0, 0.0), 2: (80.0, left_m)})
    assert leader == 1
    assert traffic.selector.changes == 1


def test_a_car_that_begins_to_cut_in_and_returns_leads_for_a_moment_only() -> None:
    traffic = Traffic()
    leaders = []
    for number in range(60):
        left_m = 3.5 - max(0.0, 1.2 - abs(0.1 * (number - 20)))
        leaders.append(traffic.hear({1: (120.0, 0.0), 2: (80.0, left_m)}))
    assert leaders.count(2) <= 8
    assert leaders[-1] == 1


def test_noise_of_the_position_changes_nothing() -> None:
    """A car on the edge of the lane: 1.6 m aside, with a noise of 0.6 m."""
    traffic = Traffic()
    for number in range(100):
        traffic.hear({1: (120.0, 0.0), 2: (80.0, 1.6 + (0.6 if number % 2 else -0.6))})
    assert traffic.selector.changes <= 2


def test_a_late_message_of_a_fast_leader_does_not_put_it_behind() -> None:
    """Two seconds old at 30 m/s: the ego vehicle is already where the leader was then."""
    known = Station(Heard(station(1, 0, 40.0, 30.0), 0), ROAD)
    known.update(Heard(station(1, 1000, 70.0, 30.0), 1000))
    selector = LeaderSelector()
    assert selector.select([known], 100.0, 3.0) is known
    assert selector.select([known], 100.0, 1.0) is None


def test_a_ghost_inside_the_leader_is_no_car() -> None:
    traffic = Traffic()
    for _ in range(5):
        traffic.hear({1: (80.0, 0.0)})
    for _ in range(5):
        leader = traffic.hear({1: (80.0, 0.0), 2: (78.0, 0.0)})
    assert leader == 1


@pytest.mark.parametrize("length_m", [4.5, 16.5])
def test_the_leader_ends_where_its_length_says(length_m: float) -> None:
    """The reference position is the middle of the front."""
    known = Station(Heard(station(1, 0, 80.0, 0.0, length_m=length_m), 0), ROAD)
    assert known.last.position_m == pytest.approx(84.5 - length_m, abs=0.02)


@pytest.mark.parametrize(("station_type", "longest_m"), [(5, 4.5), (8, 18.75), (11, 75.0)])
def test_a_vehicle_without_length_is_as_long_as_its_kind_may_be(
    station_type: int, longest_m: float
) -> None:
    """A truck is not published as far away as a car, and leads also where it would overlap the ego."""
    message = station(1, 0, 80.0, 0.0, length_m=None, station_type=station_type)
    known = Station(Heard(message, 0), ROAD)
    assert known.last.position_m == pytest.approx(84.5 - longest_m, abs=0.02)
    assert LeaderSelector().select([known], 70.0, 0.0) is known
    assert LeaderSelector().select([known], 90.0, 0.0) is None


def test_a_truck_without_length_does_not_hide_the_car_behind_it() -> None:
    """The truck has been known for longer; were it the longest, the car would be inside of it."""
    truck = Station(Heard(station(1, 0, 90.0, 0.0, length_m=None, station_type=8), 0), ROAD)
    car = Station(Heard(station(2, 100, 74.0, 0.0), 100), ROAD)
    assert LeaderSelector().select([truck, car], EGO_M, 0.1) is car


def stopping(headings_deg: list[float | None]) -> Station:
    """A car that drives at 10 m/s, then stands and sends these headings."""
    known = Station(Heard(station(1, 0, 80.0, 10.0), 0), ROAD)
    for number, heading_deg in enumerate(headings_deg, start=1):
        message = station(1, 1000 * number, 88.0, 0.0, heading_deg=heading_deg)
        known.update(Heard(message, 1000 * number))
    return known


@pytest.mark.parametrize("heading_deg", [90.0, 180.0, None])
def test_a_car_that_stands_keeps_its_heading(heading_deg: float | None) -> None:
    """The course of a receiver that does not move is noise, or unavailable."""
    assert LeaderSelector().select([stopping([0.0, heading_deg])], 70.0, 2.0) is not None


def test_a_car_that_reverses_slowly_towards_the_ego_leads_on() -> None:
    """Its heading is that of the movement in EN 302 637-2."""
    known = stopping([0.0])
    known.update(Heard(station(1, 2000, 87.0, 1.0, heading_deg=180.0), 2000))
    assert LeaderSelector().select([known], 70.0, 2.0) is known


def test_a_car_that_was_never_heard_driving_stands_in_the_way_without_a_heading() -> None:
    known = Station(Heard(station(1, 0, 80.0, 0.0, heading_deg=None), 0), ROAD)
    assert LeaderSelector().select([known], 70.0, 0.0) is known


@pytest.mark.parametrize(
    ("left_m", "accuracy_m", "leads"),
    [
        (1.6, 0.0, False),
        (1.6, 2.82, True),
        (2.3, 2.82, True),
        (3.5, 2.82, False),
        (3.5, 16.4, False),
    ],
)
def test_the_stated_accuracy_widens_the_lane(left_m: float, accuracy_m: float, leads: bool) -> None:
    selector, followed = LeaderSelector(), None
    for tick in range(10):
        message = station(1, 100 * tick, 80.0, 0.0, left_m, position_bound_m=accuracy_m)
        followed = taken(followed, message, 100 * tick, ROAD, None)
    assert followed is not None
    assert (selector.select([followed], EGO_M, 0.9) is followed) == leads


def test_a_leader_is_kept_through_a_short_error_of_its_position() -> None:
    traffic = Traffic()
    for left_m in (0.0,) * 5 + (2.8,) * 4 + (0.0,):
        leader = traffic.hear({1: (80.0, left_m)})
    assert (leader, traffic.selector.changes) == (1, 1)


def spiral(turns: int = 3, radius_m: float = 13.0, floor_m: float = 2.7) -> RoadLine:
    """Return a ramp of a car park, whose turns lie above each other; it is 81.7 m long per turn."""
    angles = np.linspace(0.0, 2.0 * np.pi * turns, 72 * turns + 1)
    latitudes, longitudes = step_deg(
        48.0, 10.0, radius_m * np.sin(angles), radius_m * np.cos(angles)
    )
    return RoadLine(latitudes, longitudes, 450.0 + floor_m * angles / (2.0 * np.pi))


def car_at(road: RoadLine, along_m: float, time_ms: int, **more: Any) -> CamMessage:
    latitude, longitude, heading = (float(value) for value in road.locate(along_m))
    place = {"latitude_deg": latitude, "longitude_deg": longitude, "heading_deg": heading}
    return replace(station(7, time_ms, 0.0, 3.0), **place, **more)


@pytest.mark.parametrize(
    ("above_m", "bound_m", "leads"),
    [
        (0.0, 0.5, True),
        (2.0, 0.5, True),
        (2.7, 0.5, False),
        (-5.4, 1.0, False),
        (5.4, 5.0, True),
        (5.4, None, True),
        (None, 0.5, True),
    ],
)
def test_a_car_on_another_level_does_not_lead(
    above_m: float | None, bound_m: float | None, leads: bool
) -> None:
    """On the ramp one turn above or below the ego, or on a bridge: by its place alone it would lead."""
    road = spiral()
    selector = LeaderSelector()
    found: Station | None = None
    for number in range(6):
        along_m = 100.0 + 0.3 * number
        height_m = road.height_at_m(along_m)
        assert height_m is not None
        altitude_m = None if above_m is None else height_m + above_m
        altitude = {"altitude_m": altitude_m, "altitude_bound_m": bound_m}
        message = car_at(road, along_m, 100 * number, **altitude)
        found = taken(found, message, 100 * number, road, 90.0)
    assert found is not None
    leader = selector.select([found], 85.0, 0.5)
    assert (leader is found) == leads


def test_a_road_without_heights_excludes_nobody() -> None:
    road = replace(spiral(), heights_m=None)
    message = car_at(road, 100.0, 0, altitude_m=9000.0, altitude_bound_m=0.01)
    assert not Station(Heard(message, 0), road, 90.0).is_on_another_level


def test_a_leader_is_kept_on_all_turns_of_a_ramp() -> None:
    """A constant error of the receiver of 1 m, and altitudes without a stated error."""
    road, found = spiral(), None
    selector = LeaderSelector()
    for number in range(600):
        along_m = 20.0 + 0.3 * number
        message = car_at(road, along_m, 100 * number)
        message = replace(message, longitude_deg=message.longitude_deg + 1.3e-5)
        found = taken(found, message, 100 * number, road, along_m - 15.0)
        assert found.fix.position_m == pytest.approx(along_m, abs=2.5)
        if number > 5:
            assert selector.select([found], along_m - 15.0, 0.1 * number) is found
