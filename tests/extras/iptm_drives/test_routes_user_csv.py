"""A user's CSV file: what is accepted, what is refused and how that is explained."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import SlopeProfile
from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.user_csv import read_user_trip
from iptm_drives.cleaning import clean
from iptm_drives.text_table import parse_text_table

Reader = Callable[..., tuple[DrivingCycle, SlopeProfile | None]]


@pytest.fixture
def read(tmp_path: Path) -> Reader:
    """Read a text as a trip."""

    def read_text(
        text: str | bytes, name: str = "trip.csv"
    ) -> tuple[DrivingCycle, SlopeProfile | None]:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        trip = read_user_trip(path)
        return trip.cycle, trip.slope

    return read_text


def _csv(header: str, *rows: str) -> str:
    return "\n".join([header, *rows]) + "\n"


def test_whole_seconds_are_kept_to_the_last_bit(read: Reader) -> None:
    cycle, road = read(_csv("time_s,speed_m_s", "0,0", "1,1.25", "2,0.1", "3,0"))
    assert cycle.name == "trip"
    assert cycle.source == "file trip.csv"
    np.testing.assert_array_equal(cycle.speeds_m_s, [0.0, 1.25, 0.1, 0.0])
    assert road is None


@pytest.mark.parametrize(
    ("column", "factor"), [("speed_m_s", 1.0), ("speed_kmh", 1 / 3.6), ("speed_mph", 0.44704)]
)
def test_speed_units(read: Reader, column: str, factor: float) -> None:
    cycle, _ = read(_csv(f"{column},time_s", "0,0", "10,5", "0,10"))
    assert cycle.max_speed_m_s == pytest.approx(10.0 * factor, rel=1e-15)


def test_byte_order_mark_crlf_comments_blank_lines_quotes_and_spaces(read: Reader) -> None:
    text = '# my trip\r\n\r\n time_s , "speed_m_s" \r\n0,0\r\n# lunch\r\n 1 , 1.5\r\n\r\n"2",0'
    cycle, _ = read(b"\xef\xbb\xbf" + text.encode())
    np.testing.assert_array_equal(cycle.speeds_m_s, [0.0, 1.5, 0.0])


def test_time_may_start_anywhere_and_rows_may_be_seconds_apart(read: Reader) -> None:
    cycle, _ = read(_csv("time_s,speed_m_s", "1700000000,0", "1700000010,20", "1700000070,20"))
    np.testing.assert_allclose(cycle.speeds_m_s[:12], [*np.arange(0.0, 21.0, 2.0), 20.0])
    assert cycle.duration_s == 70.0


@given(st.integers(0, 2**32 - 1))
def test_random_sampling_keeps_distance_and_standstill(seed: int) -> None:
    from iptm_core.routes.user_csv import _resample  # noqa: PLC0415

    rng = np.random.default_rng(seed)
    times = np.concatenate([[0.0, 5.0], 5.0 + np.cumsum(rng.uniform(0.3, 3.0, 60))])
    speeds = 12.0 + 8.0 * np.sin(times / 15.0)
    speeds[[0, 1, -1]] = 0.0
    seconds, sampled = _resample("test", times, speeds)
    distance = np.sum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))
    assert np.sum(0.5 * (sampled[1:] + sampled[:-1])) == pytest.approx(distance, rel=1e-12)
    assert np.all(sampled >= 0.0)
    np.testing.assert_array_equal(sampled[:6], 0.0)
    assert sampled[-1] == 0.0
    assert seconds[-1] == np.ceil(times[-1])


def test_trip_that_ends_at_speed_is_cut_at_a_whole_second(read: Reader) -> None:
    cycle, _ = read(_csv("time_s,speed_m_s", "0,0", "2,4", "5.5,4"))
    assert cycle.duration_s == 5.0
    assert cycle.speeds_m_s[-1] == pytest.approx(4.0)
    assert cycle.distance_m == pytest.approx(16.0)


def test_trip_that_starts_at_speed_gets_a_launch_ramp(read: Reader) -> None:
    cycle, road = read(
        _csv("time_s,speed_m_s,slope_rad", "0,15", "1,15", "5,15", "6,15", "10,15").replace(
            "15\n", "15,0.01\n"
        )
    )
    assert "after a launch of 10 s" in cycle.source
    np.testing.assert_allclose(cycle.speeds_m_s[:12], [*np.arange(0.0, 15.1, 1.5), 15.0])
    assert road.positions_m[0] == pytest.approx(75.0), "the file starts 75 m down the road"


def test_slope_in_percent_and_rad_agree(read: Reader) -> None:
    rows = list(enumerate(zip([0, 10, 20, 20, 20], [0.0, 1.0, -2.0, 3.0, 3.0], strict=True)))
    as_percent = (f"{k},{speed},{grade}" for k, (speed, grade) in rows)
    as_rad = (f"{k},{speed},{math.atan(grade / 100.0)!r}" for k, (speed, grade) in rows)
    _, percent = read(_csv("time_s,speed_m_s,slope_percent", *as_percent))
    _, rad = read(_csv("time_s,speed_m_s,slope_rad", *as_rad))
    np.testing.assert_allclose(percent.slopes_rad, rad.slopes_rad, rtol=1e-15)
    np.testing.assert_allclose(percent.slope_at(20.0), math.atan(-0.02))


def test_slope_at_standstill_is_averaged(read: Reader) -> None:
    rows = [f"{k},0,{1.0 + 0.1 * (-1) ** k}" for k in range(20)] + ["20,10,1", "25,10,1"]
    _, road = read(_csv("time_s,speed_m_s,slope_percent", *rows))
    np.testing.assert_allclose(road.positions_m, [0.0, 5.0, 55.0])
    np.testing.assert_allclose(np.tan(road.slopes_rad), 0.01, atol=1e-4)


def test_elevation_gives_the_climb(read: Reader) -> None:
    rows = [f"{k},{min(2 * k, 20)},{200 + 0.05 * max(0.0, 20 * (k - 5))}" for k in range(120)]
    cycle, road = read(_csv("time_s,speed_m_s,elevation_m", *rows))
    distance = cycle.distance_m
    np.testing.assert_allclose(road.slope_at([500.0, 1000.0, 2000.0]), np.arcsin(0.05), atol=1e-3)
    ahead = np.linspace(500.0, distance, 5000)
    climb = np.mean(np.sin(road.slope_at(ahead))) * (distance - 500.0)
    assert climb == pytest.approx(0.05 * (distance - 500.0), rel=1e-3)


GOOD = ("0,0", "1,1", "2,0")

BAD_FILES = [
    ("", "the file is empty; a header line"),
    ("time_s,speed_m_s\n", "no rows after the header"),
    (_csv("speed_m_s,slope_rad", *GOOD), "exactly one of time_s"),
    (_csv("time_s,slope_rad", *GOOD), "exactly one of speed_m_s, speed_kmh, speed_mph"),
    (_csv("time_s,speed_m_s,speed_kmh", "0,9,9"), r"columns \['speed_m_s', 'speed_kmh'\]"),
    (_csv("time_s,speed_m_s,slope_rad,slope_percent", "0,0,1,1"), "at most one of slope_percent"),
    (_csv("time_s,speed_ms", *GOOD), "unknown column 'speed_ms'; did you mean 'speed_m_s'"),
    (
        _csv("time_s,speed_m_s,grade", "0,0,1", "2,0,1"),
        r"'grade'.* states no unit; .*grade\[percent",
    ),
    (
        _csv("time_s,speed", *GOOD),
        "unknown column 'speed'.* states no unit; allowed: time_s, speed_m_s",
    ),
    (_csv("time_s,speed_m_s,time_s", "0,0,0"), "line 1: column 'time_s' appears 2 times"),
    (
        _csv("# c", "time_s,speed_m_s", "0,0", "1,x"),
        "line 4: speed_m_s is 'x'; allowed: a finite number",
    ),
    (_csv("time_s,speed_m_s", "0,0", "1_0,1"), "line 3: time_s is '1_0'"),
    (
        _csv("time_s,speed_m_s", "0,0", "1", "2", "3,0"),
        "line 3: 1 values; allowed: one per column, 2",
    ),
    (_csv("time_s,speed_m_s", "0,5", "1,0", "2,-5", "3,-5"), "line 5, .*reverses at up to 5 m/s"),
    (_csv("time_s,speed_kmh", "0,0", "1,361"), "line 3, column speed_kmh: value 361; .*0 to 252"),
    (_csv("time_s,speed_m_s", "0,0", "0,1"), "lasts 0 s in 1 rows"),
    (_csv("time_s,speed_m_s", "0,0", "1,1", "62,1"), "line 4, column time_s: value 62, 61 s after"),
    (_csv("time_s,speed_m_s", "0,0", "1000,1", "2000,1"), "1000 s apart; are they in ms"),
    (_csv("time_s,speed_m_s", "0,0", "1,0"), "the trip lasts 1 s in 2 rows; at least 2 s"),
    (
        _csv("time_s,speed_m_s", *(f"{k},{0 if k < 8 else 13}" for k in range(16))),
        r"line 10, column speed_m_s: value 13; .*at most 12 m/s\^2.* this is 13 m/s\^2",
    ),
    (
        _csv("time_s,speed_m_s,slope_percent", "0,0,0", "2,1,-31"),
        "line 3, column slope_percent: value -31; allowed: -30 to 30",
    ),
    (
        _csv("time_s,speed_m_s,slope_rad", "0,0,0.3", "2,1,0"),
        "line 2, column slope_rad: value 0.3; allowed: -0.291457 to 0.291457",
    ),
    (
        _csv("time_s,speed_m_s,elevation_m", "0,0,0", "20,20,0", "25,20,90", "45,20,90"),
        "column elevation_m: slope profile: .* allowed: -30 % to 30 %",
    ),
    (
        _csv("time_s,speed_m_s", "0,0", "0.5,5", "1,0", "1.5,5", "2,0", "3,0"),
        "at 1 Hz the trip covers 0.0 m instead of 5.0 m",
    ),
    (b"time_s,speed_m_s\n0,0\n1,1\xff\n", "line 3: speed_m_s is '1ÿ'"),
]


@pytest.mark.parametrize(("text", "message"), BAD_FILES, ids=[message for _, message in BAD_FILES])
def test_bad_files_are_explained(read: Reader, text: str | bytes, message: str) -> None:
    with pytest.raises(RouteError, match=message) as caught:
        read(text, "bad.csv")
    assert "bad.csv" in str(caught.value)


@given(st.text(max_size=80))
def test_arbitrary_text_is_a_table_or_a_route_error(text: str) -> None:
    with contextlib.suppress(RouteError):
        table = parse_text_table("time_s,speed_m_s\n" + text, "fuzz.csv")
        assert all(np.all(np.isfinite(column)) for column in clean(table).columns.values())


def test_oversized_field_is_a_route_error(read: Reader) -> None:
    with pytest.raises(RouteError, match="line 2: field larger than field limit"):
        read(_csv("time_s,speed_m_s", "0," + "1" * 200_000))


def test_files_without_an_end_are_refused(tmp_path: Path) -> None:
    """A device would fill the memory."""
    device, large = tmp_path / "device.csv", tmp_path / "large.csv"
    device.symlink_to("/dev/zero")
    with large.open("wb") as file:
        file.truncate(1_100_000_000)
    with pytest.raises(RouteError, match=r"cannot be read: not a regular file"):
        read_user_trip(device)
    with pytest.raises(RouteError, match="1100000000 bytes; at most 1000000000 are read"):
        read_user_trip(large)
