"""Files as the field writes them, each of one drive: read as it was, or refused for what is wrong."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.extras.iptm_drives.field_drives import (
    BEGIN,
    DRIVE,
    GRADE,
    LENGTH_M,
    TOP_M_S,
    UNIX_S,
    Driven,
    columns_of,
    is_the_drive,
    write_bag,
    write_csv,
    write_fcd,
    write_gpx,
)

from iptm_core.errors import RouteError
from iptm_core.routes.user_csv import read_user_trip, trip_from_columns
from iptm_core.routes.user_trip import UserTrip


@pytest.fixture
def gpx(tmp_path: Path) -> Callable[..., UserTrip]:
    def read(drive: Driven, change: Callable[[str], str] = str, **how: bool) -> UserTrip:
        path = write_gpx(tmp_path / "a.gpx", drive, **how)
        path.write_text(change(path.read_text()))
        return read_user_trip(path)

    return read


def test_single_values_that_a_gpx_lacks(gpx: Callable[..., UserTrip]) -> None:
    rows = np.arange(121)
    height = DRIVE.but(heights_m=np.where(rows == 33, np.nan, DRIVE.heights_m))
    is_the_drive(gpx(height, with_speed=False), "ele missing", "1 track point", grade=True)
    timeless = DRIVE.but(times_s=np.where(np.isin(rows, [60, 118, 119, 120]), np.nan, rows))
    is_the_drive(gpx(timeless), "4 track points without a time left out", grade=True)
    is_the_drive(gpx(DRIVE, lambda text: text.replace("<speed>15.000</speed>", "<speed/>", 4)))


@pytest.mark.parametrize(
    "extension",
    [
        "<sensor><ele>0</ele></sensor>",
        "<wind><speed>3.1</speed></wind>",
        "<photo><time>2020-01-01T00:00:00Z</time></photo>",
    ],
)
def test_what_sensors_state_in_extensions(gpx: Callable[..., UserTrip], extension: str) -> None:
    def add(text: str) -> str:
        return text.replace("</trkpt>", f"<extensions>{extension}</extensions></trkpt>")

    is_the_drive(gpx(DRIVE, add, with_speed=False), grade=True, silent=True)


@pytest.mark.parametrize("form", [".0Z", ".04Z", ".0000000Z", "+0000", "-00:00", ",5+0000", ""])
def test_moments_as_devices_write_them(gpx: Callable[..., UserTrip], form: str) -> None:
    """Python 3.10 reads a few of them only by itself."""
    is_the_drive(gpx(DRIVE, lambda text: text.replace("Z</time>", f"{form}</time>")), silent=True)


def test_a_pause_of_the_device_is_one_in_every_file(
    tmp_path: Path, gpx: Callable[..., UserTrip]
) -> None:
    kept = (DRIVE.times_s <= 52.0) | (DRIVE.times_s >= 68.0)
    for longer_s, standing_s in ((40.0, 56.0), (120.0, 60.0)):
        later = DRIVE.times_s + np.where(DRIVE.times_s > 60.0, longer_s, 0.0)
        paused = DRIVE.but(times_s=later).rows(kept)
        bare = paused.but(speeds=np.full(paused.speeds.size, np.nan))
        table = read_user_trip(write_csv(tmp_path / "a.csv", bare, places=True))
        is_the_drive(table, "1 pause")
        track = gpx(paused, with_speed=False)
        np.testing.assert_allclose(table.cycle.speeds_m_s, track.cycle.speeds_m_s, atol=0.02)
        assert table.cycle.duration_s == pytest.approx(120.0 - 16.0 + standing_s, abs=2.0)
        assert table.cycle.speeds_m_s[56:100].max() == 0.0


def test_the_slope_of_sumo_without_heights(tmp_path: Path) -> None:
    path = write_fcd(tmp_path / "a.fcd.xml", DRIVE, geo=True)
    text = path.read_text().replace('z="', 'slope="1.72" was="')
    path.write_text(text)
    is_the_drive(read_user_trip(path), grade=True, silent=True)


def test_files_of_sumo_of_all_kinds(tmp_path: Path) -> None:
    """Compressed, as CSV and Parquet, with times as h:m:s, a folder and a vehicle with # in its name."""
    folder = tmp_path / "run#1"
    folder.mkdir()
    text = write_fcd(folder / "a.fcd.xml", DRIVE).read_text().replace('id="a"', 'id="v.1#2"')
    (folder / "a.fcd.xml.gz").write_bytes(gzip.compress(text.encode()))
    rows = pd.DataFrame(
        {
            "timestep_time": [f"00:{int(t) // 60:02d}:{t % 60:05.2f}" for t in DRIVE.times_s],
            "vehicle_id": "v.1#2",
            "vehicle_x": DRIVE.along_m,
            "vehicle_y": 0.0,
            "vehicle_speed": DRIVE.speeds,
        }
    )
    other = rows.assign(vehicle_id="w", vehicle_speed=0.0)
    both = pd.concat([rows, other]).sort_values("timestep_time", kind="stable")
    both.to_csv(folder / "a.csv", sep=";", index=False)
    names = ["a.fcd.xml.gz", "a.csv"]
    if pytest.importorskip("pyarrow", reason="requirements/studies.txt is not installed"):
        both.to_parquet(folder / "a.parquet")
        names.append("a.parquet")
    for name in names:
        is_the_drive(read_user_trip(Path(f"{folder / name}#v.1#2")), silent=True)
    with pytest.raises(RouteError, match="holds 2 vehicles; name one"):
        read_user_trip(folder / "a.csv")


