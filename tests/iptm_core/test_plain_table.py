"""A plain table of a trip: read without any extra, refused with its row, and the same with one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.extras import offered
from iptm_core.routes import user_csv
from iptm_core.routes.user_csv import plain_table, read_user_trip, trip_from_columns

PLACES = "time_s,speed_kmh,elevation_m,latitude_deg,longitude_deg\n" + "".join(
    f"{k},{36 if k else 0},{100 + 0.1 * k},{50 + 9e-5 * k:.6f},8.0\n" for k in range(60)
)
TABLES = {
    "slope": "# a comment\ntime_s,speed_mph,slope_percent\n5,0,1\n6,10,1\n8.5,12,-2\n11,6,0\n14,0,0\n",
    "height": "speed_m_s,elevation_m,time_s\n" + "".join(f"{k % 9},{k},{k}\n" for k in range(90)),
    "places": PLACES,
    "at speed": "time_s,speed_m_s\n0,6\n1,7\n2,7\n3,6.5\n",
}


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(user_csv, "offered", lambda _: ())


@pytest.fixture
def write(tmp_path: Path) -> Path:
    return tmp_path / "trip.csv"


@pytest.mark.usefixtures("alone")
def test_numbers_by_hand(write: Path) -> None:
    write.write_text(TABLES["slope"])
    trip = read_user_trip(write)
    np.testing.assert_allclose(trip.cycle.times_s, np.arange(10.0))
    np.testing.assert_allclose(trip.cycle.speeds_m_s[:2] / trip.cycle.speeds_m_s[1], [0.0, 1.0])
    assert trip.slope is not None
    assert trip.slope.slope_at(0.0) == pytest.approx(np.arctan(0.01))
    # The distance of the table: triangles and trapezia over 1, 2.5, 2.5 and 3 s.
    driven_m = 0.44704 * (1.0 * 5.0 + 2.5 * 11.0 + 2.5 * 9.0 + 3.0 * 3.0)
    assert trip.cycle.distance_m == pytest.approx(driven_m, rel=1e-9)


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,speed_m_s\n0,0\n1,fast\n", r"line 3: 'fast'; allowed: a finite number"),
        (
            "time_s,speed_m_s\n0,0\n1,nan\n",
            r"line 3, column speed_m_s: value nan; allowed: a finite",
        ),
        (
            "time_s,speed_m_s\n0,0\n1,-2\n",
            r"line 3, column speed_m_s: value -2; allowed: 0 to 70",
        ),
        ("time_s,speed_m_s\n0,0\n0,2\n", r"line 3, column time_s: value 0; allowed: 0 to 60 s"),
        ("time_s,speed_m_s\n0,0\n1\n", r"line 3: 1 values; allowed: 2"),
        ("time_s,speed_m_s,speed_kmh\n0,0,0\n1,1,3.6\n", r"several of speed_m_s; allowed: one"),
        ("time_s,Vehicle Speed\n0,0\n1,1\n", r"unknown column 'Vehicle Speed'.*extra that reads"),
        ("time_s,speed_m_s,latitude_deg\n0,0,1\n1,1,1\n", r"\['longitude_deg'\] are missing"),
        ("speed_m_s,elevation_m\n0,0\n1,1\n", r"\['time_s'\] are missing"),
        ("", r"0 lines; allowed: a header and 2 rows"),
    ],
)
def test_what_is_not_whole_is_refused(write: Path, text: str, message: str) -> None:
    write.write_text(text)
    with pytest.raises(RouteError, match=message):
        read_user_trip(write)


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("name", ["a.gpx", "a.csv#speed=v[m/s]", "a.fcd.xml#leader", "a.csv.gz"])
def test_other_files_need_an_extra(tmp_path: Path, name: str) -> None:
    with pytest.raises(RouteError, match="extra that reads drives"):
        read_user_trip(tmp_path / name)


@pytest.mark.parametrize("name", TABLES)
def test_an_extra_reads_a_plain_table_to_the_last_bit(write: Path, name: str) -> None:
    if not offered("drives"):
        pytest.skip("no extra that reads drives is installed")
    write.write_text(TABLES[name])
    plain = plain_table(write)
    cleaned = offered("drives")[0].drive_in_file(write)
    assert plain.columns.keys() == cleaned.columns.keys()
    for quantity, values in plain.columns.items():
        np.testing.assert_array_equal(values, cleaned.columns[quantity], quantity)


@pytest.mark.usefixtures("alone")
def test_columns_in_memory() -> None:
    trip = trip_from_columns({"time_s": [0.0, 1.0, 2.0], "speed_kmh": [0.0, 3.6, 0.0]})
    np.testing.assert_array_equal(trip.cycle.speeds_m_s, [0.0, 1.0, 0.0])
    with pytest.raises(RouteError, match="shapes"):
        trip_from_columns({"time_s": [0.0, 1.0, 2.0], "speed_kmh": [0.0, 3.6]})
