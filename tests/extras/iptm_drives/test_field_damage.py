"""Files without a drive, files that were cut, no files: each reader states the cause, and none waits."""

from __future__ import annotations

import gzip
import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.extras.iptm_drives.field_drives import (
    DRIVE,
    ODOMETRY,
    STORE,
    Driven,
    candump,
    columns_of,
    read_log,
    speed_bytes,
    true_speed,
    write_bag,
    write_csv,
    write_dbc,
    write_fcd,
    write_frames,
    write_gpx,
    write_log,
)

from iptm_core.errors import RouteError
from iptm_core.routes.user_csv import read_user_trip, trip_from_columns
from iptm_core.routes.user_trip import UserTrip
from iptm_drives.can_log import read_can_log

NOTHING = DRIVE.but(speeds=np.full(121, np.nan), along_m=np.full(121, np.nan))


def text_file(name: str, text: str) -> Callable[[Path], UserTrip]:
    def read(folder: Path) -> UserTrip:
        (folder / name).write_text(text)
        return read_log(folder / name) if name.endswith(".log") else read_user_trip(folder / name)

    return read


def bag_of(messages: Mapping[str, str]) -> Callable[[Path], UserTrip]:
    from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415

    def read(folder: Path) -> UserTrip:
        with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for topic, kind in messages.items():
                writer.add_connection(topic, kind, typestore=STORE)
        return read_user_trip(folder / "bag")

    return read


def nothing_in(name: str, write: Callable[[Path, Driven], Path]) -> Callable[[Path], UserTrip]:
    return lambda folder: read_user_trip(write(folder / name, NOTHING))


POINT = "<rtept lat='1' lon='2'/>"
NEITHER = "neither speeds nor places"
UNMEASURED = candump(DRIVE.times_s, speed_bytes(NOTHING.speeds))
# fmt: off
WITHOUT_A_DRIVE = {
    "gpx: no point": (text_file("a.gpx", "<gpx/>"), "0 track points"),
    "gpx: no time": (text_file("a.gpx", f"<gpx>{2 * POINT}</gpx>"), "time is missing"),
    "gpx: no place": (nothing_in("a.gpx", write_gpx), NEITHER),
    "csv: no header": (text_file("a.csv", "0,0\n1,2\n"), "are numbers; allowed: a header"),
    "csv: no value": (nothing_in("a.csv", write_csv), NEITHER),
    "library: no value": (lambda _: trip_from_columns(columns_of(NOTHING, places=True)), NEITHER),
    "library: no row": (lambda _: trip_from_columns({"time_s": [], "speed_m_s": []}), "one per row"),
    "fcd: another output": (text_file("a.xml", '<routes><vehicle id="a"/></routes>'), "--fcd-output"),
    "fcd: no value": (nothing_in("a.xml", write_fcd), NEITHER),
    "bag: no odometry": (bag_of({"/chatter": "std_msgs/msg/String"}), r"no odometry .* topics are: /chatter"),
    "bag: no message": (bag_of({"/odom": ODOMETRY}), "0 messages"),
    "bag: no value": (nothing_in("bag", write_bag), NEITHER),
    "can: empty": (text_file("a.log", ""), "0 frames"),
    "can: not available": (text_file("a.log", UNMEASURED), "121 values outside of the range"),
}
# fmt: on


@pytest.mark.parametrize("kind", WITHOUT_A_DRIVE)
def test_k6_nothing_found_has_a_cause(tmp_path: Path, kind: str) -> None:
    read, cause = WITHOUT_A_DRIVE[kind]
    with pytest.raises(RouteError, match=cause) as refusal:
        read(tmp_path)
    assert "\n" not in str(refusal.value)


def packed(write: Callable[[Path, Driven], Path]) -> Callable[[Path, Driven], Path]:
    def to(path: Path, drive: Driven) -> Path:
        content = write(path, drive).read_bytes()
        path.write_bytes(gzip.compress(content))
        return path

    return to


def write_parquet(path: Path, drive: Driven) -> Path:
    pytest.importorskip("pyarrow", reason="requirements/studies.txt is not installed")
    pd.DataFrame(columns_of(drive, places=False)).to_parquet(path)
    return path


def write_storage(path: Path, drive: Driven) -> Path:
    (storage,) = write_bag(path.parent / "bag", drive).glob("*.mcap")
    return storage.rename(path)


FILES: dict[str, Callable[[Path, Driven], Path]] = {
    "a.gpx": write_gpx,
    "a.gpx.gz": packed(write_gpx),
    "a.csv": write_csv,
    "a.csv.gz": packed(write_csv),
    "a.xml": write_fcd,
    "a.xml.gz": packed(write_fcd),
    "a.parquet": write_parquet,
    "a.mcap": write_storage,
    "a.log": write_log,
    "a.asc": write_frames,
    "a.blf": write_frames,
    "a.trc": write_frames,
}
LOGS = (".log", ".asc", ".blf", ".trc")


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=8, deadline=None)
@given(share=st.floats(0.2, 0.98))
def test_k7_what_was_cut_is_reported(name: str, share: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = FILES[name](Path(folder) / name, Driven.at(10.0))
        content = path.read_bytes()
        end = int(share * len(content))
        path.write_bytes(content[:end])
        try:
            trip = read_log(path) if path.suffix in LOGS else read_user_trip(path)
        except RouteError as reason:
            assert str(path) in str(reason)  # noqa: PT017 - reading on is fine, too
            return
    # A table that ends with a whole line, or within its last number, is a shorter table.
    assert trip.notes or (name == "a.csv" and content[:end].splitlines()[-1].count(b",") == 2)
    seconds = trip.cycle.times_s[trip.cycle.times_s < trip.cycle.duration_s - 2.0]
    driven = np.interp(seconds, trip.cycle.times_s, trip.cycle.speeds_m_s)
    np.testing.assert_allclose(driven, true_speed(seconds), atol=0.5)


@pytest.mark.parametrize("name", [*FILES, "a.mf4", "bag"])
@pytest.mark.parametrize("kind", ["missing", "pipe", "folder"])
def test_k8_what_is_no_file_is_refused_at_once(tmp_path: Path, name: str, kind: str) -> None:
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    if kind == "folder":
        path.mkdir()
    with pytest.raises(RouteError, match=r"no such file|not a regular file|no file|cannot be read"):
        read_log(path) if path.suffix in {*LOGS, ".mf4"} else read_user_trip(path)


def test_k8_a_dbc_that_is_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    pytest.importorskip("cantools", reason="requirements/can.txt is not installed")
    dbc = write_dbc(tmp_path)
    dbc.unlink()
    os.mkfifo(dbc)
    with pytest.raises(RouteError, match="no such file"):
        read_can_log(write_log(tmp_path / "a.log", DRIVE), dbc, {"speed_kmh": "Speed"})