# fmt: off
TABLES = {
    "fastsim 2": ("cycSecs,cycMps,cycGrade,cycRoadType", ",", "", 1.0, True),
    "fastsim 3": ("time_s,mps,grade", ",", "", 1.0, True),
    "epa": ("US06 schedule\nfrom the agency\nTest Time, secs\tTarget Speed, mph", "\t", "", 0.44704, False),
    "units in brackets": ("Time [s];Vehicle_Speed [km/h]", ";", "", 1 / 3.6, False),
    "units below": ("time;speed\ns;km/h", ";", "", 1 / 3.6, False),
    "decimal commas": ("Time (s);Speed (m/s)", ";", "comma", 1.0, False),
    "named separator": ("sep=;\ntime_s;speed_kmh", ";", "", 1 / 3.6, False),
    "an index": (",time_s,speed_mph", ",", "index", 0.44704, False),
    "a last comma": ("time_s,speed_kmh,", ",", "last", 1 / 3.6, False),
    "dates": ("timestamp,speed_mph", ",", "date", 0.44704, False),
    "midnight": ("time,speed_mph", ",", "clock", 0.44704, False),
    "capitals": ("TIME_S,SPEED_KMH", ",", "", 1 / 3.6, False),
    "knots": ("GPS Time [ms],GPS Speed [knots]", ",", "ms", 0.514444, False),
}
# fmt: on


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_tables_of_other_programs(tmp_path: Path, kind: str, encoding: str) -> None:
    header, separator, form, unit, grade = TABLES[kind]
    lines = []
    for row, (time, speed) in enumerate(zip(DRIVE.times_s, DRIVE.speeds / unit, strict=True)):
        moments = {
            "date": (BEGIN + pd.Timedelta(seconds=time)).isoformat(" "),
            "clock": f"{(BEGIN + pd.Timedelta(hours=16.49, seconds=time)):%H:%M:%S}",
            "ms": f"{1000 * (UNIX_S + time):.0f}",
        }
        cells = [moments.get(form, f"{time:g}"), f"{speed:.3f}"]
        cells += [f"{GRADE}", "0"] if grade else []
        cells = [str(row), *cells] if form == "index" else cells
        cells += [""] if form == "last" else []
        line = separator.join(cells[: header.splitlines()[-1].count(separator) + 1])
        lines.append(line.replace(".", ",") if form == "comma" else line)
    note = "# mit Höhenprofil\n" if encoding == "latin-1" and kind != "named separator" else ""
    (tmp_path / "a.csv").write_text("\n".join([note + header, *lines, ""]), encoding)
    trip = read_user_trip(tmp_path / "a.csv")
    assert trip.cycle.distance_m == pytest.approx(LENGTH_M, rel=0.001)
    assert trip.cycle.max_speed_m_s == pytest.approx(TOP_M_S, rel=0.001)
    if grade:
        is_the_drive(trip, grade=True, silent=kind == "fastsim 3")


