"""Recorded drives: GPX and CSV with places become a leader, its road and its slope."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.routes import build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.track import MAX_RECORDED_GRADE
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.state import FloatArray

EXAMPLE = Path(__file__).resolve().parents[3] / "docs" / "examples" / "phone_drive.gpx"
ROAD = RoadLine.test_road()
SECONDS = np.arange(0.0, 121.0)
SPEEDS = np.interp(SECONDS, [0, 10, 30, 80, 100, 120], [0, 0, 15, 15, 0, 0])
PLACES = np.concatenate([[0.0], np.cumsum(0.5 * (SPEEDS[1:] + SPEEDS[:-1]))])


def gpx(
    places_m: FloatArray,
    heights_m: FloatArray | None = None,
    seconds: FloatArray = SECONDS,
    inside: str = "",
    head: str = "",
) -> str:
    latitudes, longitudes, _ = ROAD.locate(places_m)
    rows = []
    for index, second in enumerate(seconds.tolist()):
        height = "" if heights_m is None else f"<ele>{heights_m[index]}</ele>"
        moment = f"2026-05-04T07:{int(second) // 60:02d}:{second % 60:06.3f}Z"
        rows.append(
            f'<trkpt lat="{latitudes[index]}" lon="{longitudes[index]}">{height}'
            f"<time>{moment}</time>{inside}</trkpt>"
        )
    body = "".join(rows)
    return (
        f'<?xml version="1.0"?>{head}<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1">'
        f"<trk><trkseg>{body}</trkseg></trk></gpx>"
    )


def with_speeds(text: str) -> str:
    return text.replace("{}", "<speed>{}</speed>").format(*SPEEDS.tolist())


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def save(text: str, name: str = "drive.gpx") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return save


def test_a_track_becomes_the_drive_that_it_was(write: Callable[..., Path]) -> None:
    heights = 500.0 + 0.03 * PLACES
    trip = read_user_trip(write(gpx(PLACES, heights)))
    assert np.abs(trip.cycle.speeds_m_s - SPEEDS).max() < 1.0
    assert trip.cycle.distance_m == pytest.approx(PLACES[-1], rel=0.01)
    inside = np.arange(100.0, 900.0, 50.0)
    np.testing.assert_allclose(np.tan(trip.slope.slope_at(inside)), 0.03, atol=1e-3)
    fix = trip.line.project(*(float(value) for value in ROAD.locate(500.0)[:2]))
    assert fix.position_m == pytest.approx(500.0, abs=5.0)
    assert abs(fix.lateral_m) < 0.5


def test_noise_makes_no_hills_and_no_crawling(write: Callable[..., Path]) -> None:
    """Level road; 3 m of noise in height and 0.4 m in place, second by second."""
    source = np.random.default_rng(7)
    noisy = PLACES + 0.4 * source.standard_normal(PLACES.size)
    heights = 500.0 + 3.0 * source.standard_normal(PLACES.size)
    trip = read_user_trip(write(gpx(noisy, heights)))
    assert np.abs(np.tan(trip.slope.slopes_rad)).max() < 0.04
    standing = trip.cycle.speeds_m_s[SECONDS < 5.0]
    assert standing.max() == 0.0
    assert np.abs(trip.cycle.speeds_m_s - SPEEDS).max() < 1.2
    # Differentiated from point to point, the same heights would be walls.
    moving = np.diff(PLACES) > 1.0
    assert np.abs(np.diff(heights)[moving] / np.diff(PLACES)[moving]).max() > 0.3


def test_the_grade_is_bounded_and_the_raw_data_are_kept(write: Callable[..., Path]) -> None:
    heights = 500.0 + np.where(PLACES > 450.0, 80.0, 0.0)
    trip = read_user_trip(write(gpx(PLACES, heights)))
    assert np.tan(trip.slope.slopes_rad).max() == pytest.approx(MAX_RECORDED_GRADE)
    assert 100.0 < trip.drive.bounded_m < 400.0
    np.testing.assert_array_equal(trip.drive.raw.columns["elevation_m"], heights)


def test_the_receivers_own_speed_is_preferred(write: Callable[..., Path]) -> None:
    trip = read_user_trip(write(with_speeds(gpx(PLACES, inside="<extensions>{}</extensions>"))))
    np.testing.assert_allclose(trip.cycle.speeds_m_s, SPEEDS, atol=1e-9)


def test_a_track_every_few_seconds_is_read_too(write: Callable[..., Path]) -> None:
    trip = read_user_trip(write(gpx(PLACES[::7], None, SECONDS[::7])))
    assert trip.cycle.distance_m == pytest.approx(PLACES[-1], rel=0.05)
    assert trip.slope is None


def test_a_track_that_begins_at_speed_gets_a_launch_in_front(write: Callable[..., Path]) -> None:
    file = write(gpx(PLACES[40:], None, SECONDS[40:]))
    trip = read_user_trip(file)
    assert trip.cycle.speeds_m_s[0] == 0.0
    # The launch of 10 s to 15 m/s covers 75 m in front of the first recorded point.
    first = trip.line.project(*(float(value) for value in ROAD.locate(PLACES[40])[:2]))
    assert first.position_m == pytest.approx(75.0, abs=3.0)
    assert build_route(file, initial_gap_m=15.0).road_line is not None


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: text.replace('lat="48.0', 'lat="x', 40), "lat is 'x"),
        (lambda text: text.replace('lat="48.00', 'lat="49.00', 40), "m/s from the point before"),
        (lambda text: text.replace("T07:01", "yesterday"), "ISO 8601"),
    ],
)
def test_files_that_are_no_drives_are_refused(
    write: Callable[..., Path], change: Callable[[str], str], reason: str
) -> None:
    file = write(change(gpx(PLACES)))
    with pytest.raises(RouteError, match=reason) as refusal:
        build_route(file, initial_gap_m=15.0)
    assert "drive.gpx" in str(refusal.value)


def test_entities_are_refused_before_they_are_read(write: Callable[..., Path]) -> None:
    head = '<!DOCTYPE gpx [<!ENTITY x SYSTEM "file:///etc/hostname">]>'
    with pytest.raises(RouteError, match="document type 'gpx'"):
        read_user_trip(write(gpx(PLACES, head=head)))


def test_a_drive_that_stands_still_is_no_trip(write: Callable[..., Path]) -> None:
    with pytest.raises(RouteError, match="it covers 0"):
        read_user_trip(write(gpx(np.zeros(121))))


def test_the_example_is_the_cycle_that_it_was_made_from() -> None:
    """With a phone's errors the speed is reconstructed within one or two kilometres per hour."""
    trip = read_user_trip(EXAMPLE)
    made_from = build_route("sc03", initial_gap_m=15.0)
    truth = made_from.leader.speeds_at(trip.cycle.times_s)
    assert np.sqrt(np.mean((trip.cycle.speeds_m_s - truth) ** 2)) < 0.6
    assert trip.cycle.distance_m == pytest.approx(made_from.leader.positions_m[-1] - 15.0, rel=0.01)


