"""Drives in files of other programs: floating car data of SUMO, and bags."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from tests.extras.iptm_drives.field_drives import ODOMETRY, STORE, message

from iptm_core.errors import RouteError
from iptm_core.routes import build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.user_csv import read_user_trip
from iptm_drives.bag import OWN_ODOMETRY, OWN_SLOPE
from iptm_ros.codecs import decode_slope
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.trajectory_reader import read_trajectory
from iptm_ros.topics import TOPICS, Topic

ROAD = RoadLine.test_road()
SECONDS = np.arange(0.0, 61.0, 0.5)
SPEEDS = np.interp(SECONDS, [0, 10, 50, 60], [0, 15, 15, 0])
PLACES = np.concatenate([[0.0], np.cumsum(0.25 * (SPEEDS[1:] + SPEEDS[:-1]))])
DEGREES = 2.0


def fcd(head: str = "", *, in_degrees: bool = False) -> str:
    """Return the drive of "leader" 100 s into a simulation, between others, on a steady climb."""
    latitudes, longitudes, _ = ROAD.locate(PLACES)
    east, north = (longitudes, latitudes) if in_degrees else (np.full(PLACES.size, 7.0), PLACES)
    rows = []
    for index, second in enumerate(SECONDS.tolist()):
        height = 500.0 + float(np.sin(np.radians(DEGREES))) * PLACES[index]
        rows.append(
            f'<timestep time="{100.0 + second:.2f}"><vehicle id="other" x="0" y="0" speed="0"/>'
            f'<vehicle id="leader" x="{east[index]}" y="{north[index]}" z="{height}" angle="0.0" '
            f'speed="{SPEEDS[index]}" pos="0" lane="a_0" slope="{DEGREES}"/><person id="p" x="0"/></timestep>'
        )
    return f'<?xml version="1.0"?>{head}<fcd-export>{"".join(rows)}</fcd-export>'


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def save(text: str) -> Path:
        path = tmp_path / "traffic.fcd.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return save


def test_a_vehicle_becomes_the_leader_on_its_slope(write: Callable[[str], Path]) -> None:
    route = build_route(f"{write(fcd())}#leader", initial_gap_m=15.0)
    whole = slice(None, None, 2)
    np.testing.assert_allclose(route.leader.speeds_at(SECONDS[whole]), SPEEDS[whole], atol=1e-9)
    np.testing.assert_allclose(route.leader.positions_at(60.0), 15.0 + PLACES[-1], rtol=1e-3)
    np.testing.assert_allclose(np.degrees(route.slope.slope_at([0.0, 500.0])), DEGREES)
    np.testing.assert_array_equal(route.road_line.latitudes_deg, ROAD.latitudes_deg)


def test_places_in_degrees_are_its_road(write: Callable[[str], Path]) -> None:
    trip = read_user_trip(Path(f"{write(fcd(in_degrees=True))}#leader"))
    fix = trip.line.project(*(float(value) for value in ROAD.locate(300.0)[:2]))
    assert fix.position_m == pytest.approx(300.0, abs=2.0)
    assert abs(fix.lateral_m) < 0.1
    np.testing.assert_allclose(np.degrees(trip.slope.slope_at(400.0)), DEGREES, atol=0.05)


@pytest.mark.parametrize(
    ("vehicle", "change", "reason"),
    [
        ("", lambda text: text, "holds 2 vehicles; name one"),
        ("#ledaer", lambda text: text, "did you mean 'leader'"),
        ("#leader", lambda text: text[:-30], "cannot be read"),
        ("#leader", lambda _: "<fcd-export/>", "holds none"),
        ("#leader", lambda text: text.replace('speed="15.0"', 'speed="x"', 40), "speed is 'x'"),
        ("#leader", lambda text: text.replace('speed="15.0"', 'speed="60"', 40), "contradict"),
        ("#leader", lambda text: text.replace('="13', '="10'), "another recording begins"),
        ("#leader", lambda text: text.replace('slope="2.0"', 'slope="40"', 60), "slope_rad"),
    ],
)
def test_files_without_the_drive_are_refused(
    write: Callable[[str], Path], vehicle: str, change: Callable[[str], str], reason: str
) -> None:
    with pytest.raises(RouteError, match=reason) as refusal:
        build_route(f"{write(change(fcd()))}{vehicle}", initial_gap_m=15.0)
    assert "traffic.fcd.xml" in str(refusal.value)


BAG = Path(__file__).resolve().parents[3] / "bags" / "example_us06_120s"
Rows = Sequence[tuple[float, float, float]]
"""Stamp in s, position, speed."""
RAMP = [(float(k), 0.5 * k * k, float(k)) for k in range(11)]


def write_bag(folder: Path, topics: Mapping[str, Rows]) -> Path:
    """Write the odometry of some topics, as another program would."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, rows in topics.items():
            connection = writer.add_connection(topic, ODOMETRY, typestore=STORE)
            for index, (stamp_s, place_m, speed) in enumerate(rows):
                writer.write(connection, index, message(stamp_s, place_m, 0.0, speed))
    return folder


