"""One drive in every form that is read, for tests that disturb it: 1,250 m, 120 s, a stop, 3 % uphill."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from iptm_core.errors import RouteError
from iptm_core.routes.user_csv import read_user_trip, trip_from_columns
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import FloatArray
from iptm_drives.can_log import read_can_log
from iptm_drives.reading import trip_of_table

BEGIN = datetime(2026, 5, 4, 7, 30, tzinfo=timezone.utc)
UNIX_S = BEGIN.timestamp()
KNOTS = ([0, 10, 40, 50, 70, 85, 105, 115, 120], [0, 15, 15, 0, 0, 20, 20, 0, 0])
LENGTH_M, TOP_M_S, LASTS_S, GRADE = 1250.0, 20.0, 120.0, 0.03
STORE = get_typestore(Stores.ROS2_JAZZY)
ODOMETRY = "nav_msgs/msg/Odometry"


def true_speed(times_s: Any) -> FloatArray:
    return np.interp(times_s, *KNOTS)


@dataclass(frozen=True, eq=False)
class Driven:
    """Rows of the drive, all of shape (n,); NaN stands for what a row does not state."""

    times_s: FloatArray
    speeds: FloatArray
    along_m: FloatArray
    heights_m: FloatArray
    received_s: FloatArray
    east_m: FloatArray
    """Aside of the road."""

    @classmethod
    def at(cls, rate_hz: float = 1.0) -> Driven:
        times = np.arange(0.0, LASTS_S + 1e-9, 1.0 / rate_hz)
        fine = np.arange(0.0, LASTS_S + 1e-9, 0.01)
        means = 0.5 * (true_speed(fine)[1:] + true_speed(fine)[:-1])
        along = np.interp(times, fine, np.concatenate([[0.0], np.cumsum(0.01 * means)]))
        heights = 500.0 + GRADE * along
        return cls(times, true_speed(times), along, heights, times.copy(), np.zeros(times.size))

    def rows(self, keep: Any) -> Driven:
        return Driven(**{name: values[keep] for name, values in vars(self).items()})

    def but(self, **changed: FloatArray) -> Driven:
        return replace(self, **changed)

    @property
    def latitudes(self) -> FloatArray:
        return 48.2 + self.along_m * np.sqrt(0.5) / 111_200.0

    @property
    def longitudes(self) -> FloatArray:
        there = self.along_m * np.sqrt(0.5) + self.east_m
        return 11.5 + there / (111_320.0 * np.cos(np.radians(48.2)))


DRIVE = Driven.at()


def text(value: float, form: str = ".3f") -> str:
    return "" if np.isnan(value) else format(value, form)


def write_gpx(path: Path, drive: Driven, *, with_speed: bool = True) -> Path:
    points = []
    for row in range(drive.times_s.size):
        inside = ""
        if not np.isnan(drive.heights_m[row]):
            inside += f"<ele>{drive.heights_m[row]:.2f}</ele>"
        if not np.isnan(drive.times_s[row]):
            moment = BEGIN + timedelta(seconds=float(drive.times_s[row]))
            inside += f"<time>{moment.isoformat().replace('+00:00', 'Z')}</time>"
        if with_speed and not np.isnan(drive.speeds[row]):
            inside += f"<extensions><speed>{drive.speeds[row]:.3f}</speed></extensions>"
        place = (
            f'lat="{text(drive.latitudes[row], ".7f")}" lon="{text(drive.longitudes[row], ".7f")}"'
        )
        points.append(f"<trkpt {place}>{inside}</trkpt>")
    head = '<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    path.write_text(head + "\n".join(points) + "</trkseg></trk></gpx>")
    return path


def columns_of(drive: Driven, *, places: bool) -> dict[str, FloatArray]:
    columns = {"time_s": drive.times_s, "speed_m_s": drive.speeds, "elevation_m": drive.heights_m}
    if places:
        columns |= {"latitude_deg": drive.latitudes, "longitude_deg": drive.longitudes}
    return columns


def write_csv(path: Path, drive: Driven, *, places: bool = False) -> Path:
    columns = columns_of(drive, places=places)
    rows = zip(*columns.values(), strict=True)
    lines = (",".join(text(value, ".8f") for value in row) for row in rows)
    path.write_text("\n".join([",".join(columns), *lines, ""]))
    return path


def write_fcd(path: Path, drive: Driven, *, geo: bool = False) -> Path:
    rows = []
    for row in range(drive.times_s.size):
        x, y = drive.along_m[row], drive.east_m[row]
        place = (
            f'x="{text(drive.longitudes[row], ".7f")}" y="{text(drive.latitudes[row], ".7f")}"'
            if geo
            else f'x="{text(x, ".2f")}" y="{text(y, ".2f")}"'
        )
        state = f'speed="{text(drive.speeds[row], ".3f")}" z="{text(drive.heights_m[row], ".2f")}"'
        rows.append(
            f'<timestep time="{text(drive.times_s[row])}"><vehicle id="a" {place} {state}/></timestep>'
        )
    path.write_text("<fcd-export>" + "\n".join(rows) + "</fcd-export>")
    return path


def message(stamp_s: float, x: float, y: float, speed: float) -> bytes:
    def make(kind: str, *fields: Any) -> Any:
        return STORE.types[kind](*fields)

    def vector(first: float) -> Any:
        return make("geometry_msgs/msg/Vector3", first, 0.0, 0.0)

    ns = round(stamp_s * 1e9)
    stamp = make("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9)
    pose = make(
        "geometry_msgs/msg/Pose",
        make("geometry_msgs/msg/Point", x, y, 0.0),
        make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
    )
    twist = make("geometry_msgs/msg/Twist", vector(speed), vector(0.0))
    none = np.zeros(36)
    odometry = make(
        ODOMETRY,
        make("std_msgs/msg/Header", stamp, "odom"),
        "base_link",
        make("geometry_msgs/msg/PoseWithCovariance", pose, none),
        make("geometry_msgs/msg/TwistWithCovariance", twist, none),
    )
    return bytes(STORE.serialize_cdr(odometry, ODOMETRY))


def write_bag(path: Path, drive: Driven) -> Path:
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/odom", ODOMETRY, typestore=STORE)
        rows = zip(
            drive.received_s, drive.times_s, drive.along_m, drive.east_m, drive.speeds, strict=True
        )
        for received, stamp, *state in rows:
            at_ns = round((UNIX_S + float(received)) * 1e9)
            writer.write(topic, at_ns, message(UNIX_S + float(stamp), *map(float, state)))
    return path


DBC = """VERSION ""