def test_a_track_that_is_too_long_is_refused_while_it_is_read(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("iptm_drives.xml_drives.MAX_POINTS", 20)
    with pytest.raises(RouteError, match=r"drive.gpx: more than 20 track points"):
        read_user_trip(write(gpx(PLACES)))


def test_a_refusal_shows_a_part_of_a_long_text(write: Callable[..., Path]) -> None:
    text = gpx(PLACES[:3], seconds=SECONDS[:3]).replace("<time>", "<time>" + "9" * 100_000, 1)
    with pytest.raises(RouteError, match="track point 1: time is '999") as refusal:
        read_user_trip(write(text))
    assert len(str(refusal.value)) < 500


def paused(after_s: float, lasts_s: float) -> FloatArray:
    return np.where(after_s < SECONDS, SECONDS + lasts_s, SECONDS)


def test_a_gap_in_which_the_car_drove_on_is_refused(write: Callable[..., Path]) -> None:
    far = np.where(SECONDS > 50.0, PLACES + 500.0, PLACES)
    with pytest.raises(RouteError, match="a pause at one place"):
        read_user_trip(write(gpx(far, seconds=paused(50.0, 600.0))))


def test_of_points_with_one_time_the_first_counts(write: Callable[..., Path]) -> None:
    whole = gpx(PLACES)
    points = whole.split("</trkpt>")
    for index in (20, 60, 90):  # a new lap begins with the last point of the one before
        points[index] += "</trkpt></trkseg><trkseg>" + points[index].split("<trkseg>")[-1]
    again = read_user_trip(write("</trkpt>".join(points), "laps.gpx"))
    np.testing.assert_array_equal(
        again.cycle.speeds_m_s, read_user_trip(write(whole)).cycle.speeds_m_s
    )


@pytest.mark.parametrize("kind", ["trk", "rte"])
def test_a_plan_without_times_is_a_road_for_a_cycle(write: Callable[..., Path], kind: str) -> None:
    places = np.linspace(0.0, 15_000.0, 400)
    text = gpx(places, 300.0 + 0.02 * places, seconds=np.arange(400.0))
    text = re.sub("<time>.*?</time>", "", text)
    if kind == "rte":
        text = text.replace("trkpt", "rtept").replace("<trk><trkseg>", "<rte>")
        text = text.replace("</trkseg></trk>", "</rte>")
    file = write(text)
    with pytest.raises(RouteError, match="it is a road and no drive; allowed: as slope"):
        build_route(file, initial_gap_m=15.0)
    route = build_route("us06", str(file), initial_gap_m=15.0)
    assert (
        route.leader.positions_m[-1]
        == build_route("us06", initial_gap_m=15.0).leader.positions_m[-1]
    )
    assert route.slope.slope_at(5000.0) == pytest.approx(np.arctan(0.02), rel=0.005)
    latitude, longitude, _ = route.road_line.locate(7000.0)
    expected = ROAD.locate(7000.0)
    assert float(latitude) == pytest.approx(float(expected[0]), abs=1e-6)
    assert float(longitude) == pytest.approx(float(expected[1]), abs=1e-6)
    with pytest.raises(RouteError, match="a road of 15000 m"):
        build_route("wltc_class3b", str(file), initial_gap_m=15.0)


@pytest.mark.parametrize("times", [True, False])
def test_the_road_has_the_heights_of_the_track(write: Callable[..., Path], times: bool) -> None:
    """With the noise of a receiver, read at the places of the road, and where the car stands."""
    heights = 500.0 + 0.03 * PLACES + np.random.default_rng(2).normal(0.0, 1.0, PLACES.size)
    text = gpx(PLACES, heights)
    route_file = write(text if times else re.sub("<time>.*?</time>", "", text))
    cycle = write("time_s,speed_m_s\n0,0\n10,10\n50,10\n60,0\n", "short.csv")
    line = build_route(cycle, str(route_file), initial_gap_m=15.0).road_line
    for place_m in (100.0, 400.0, 900.0):
        assert line.height_at_m(place_m) == pytest.approx(500.0 + 0.03 * place_m, abs=1.0)
    longer = line.extended_backwards(50.0)
    assert longer.height_at_m(450.0) == pytest.approx(line.height_at_m(400.0))
    assert longer.height_at_m(0.0) == pytest.approx(line.height_at_m(0.0))
    assert RoadLine.test_road().height_at_m(100.0) is None