def test_the_car_of_a_recorded_run_becomes_the_leader_on_its_road() -> None:
    driven = read_trajectory(BAG)
    route = build_route(str(BAG), initial_gap_m=15.0)
    np.testing.assert_allclose(route.leader.speeds_at(driven.time_s), driven.speed_m_s, atol=1e-9)
    assert route.leader.positions_at(driven.time_s[-1]) - 15.0 == pytest.approx(
        driven.position_m[-1], rel=1e-3
    )
    with BagReader(BAG) as reader:
        (recorded_road,) = reader.messages([f"/{TOPICS[Topic.SLOPE].name}"])
    road = decode_slope(recorded_road.message)
    there = np.linspace(0.0, driven.position_m[-1], 200)
    recorded = np.interp(there, road.positions_m, road.slopes_rad)
    assert np.ptp(recorded) > 0.005
    np.testing.assert_allclose(route.slope.slope_at(there), recorded, atol=1e-3)


def test_its_topics_are_those_of_the_suite() -> None:
    """The core knows no table of topics, so it has these two names of its own."""
    own = TOPICS[Topic.PLANT_ODOMETRY].name, TOPICS[Topic.SLOPE].name
    assert own == (OWN_ODOMETRY, OWN_SLOPE)


def test_another_odometry_of_a_bag_is_named_behind_it() -> None:
    driven = read_trajectory(BAG)
    leader = build_route(f"{BAG}#v2x/leader", initial_gap_m=15.0).leader
    np.testing.assert_allclose(leader.speeds_at(driven.time_s), driven.leader_speed_m_s, atol=1e-9)


def test_the_only_odometry_of_a_bag_needs_no_name(tmp_path: Path) -> None:
    """Of another program: wall-clock stamps, no road. A single file will do."""
    late = [(1.79e9 + time_s, place, -speed) for time_s, place, speed in RAMP]
    bag = write_bag(tmp_path / "other", {"/robot/odom": late})
    for path in (bag, next(bag.glob("*.mcap"))):
        trip = read_user_trip(path)
        np.testing.assert_array_equal(trip.cycle.speeds_m_s, np.arange(11.0))
        assert trip.slope is None


def test_one_of_several_vehicles_is_named_behind_the_bag(tmp_path: Path) -> None:
    faster = [(time_s, 2.0 * place, 2.0 * speed) for time_s, place, speed in RAMP]
    bag = write_bag(
        tmp_path / "string", {"/car_1/plant/odometry": RAMP, "/car_2/plant/odometry": faster}
    )
    assert read_user_trip(Path(f"{bag}#car_2")).cycle.max_speed_m_s == 20.0
    for name in ("", "#car_3"):
        with pytest.raises(RouteError, match=r"#/car_1/plant/odometry, .*#/car_2/plant/odometry"):
            build_route(f"{bag}{name}", initial_gap_m=15.0)


def test_the_last_of_several_trips_counts_and_repeated_states_count_once(tmp_path: Path) -> None:
    first = [(float(k), 0.0, 0.0) for k in range(30)]
    bag = write_bag(tmp_path / "twice", {"/plant/odometry": [*first, *RAMP[:5], *RAMP[4:]]})
    np.testing.assert_array_equal(read_user_trip(bag).cycle.speeds_m_s, np.arange(11.0))


def test_a_speed_that_no_car_has_is_refused(tmp_path: Path) -> None:
    faster = [(11.0 + k, 50.0 + 60.0 * k, 60.0) for k in range(9)]
    leap = write_bag(tmp_path / "leap", {"/plant/odometry": [*RAMP, *faster]})
    with pytest.raises(RouteError, match="message 12, column speed_m_s: value 60"):
        build_route(leap, initial_gap_m=15.0)
