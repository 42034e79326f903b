"""Drives in CAN logs: what went onto the bus comes out as a drive."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.routes import build_route
from iptm_core.routes.user_csv import read_user_trip
from iptm_drives.can_log import can_log_csv
from iptm_drives.commands import drive as main

REASON = "requirements/can.txt is not installed"
DBC = """VERSION ""

BO_ 100 Motion: 8 Car
 SG_ VehicleSpeed : 0|16@1+ (0.01,0) [0|300] "km/h" Car
 SG_ Counter : 16|8@1+ (1,0) [0|255] "" Car

BO_ 2566848516 Place: 8 Car
 SG_ Latitude : 0|32@1- (0.0000001,0) [-90|90] "deg" Car
 SG_ Longitude : 32|32@1- (0.0000001,0) [-180|180] "deg" Car

BO_ 102 Height: 8 Car
 SG_ Altitude : 0|16@1+ (0.1,-500) [-500|6000] "m" Car
 SG_ Counter : 16|8@1+ (1,0) [0|255] "" Car
"""
SIGNALS = {
    "speed_kmh": "VehicleSpeed",
    "latitude_deg": "Latitude",
    "longitude_deg": "Longitude",
    "elevation_m": "Altitude",
}
BEGIN_S = 1_790_000_000.0
DURATION_S = 120.0
METRES_PER_DEGREE = 111_195.0


def speed_m_s(time_s: Any) -> Any:
    return 12.0 * np.sin(np.pi * np.clip(time_s, 0.0, DURATION_S) / DURATION_S) ** 2


def position_m(time_s: Any) -> Any:
    turns = 2.0 * np.pi * np.asarray(time_s) / DURATION_S
    return 6.0 * (np.asarray(time_s) - DURATION_S / (2.0 * np.pi) * np.sin(turns))


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    file = tmp_path / "car.dbc"
    file.write_text(DBC)
    return file


def write_frames(path: Path, dbc: Path) -> None:
    """A northward, climbing drive: speed at 50 Hz, place at 10 Hz, height at 1 Hz, and other frames."""
    can = pytest.importorskip("can", reason=REASON)
    cantools = pytest.importorskip("cantools", reason=REASON)
    pytest.importorskip("asammdf", reason=REASON)
    database = cantools.database.load_file(dbc)
    frames = []
    for index in range(int(50 * DURATION_S) + 1):
        at_s = index / 50.0
        values = {"Motion": {"VehicleSpeed": 3.6 * speed_m_s(at_s), "Counter": index % 256}}
        if index % 5 == 0:
            latitude = 48.0 + float(position_m(at_s)) / METRES_PER_DEGREE
            values["Place"] = {"Latitude": latitude, "Longitude": 10.0}
        if index % 50 == 0:
            values["Height"] = {"Altitude": 500.0 + 0.02 * float(position_m(at_s)), "Counter": 0}
        for name, signals in values.items():
            message = database.get_message_by_name(name)
            frames.append(
                can.Message(
                    timestamp=BEGIN_S + at_s,
                    arbitration_id=message.frame_id,
                    is_extended_id=message.is_extended_frame,
                    data=message.encode(signals),
                )
            )
        if index % 7 == 0:  # of others, and cut short
            frames.append(
                can.Message(timestamp=BEGIN_S + at_s, arbitration_id=77, is_extended_id=False)
            )
            frames.append(
                can.Message(
                    timestamp=BEGIN_S + at_s, arbitration_id=100, is_extended_id=False, data=b"\x01"
                )
            )
    with can.Logger(path) as log:
        for frame in frames:
            log(frame)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".mf4"])
def test_the_drive_on_the_bus_is_the_drive_of_the_leader(
    tmp_path: Path, dbc: Path, suffix: str
) -> None:
    log, drive = tmp_path / f"drive{suffix}", tmp_path / "drive.csv"
    write_frames(log, dbc)
    named = [part for item in SIGNALS.items() for part in ("--signal", "{}={}".format(*item))]
    picture = tmp_path / "drive.png"
    arguments = ["can", str(log), str(drive), "--dbc", str(dbc), *named, "--picture", str(picture)]
    assert main(arguments) == 0
    assert picture.stat().st_size > 10_000
    trip = read_user_trip(drive)
    times = trip.cycle.times_s
    np.testing.assert_allclose(trip.cycle.speeds_m_s, speed_m_s(times), atol=0.05)
    route = build_route(str(drive), initial_gap_m=15.0)
    assert route.leader.positions_m[-1] - 15.0 == pytest.approx(position_m(DURATION_S), abs=3.0)
    middle = np.linspace(200.0, 500.0, 20)
    np.testing.assert_allclose(np.tan(route.slope.slope_at(middle)), 0.02, atol=0.003)
    assert route.road_line.project(48.002, 10.0).lateral_m == pytest.approx(0.0, abs=0.1)


def test_signals_in_a_file_need_no_decoding(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason=REASON)
    file = tmp_path / "signals.mf4"
    times = np.arange(0.0, 60.0, 0.1)
    speed = asammdf.Signal(speed_m_s(times), times, name="v_veh", unit="m/s")
    with asammdf.MDF() as log:
        log.append([speed])
        log.save(file)
    drive = tmp_path / "drive.csv"
    drive.write_text(can_log_csv(file, None, {"speed_m_s": "v_veh"}))
    trip = read_user_trip(drive)
    np.testing.assert_allclose(trip.cycle.speeds_m_s, speed_m_s(trip.cycle.times_s), atol=0.02)
    with pytest.raises(RouteError, match="did you mean 'v_veh'"):
        can_log_csv(file, None, {"speed_m_s": "v_vehicle"})


# The reader of BLF leaves files that it refuses to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_mistakes_end_in_one_line(
    tmp_path: Path, dbc: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "drive.blf"
    write_frames(log, dbc)
    for signals, word in (
        ({"speed_kmh": "Vehiclespeed"}, "did you mean 'VehicleSpeed'"),
        ({"speed_kmh": "Counter"}, "2 signals .Counter.; .*Motion.Counter, Height.Counter"),
        ({"speed_knots": "VehicleSpeed"}, "speed_knots"),
        ({}, "columns are none"),
    ):
        with pytest.raises(RouteError, match=word):
            can_log_csv(log, dbc, signals)
    with pytest.raises(RouteError, match="with a DBC"):
        can_log_csv(log, None, {"speed_kmh": "VehicleSpeed"})
    with pytest.raises(RouteError, match="allowed: a CAN log"):
        can_log_csv(dbc, dbc, {"speed_kmh": "VehicleSpeed"})
    assert main(["can", str(log), str(tmp_path / "x.csv"), "--signal", "speed_kmh"]) == 2
    assert "COLUMN=SIGNAL" in capsys.readouterr().err
    content = log.read_bytes()
    source = random.Random(2)  # noqa: S311 - no secret
    for number in range(20):
        cut = content[: source.randrange(len(content))] if number % 2 else source.randbytes(500)
        log.write_bytes(cut)
        try:
            text = can_log_csv(log, dbc, {"speed_kmh": "Motion.VehicleSpeed"})
        except RouteError as reason:
            text = str(reason)
        assert text.startswith(("time_s,speed_kmh\n", "# repaired: the log was cut", str(tmp_path)))