def test_of_two_columns_one_without_values_does_not_count(tmp_path: Path) -> None:
    rows = "\n".join(f"{t:g},{v:.3f},-" for t, v in zip(DRIVE.times_s, DRIVE.speeds, strict=True))
    (tmp_path / "a.csv").write_text(f"time_s,GPS Speed (m/s),Speed (OBD)(km/h)\n{rows}\n")
    is_the_drive(read_user_trip(tmp_path / "a.csv"), silent=True)


def test_columns_of_any_name_are_said_by_the_user(tmp_path: Path) -> None:
    rows = "\n".join(
        f"{1000 * t:g},{3.6 * v:.3f}" for t, v in zip(DRIVE.times_s, DRIVE.speeds, strict=True)
    )
    path = tmp_path / "a.csv"
    path.write_text(f"tick,v_veh_filtered\n{rows}\n")
    with pytest.raises(RouteError, match="unknown column 'tick'"):
        read_user_trip(path)
    trip = read_user_trip(Path(f"{path}#time=tick[ms],speed=v_veh_filtered[km/h]"))
    is_the_drive(trip, silent=True)
    for columns, reason in (
        ("speed=v[km/h]", "no 'v'"),
        ("sped=tick[s]", "did you mean 'speed'"),
        ("speed=tick[s]", "unit 's'"),
    ):
        with pytest.raises(RouteError, match=reason):
            read_user_trip(Path(f"{path}#{columns}"))


def test_tables_that_a_logger_left(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", DRIVE)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    cut = [
        (whole[: whole.rindex(b",") - 8], "the last line is cut"),
        (whole + b"\0" * 512, "512 empty bytes"),
        (b"".join([*lines[:40], b"39.5,1", b"\n", *lines[40:]]), "without all values"),
        (b"".join([*lines[:40], lines[0], *lines[40:]]), ""),
        (b"".join([*lines[:60], *lines[50:]]), "repeated word for word"),
    ]
    for content, note in cut:
        path.write_bytes(content)
        trip = read_user_trip(path)
        is_the_drive(trip, note, silent=not note)


def test_tables_in_memory() -> None:
    columns: dict[str, object] = dict(columns_of(DRIVE, places=False))
    moments = pd.Timestamp(BEGIN).tz_localize(None) + pd.to_timedelta(DRIVE.times_s, unit="s")
    for times in (
        moments.to_numpy(),
        (moments - moments[0]).to_numpy(),
        [str(each) for each in moments],
    ):
        is_the_drive(trip_from_columns({**columns, "time_s": times}), silent=True)
    speeds = pd.array(
        [None if row == 7 else speed for row, speed in enumerate(DRIVE.speeds)], "Float64"
    )
    trip = trip_from_columns({**columns, "speed_m_s": speeds, "Driver": ["me"] * 121})
    is_the_drive(trip, "speed_m_s missing at 1 row", "not read: Driver")


def test_bags_with_faults(tmp_path: Path) -> None:
    two = Driven.at(2.0)
    stamps = write_bag(tmp_path / "zero", two.but(times_s=np.full(two.times_s.size, -UNIX_S)))
    is_the_drive(read_user_trip(stamps), "all stamps are 0 s: the times of receipt are used")
    back = two.times_s - np.where(two.times_s >= 60.0, 30.0, 0.0)
    trip = read_user_trip(write_bag(tmp_path / "back", two.but(times_s=back)))
    is_the_drive(trip, "set by -30 s at message 121: the times of receipt are used")
    ahead = two.times_s + np.where(two.times_s >= 30.0, 20.0, 0.0)
    trip = read_user_trip(write_bag(tmp_path / "ahead", two.but(times_s=ahead)))
    is_the_drive(trip, "the times of receipt are used")
    nowhere = two.but(along_m=np.zeros(two.speeds.size))
    is_the_drive(read_user_trip(write_bag(tmp_path / "pose", nowhere)), "place never changes")


def test_a_bag_that_names_no_storage_is_known_by_its_magic(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "a#1", Driven.at(2.0))
    (bag,) = folder.glob("*.mcap")
    metadata = folder / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("storage_identifier: mcap", "storage_identifier: ''")
    )
    is_the_drive(read_user_trip(folder), silent=True)
    is_the_drive(read_user_trip(Path(f"{folder}#odom")), silent=True)
    bag.rename(folder / "renamed.bin")
    metadata.unlink()
    is_the_drive(read_user_trip(folder), silent=True)
