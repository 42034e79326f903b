"""Files of other programs: read, or named as what they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_core.errors import RouteError
from iptm_core.routes.user_csv import read_user_trip
from iptm_drives.cells import is_day_first, seconds_of
from iptm_drives.column_names import meaning_of

COUNT = 30
STEP_DEG = 10.0 / 111195.0
"""Ten metres north."""


def _places() -> list[tuple[str, float, float]]:
    return [
        (f"2026-05-04T07:30:{s:02d}Z", 47.6 + s * STEP_DEG, 400.0 + 0.4 * s) for s in range(COUNT)
    ]


def _tcx() -> str:
    points = "".join(
        f"<Trackpoint><Time>{when}</Time><Position><LatitudeDegrees>{lat:.7f}</LatitudeDegrees>"
        f"<LongitudeDegrees>9.2</LongitudeDegrees></Position><AltitudeMeters>{height}</AltitudeMeters>"
        "</Trackpoint>"
        for when, lat, height in _places()
    )
    kind = "TrainingCenterDatabase"
    return f'<?xml version="1.0"?><{kind} xmlns="x"><Track>{points}</Track></{kind}>'


def _kml() -> str:
    whens = "".join(f"<when>{when}</when>" for when, _, _ in _places())
    coords = "".join(f"<gx:coord>9.2 {lat:.7f} {height}</gx:coord>" for _, lat, height in _places())
    return (
        '<?xml version="1.0"?><kml xmlns="k" xmlns:gx="g"><Document><gx:Track>'
        f"{whens}{coords}</gx:Track></Document></kml>"
    )


def _nmea() -> str:
    lines = []
    for second, (_, lat, height) in enumerate(_places()):
        clock, north = f"0730{second:02d}.00", f"47{(lat - 47.0) * 60.0:08.5f}"
        lines += [
            f"$GPGGA,{clock},{north},N,00912.0000,E,1,12,0.8,{height},M,47.6,M,,*00",
            f"$GPRMC,{clock},A,{north},N,00912.0000,E,19.4384,0.0,040526,,,A*00",
        ]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("name", "text"), [("a.tcx", _tcx()), ("a.kml", _kml()), ("a.nmea", _nmea())]
)
def test_a_drive_of_another_program_is_read(tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    trip = read_user_trip(file)
    assert trip.cycle.max_speed_m_s == pytest.approx(10.0, abs=0.1)
    assert trip.slope is not None
    assert trip.slope.slopes_rad.mean() == pytest.approx(0.04, abs=0.005)


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.csv", b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
        ("a.fit", b"\x0e\x10\x00\x00\x00\x00\x00\x00.FIT\x00\x00", "FIT file"),
        ("a.csv", b"PK\x03\x04\x14\x00\x00\x00 drive.csv", "zip archive"),
        ("a.csv", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", r"workbook \(xls\)"),
        ("a.json", b'{"speed": [1, 2]}', "JSON"),
        ("a.csv", b"<?xml version='1.0'?><osm></osm>", "XML"),
        ("a.h5", b"\x89HDF\r\n", "HDF5"),
    ],
)
def test_what_is_not_read_is_named(tmp_path: Path, name: str, content: bytes, kind: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RouteError, match=kind):
        read_user_trip(tmp_path / name)


@pytest.mark.parametrize(
    "header",
    ["Wind Speed [km/h]", "Set Speed [km/h]", "Lead speed [m/s]", "TTC [s]", "Time Headway [s]",
     "Following Distance [m]", "Engine speed [km/h]"],
)  # fmt: skip
def test_quantities_of_something_else_have_no_meaning(header: str) -> None:
    assert meaning_of(header) is None


def test_own_names_win_and_a_distance_that_is_not_the_way_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    rows = "\n".join(f"{s},{min(s, 10)},8,90" for s in range(COUNT))
    file.write_text(
        f"time_s,speed_m_s,distance [m],vehicle speed [km/h]\n{rows}\n", encoding="utf-8"
    )
    trip = read_user_trip(file)
    assert trip.cycle.max_speed_m_s == 10.0
    assert any("'distance [m]' is not the way" in note for note in trip.notes)


def test_dates_are_judged_by_the_column() -> None:
    assert is_day_first(["12/05/2026 23:59:59", "13/05/2026 00:00:00"])
    assert not is_day_first(["05/12/2026 23:59:59", "05/13/2026 00:00:00"])
    before, after = (
        seconds_of("", "", text, day_first=True)
        for text in ("12/05/2026 23:59:59", "13/05/2026 00:00:00")
    )
    assert after - before == 1.0
    torque = seconds_of("", "", "Mon May 04 07:30:00 GMT+02:00 2026")
    assert torque == seconds_of("", "", "2026-05-04T05:30:00Z")


def test_steep_heights_are_a_warning(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    rows = "\n".join(
        f"{s},{47.6 + s * STEP_DEG:.7f},9.2,{400 + 60 * (s > COUNT)}" for s in range(2 * COUNT)
    )
    file.write_text(f"time_s,latitude,longitude,altitude [m]\n{rows}\n", encoding="utf-8")
    assert any("heights are steeper than 15 %" in note for note in read_user_trip(file).notes)