BO_ 256 Motion: 8 ECU
 SG_ Speed : 0|16@1+ (0.01,0) [0|300] "km/h" ECU

BO_ 2566844926 CCVS: 8 ECU
 SG_ WheelSpeed : 8|16@1+ (0.00390625,0) [0|250.996] "km/h" ECU

BO_ 512 Place: 8 ECU
 SG_ Latitude : 0|32@1- (0.0000001,0) [-90|90] "deg" ECU
 SG_ Longitude : 32|32@1- (0.0000001,0) [-180|180] "deg" ECU
"""


def write_dbc(folder: Path) -> Path:
    (folder / "car.dbc").write_text(DBC)
    return folder / "car.dbc"


def candump(
    times_s: Iterable[float], data: Iterable[bytes], number: str = "100", bus: str = "can0"
) -> str:
    return "".join(
        f"({UNIX_S + at:.6f}) {bus} {number}#{content.hex().upper()}\n"
        for at, content in zip(times_s, data, strict=True)
    )


def speed_bytes(speeds: Iterable[float], not_available: int = 0xFFFF) -> list[bytes]:
    raw = [not_available if np.isnan(v) else round(360.0 * v) % 65536 for v in speeds]
    return [value.to_bytes(2, "little") + bytes(6) for value in raw]


def write_log(path: Path, drive: Driven) -> Path:
    path.write_text(candump(drive.times_s, speed_bytes(drive.speeds)))
    return path


def write_frames(path: Path, drive: Driven) -> Path:
    can = pytest.importorskip("can", reason="requirements/can.txt is not installed")
    with can.Logger(path) as writer:
        for at, data in zip(drive.times_s, speed_bytes(drive.speeds), strict=True):
            frame = {"arbitration_id": 256, "is_extended_id": False, "data": data, "channel": 0}
            writer(can.Message(timestamp=UNIX_S + float(at), **frame))
    return path


def read_log(path: Path, signals: Mapping[str, str] | None = None, channel: str = "") -> UserTrip:
    pytest.importorskip("cantools", reason="requirements/can.txt is not installed")
    dbc = write_dbc(path.parent)
    return trip_of_table(path, read_can_log(path, dbc, signals or {"speed_kmh": "Speed"}, channel))


Reader = Callable[[Path, Driven], UserTrip]
READERS: dict[str, Reader] = {
    "gpx": lambda folder, drive: read_user_trip(
        write_gpx(folder / "a.gpx", drive, with_speed=False)
    ),
    "gpx with speed": lambda folder, drive: read_user_trip(write_gpx(folder / "a.gpx", drive)),
    "csv": lambda folder, drive: read_user_trip(write_csv(folder / "a.csv", drive)),
    "csv with places": lambda folder, drive: read_user_trip(
        write_csv(folder / "a.csv", drive, places=True)
    ),
    "library": lambda _, drive: trip_from_columns(columns_of(drive, places=False)),
    "library with places": lambda _, drive: trip_from_columns(columns_of(drive, places=True)),
    "fcd": lambda folder, drive: read_user_trip(write_fcd(folder / "a.xml", drive)),
    "fcd on earth": lambda folder, drive: read_user_trip(
        write_fcd(folder / "a.xml", drive, geo=True)
    ),
    "bag": lambda folder, drive: read_user_trip(write_bag(folder / "a_bag", drive)),
    "can": lambda folder, drive: read_log(write_log(folder / "a.log", drive)),
}
WITH_PLACES = tuple(name for name in READERS if name not in {"csv", "library", "can"})
WITH_BOTH = tuple(name for name in WITH_PLACES if name != "gpx")
WITH_HEIGHTS = tuple(name for name in READERS if name not in {"bag", "can"})


def is_the_drive(trip: UserTrip, *notes: str, grade: bool = False, silent: bool = False) -> None:
    assert trip.cycle.distance_m == pytest.approx(LENGTH_M, rel=0.01), trip.notes
    assert trip.cycle.max_speed_m_s == pytest.approx(TOP_M_S, abs=0.2), trip.notes
    assert bool(trip.notes) != silent
    for note in notes:
        assert note in "; ".join(trip.notes)
    if grade:
        assert trip.slope is not None
        there = trip.slope.slope_at(np.linspace(200.0, 1000.0, 9))
        np.testing.assert_allclose(np.tan(there), GRADE, atol=0.002)


LENGTH_ERROR, TOP_ERROR_M_S = 0.02, 1.0


def outcome(reader: str, drive: Driven) -> UserTrip | RouteError:
    with tempfile.TemporaryDirectory() as folder:
        try:
            return READERS[reader](Path(folder), drive)
        except RouteError as reason:
            return reason


def check(
    found: UserTrip | RouteError,
    *words: str,
    length_error: float = LENGTH_ERROR,
    may_refuse: bool = False,
    is_silent: bool = False,
) -> None:
    """Check that a trip is right and states its repairs, or is refused for a reason."""
    if isinstance(found, RouteError):
        assert may_refuse, str(found)
        assert "allowed" in str(found)
        return
    cycle = found.cycle
    assert cycle.distance_m == pytest.approx(LENGTH_M, rel=length_error), found.notes
    assert cycle.max_speed_m_s == pytest.approx(TOP_M_S, abs=TOP_ERROR_M_S), found.notes
    assert is_silent or found.notes
    for word in words:
        assert word in "; ".join(found.notes)
    if found.slope is not None and length_error < 0.5:
        inside = found.slope.slope_at(np.linspace(450.0, 900.0, 20))
        np.testing.assert_allclose(np.tan(inside), GRADE, atol=0.016)
