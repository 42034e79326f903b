"""Clocks, units and texts as the field has them, of one drive: read as it was, or refused for a reason."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.extras.iptm_drives.field_drives import (
    DRIVE,
    LENGTH_M,
    Driven,
    is_the_drive,
    write_bag,
    write_csv,
    write_fcd,
    write_gpx,
)

from iptm_core.errors import RouteError
from iptm_core.routes.user_csv import read_user_trip, trip_from_columns
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import FloatArray


@pytest.fixture
def table(tmp_path: Path) -> Callable[..., UserTrip]:
    def read(header: str, *columns: Any, separator: str = ",", encoding: str = "utf-8") -> UserTrip:
        rows = [separator.join(map(str, row)) for row in zip(*columns, strict=True)]
        path = tmp_path / "a.csv"
        path.write_bytes("\n".join([header, *rows, ""]).encode(encoding))
        return read_user_trip(path)

    return read


def clock(form: str, begin: str, zone: str = "UTC") -> list[str]:
    moments = pd.date_range(begin, periods=121, freq="s", tz="UTC")
    return list(moments.tz_convert(zone).strftime(form))


# fmt: off
CLOCKS = {
    "d.m.y": (clock("%d.%m.%Y %H:%M:%S", "2026-05-04T07:30"), ""),
    "d-Mon-y": (clock("%d-%b-%Y %H:%M:%S.000", "2026-05-04T07:30"), ""),
    "m/d/y with am and pm": (clock("%m/%d/%Y %I:%M:%S %p", "2026-05-04T11:59"), ""),
    "am and pm": (clock("%I:%M:%S %p", "2026-05-04T11:59"), ""),
    "12 hours": (clock("%I:%M:%S", "2026-05-04T12:59"), "noon"),
    "midnight": (clock("%H:%M:%S", "2026-05-04T23:59"), "midnight"),
    "m:s": (clock("%M:%S", "2026-05-04T07:30"), ""),
    "summer time": (clock("%Y-%m-%d %H:%M:%S", "2026-10-25T00:59", "Europe/Berlin"), "summer"),
    "week": ((604_740 + DRIVE.times_s) % 604_800, "the end of a week"),
    "1024 weeks": (DRIVE.times_s + np.where(DRIVE.times_s > 30, 1024 * 604_800, 0), "1024 weeks"),
}
# fmt: on


@pytest.mark.parametrize("kind", CLOCKS)
def test_clocks(table: Callable[..., UserTrip], kind: str) -> None:
    times, note = CLOCKS[kind]
    trip = table("time,speed_m_s", times, DRIVE.speeds)
    is_the_drive(trip, note, silent=not note)
    assert trip.cycle.duration_s == 120.0


def test_counters_that_overflow(table: Callable[..., UserTrip]) -> None:
    ms = (2**32 - 60_000 + 1000 * DRIVE.times_s) % 2**32
    is_the_drive(table("time [ms],speed_m_s", ms, DRIVE.speeds), "the largest number of ms")


# fmt: off
REFUSED_TIMES = {
    "are they in days": lambda drive: 46_146.3125 + drive.times_s / 86_400.0,
    "are the times in ms": lambda drive: 1000.0 * drive.times_s,
    "different times, such as 1777880000 s": lambda drive: np.full(drive.times_s.size, 1_777_880_000.0),
}
# fmt: on


@pytest.mark.parametrize("reason", REFUSED_TIMES)
def test_times_of_another_unit(table: Callable[..., UserTrip], reason: str) -> None:
    fast = Driven.at(50.0)
    with pytest.raises(RouteError, match=reason):
        table("time_s,speed_m_s", REFUSED_TIMES[reason](fast), fast.speeds)
    with pytest.raises(RouteError, match=r"equal in most rows; allowed: h:m:s"):
        table("time,speed_m_s", ["07:30"] * 60 + ["07:31"] * 61, DRIVE.speeds)


def test_texts_that_are_no_numbers(table: Callable[..., UserTrip]) -> None:
    speeds = [f"{each:.3f}" for each in DRIVE.speeds]
    for row, text in enumerate(
        ["--", "?", "---", "#VALUE!", "1.#QNAN", "-nan(ind)", "*", "missing"]
    ):
        speeds[12 + 9 * row] = text
    trip = table("time_s,speed_m_s", DRIVE.times_s, speeds)
    is_the_drive(trip, "speed_m_s not readable at 7 lines, as in line 23: speed_m_s is '?'")
    trip = table("time_s,speed_m_s", [*DRIVE.times_s, "Average"], [*DRIVE.speeds, 10.4])
    is_the_drive(trip, "time_s not readable at 1 line", "1 line without a time left out")
    with_unit = [f"{3.6 * each} km/h" for each in DRIVE.speeds]
    is_the_drive(table("time_s,speed_kmh", DRIVE.times_s, with_unit), silent=True)
    with pytest.raises(RouteError, match=r"speed_mph states mph, line 2 km/h"):
        table("time_s,speed_mph", DRIVE.times_s, with_unit)


@pytest.mark.parametrize(
    ("header", "separator", "encoding"),
    [
        ("time_s,speed_m_s", ",", "utf-16-le"),
        ("time_s speed_m_s", "   ", "utf-8"),
        ("time_s|speed_m_s", "|", "utf-8"),
    ],
)
def test_separators_and_encodings(
    table: Callable[..., UserTrip], header: str, separator: str, encoding: str
) -> None:
    columns = DRIVE.times_s, DRIVE.speeds
    is_the_drive(table(header, *columns, separator=separator, encoding=encoding), silent=True)


def test_units_of_places_and_accelerations(table: Callable[..., UserTrip]) -> None:
    places = DRIVE.latitudes, DRIVE.longitudes
    header = "time_s,latitudeE7,longitudeE7"
    is_the_drive(
        table(header, DRIVE.times_s, *(np.round(1e7 * each) for each in places)), silent=True
    )
    header = "time_s,speed_m_s,latitude_deg,longitude_deg"
    trip = table(header, DRIVE.times_s, DRIVE.speeds, *places[::-1])
    is_the_drive(trip, "latitudes and longitudes are exchanged")
    assert trip.line is not None
    assert trip.line.latitudes_deg[0] == pytest.approx(48.2, abs=0.01)
    header, gained = "time_s,speed_kmh,acceleration [m/s2]", np.gradient(DRIVE.speeds)
    is_the_drive(table(header, DRIVE.times_s, 3.6 * DRIVE.speeds, gained), silent=True)
    with pytest.raises(RouteError, match=r"accelerations contradict .* as km/h and m/s do"):
        table(header, DRIVE.times_s, DRIVE.speeds, gained)


def test_columns_in_memory_of_pandas_and_numpy() -> None:
    moments = pd.date_range("2026-05-04T07:30", periods=121, freq="s", tz="Europe/Berlin")
    is_the_drive(trip_from_columns({"time_s": moments, "speed_m_s": DRIVE.speeds}), silent=True)
    hidden = (DRIVE.times_s > 30) & (DRIVE.times_s < 34)
    masked = np.ma.masked_array(np.where(hidden, 10.0, DRIVE.speeds), mask=hidden)
    trip = trip_from_columns({"time_s": DRIVE.times_s, "speed_m_s": masked})
    is_the_drive(trip, "speed_m_s missing at 3 rows")
    infinite = np.where(hidden, np.inf, DRIVE.speeds)
    trip = trip_from_columns({"time_s": DRIVE.times_s, "speed_m_s": infinite})
    is_the_drive(trip, "speed_m_s missing at 3 rows")
    for speeds in (DRIVE.speeds > 3.0, DRIVE.speeds + 0j):
        with pytest.raises(RouteError, match="allowed: finite numbers"):
            trip_from_columns({"time_s": DRIVE.times_s, "speed_m_s": speeds})


def test_a_tunnel_has_the_length_of_its_places(tmp_path: Path) -> None:
    kept = (DRIVE.times_s < 15) | (DRIVE.times_s > 45)
    path = write_gpx(tmp_path / "a.gpx", DRIVE.rows(kept), with_speed=False)
    trip = read_user_trip(path)
    assert trip.cycle.distance_m == pytest.approx(LENGTH_M, rel=0.01)
    assert "1 gap of up to 32 s while driving" in "; ".join(trip.notes)


@pytest.mark.parametrize("late_s", [-3.0, 2.0, 5.0])
def test_speeds_behind_their_places(tmp_path: Path, late_s: float) -> None:
    speeds = np.interp(DRIVE.times_s - late_s, DRIVE.times_s, DRIVE.speeds)
    trip = read_user_trip(write_gpx(tmp_path / "a.gpx", DRIVE.but(speeds=speeds)))
    is_the_drive(trip, f"speeds are {abs(late_s):g} s {'behind' if late_s > 0 else 'ahead of'}")


def test_both_clocks_of_a_bag_are_set_ahead(tmp_path: Path) -> None:
    two = Driven.at(2.0)

    def later(times: FloatArray) -> FloatArray:
        return times + np.where(two.times_s > 30.0, 20.0, 0.0)

    drive = two.but(times_s=later(two.times_s), received_s=later(two.received_s))
    trip = read_user_trip(write_bag(tmp_path / "bag", drive))
    is_the_drive(trip, "clock set ahead by 20 s at message 62")
    assert trip.cycle.duration_s == 120.0


@pytest.mark.parametrize(
    ("stamps_at", "receipt_at", "reason"),
    [
        (30.0, 80.0, "the clocks of sender and recorder were set"),
        (60.0, 60.0, "a clock that was set back"),
    ],
)
def test_both_clocks_of_a_bag_are_set_back(
    tmp_path: Path, stamps_at: float, receipt_at: float, reason: str
) -> None:
    two = Driven.at(2.0)
    drive = two.but(
        times_s=two.times_s - 30.0 * (two.times_s > stamps_at),
        received_s=two.received_s - 30.0 * (two.times_s > receipt_at),
    )
    with pytest.raises(RouteError, match=reason):
        read_user_trip(write_bag(tmp_path / "bag", drive))


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_places_in_another_unit(tmp_path: Path, factor: float) -> None:
    two = Driven.at(2.0)
    trip = read_user_trip(write_bag(tmp_path / "bag", two.but(along_m=factor * two.along_m)))
    is_the_drive(trip, f"places are multiplied by {1.0 / factor:g}")


def test_places_without_a_way_are_refused_soon(tmp_path: Path) -> None:
    fast = Driven.at(50.0)
    there = 500.0 * np.random.default_rng(1).standard_normal(fast.times_s.size)
    path = write_gpx(tmp_path / "a.gpx", fast.but(east_m=there), with_speed=False)
    with pytest.raises(RouteError, match=r"aside of the way|two senders"):
        read_user_trip(path)


def test_single_heights_may_leap_but_not_most(tmp_path: Path) -> None:
    rows = np.arange(121)
    marked = np.where(rows % 17, DRIVE.heights_m, -9999.0)
    trip = read_user_trip(write_gpx(tmp_path / "a.gpx", DRIVE.but(heights_m=marked)))
    is_the_drive(trip, "ele missing or not plausible at 8 track points", grade=True)
    heights = DRIVE.heights_m + np.where(rows % 2, 47.0, 0.0)
    with pytest.raises(RouteError, match=r"column ele: .* allowed: heights of a road"):
        read_user_trip(write_gpx(tmp_path / "a.gpx", DRIVE.but(heights_m=heights)))


@pytest.mark.parametrize(
    ("slope", "units"), [("3.0", "degrees and percent"), ("0.03", "degrees and rad")]
)
def test_slopes_of_sumo_in_another_unit(tmp_path: Path, slope: str, units: str) -> None:
    path = write_fcd(tmp_path / "a.xml", DRIVE)
    path.write_text(path.read_text().replace(' z="', f' slope="{slope}" z="'))
    with pytest.raises(RouteError, match=f"slopes and heights contradict.*{units}"):
        read_user_trip(path)


def test_speeds_beyond_those_of_cars_that_are_driven_up_to(tmp_path: Path) -> None:
    """Single values beyond are odd; those that are reached evenly are of another unit."""
    fast = Driven.at(10.0)
    with pytest.raises(RouteError, match=r"value 7[0-9.]*; allowed: 0 to 70"):
        read_user_trip(write_csv(tmp_path / "a.csv", fast.but(speeds=3.6 * fast.speeds)))


def test_speeds_that_drop_to_0_at_single_rows(tmp_path: Path) -> None:
    out = np.random.default_rng(1).random(121) < 0.08
    drive = DRIVE.but(speeds=np.where(out, 0.0, DRIVE.speeds))
    trip = read_user_trip(write_csv(tmp_path / "a.csv", drive))
    assert trip.cycle.distance_m == pytest.approx(LENGTH_M, rel=0.02)
    assert "speed_m_s not plausible at" in "; ".join(trip.notes)


@pytest.mark.parametrize("name", ["a.csv.gz", "a.gpx.gz", "a.xml.gz"])
def test_files_that_are_much_larger_unpacked(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("MAX_BYTES", "MAX_FCD_BYTES"):
        monkeypatch.setattr(f"iptm_drives.reading.{limit}", 1_000_000)
    for limit in ("MAX_GPX_BYTES", "MAX_FCD_BYTES"):
        monkeypatch.setattr(f"iptm_drives.xml_drives.{limit}", 1_000_000)
    (tmp_path / name).write_bytes(gzip.compress(b"<a>" + b" " * 30_000_000))
    with pytest.raises(RouteError, match="more than 1000000 bytes; at most"):
        read_user_trip(tmp_path / name)
