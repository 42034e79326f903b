"""Logs of CAN buses as the field writes them, of one drive: read as it was, or refused for what is wrong."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from tests.extras.iptm_drives.field_drives import (
    Driven,
    candump,
    is_the_drive,
    read_log,
    speed_bytes,
    true_speed,
    write_frames,
    write_log,
)

from iptm_core.errors import RouteError

FAST = Driven.at(10.0)


def test_logs_of_candump(tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.log", FAST)
    is_the_drive(read_log(log), silent=True)
    text = log.read_text()
    log.write_text(text[:-5])
    is_the_drive(read_log(log), "the last line of the log is cut")
    log.write_text(text.replace(" 100#", " garbage ", 1))
    is_the_drive(read_log(log), "lines without a frame left out: 1, the first is line 1")
    (tmp_path / "a.log.gz").write_bytes(gzip.compress(text.encode()))
    is_the_drive(read_log(tmp_path / "a.log.gz"), silent=True)
    shown = "".join(
        f" ({at:.6f})  can0  100   [8]  {data.hex(' ').upper()}\n"
        for at, data in zip(FAST.times_s, speed_bytes(FAST.speeds), strict=True)
    )
    log.write_text(shown)
    is_the_drive(read_log(log), silent=True)


def test_frames_that_are_short_absent_or_of_others(tmp_path: Path) -> None:
    log, times, data = tmp_path / "a.log", FAST.times_s, speed_bytes(FAST.speeds)
    log.write_text(candump(times, (each[:4] for each in data)))
    is_the_drive(read_log(log), silent=True)
    log.write_text(candump(times, (each[:1] for each in data)))
    with pytest.raises(
        RouteError, match=r"Motion \(0x100, 1 bytes long, in the DBC 8\).* 0 samples"
    ):
        read_log(log)
    log.write_text(candump(times, data, number="123"))
    with pytest.raises(RouteError, match=r"1201 frames, 0 of them of Motion"):
        read_log(log)
    first = np.where(times < 2.0, np.nan, FAST.speeds)
    log.write_text(candump(times, speed_bytes(first)))
    is_the_drive(read_log(log), "speed_kmh outside of the range of the DBC at 20 frames")
    both = candump(times, data) + candump(times, speed_bytes(1.05 * FAST.speeds), bus="can1")
    log.write_text("".join(sorted(both.splitlines(keepends=True))))
    with pytest.raises(RouteError, match="Motion is sent on or by can0, can1; allowed"):
        read_log(log)
    is_the_drive(read_log(log, channel="can0"), silent=True)
    with pytest.raises(RouteError, match="not on 'can7'; allowed: can0, can1"):
        read_log(log, channel="can7")


def test_j1939_by_its_group(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    raw = [b"\xff" + round(256 * 3.6 * v).to_bytes(2, "little") + b"\xff" * 5 for v in FAST.speeds]
    one = candump(FAST.times_s, raw, number="18FEF100")
    log.write_text(one)
    signals = {"speed_kmh": "WheelSpeed"}
    is_the_drive(read_log(log, signals), "CCVS is from 0x00, by its PGN")
    other = candump(FAST.times_s + 0.01, raw, number="0CFEF111")
    log.write_text("".join(sorted((one + other).splitlines(keepends=True))))
    with pytest.raises(RouteError, match="can0, 0x00, 0x11; allowed"):
        read_log(log, signals)
    is_the_drive(read_log(log, signals, "0x00"), "from 0x00, 0x11")


def test_units_of_a_dbc_bind(tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.log", FAST)
    with pytest.raises(RouteError, match=r"unit of Speed is km/h, .* allowed: speed_kmh=Speed"):
        read_log(log, {"speed_m_s": "Speed"})


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_bytes_in_the_other_order(tmp_path: Path, rate_hz: float) -> None:
    drive = Driven.at(rate_hz)
    turned = [data[1::-1] + data[2:] for data in speed_bytes(drive.speeds)]
    log = tmp_path / "a.log"
    log.write_text(candump(drive.times_s, turned))
    with pytest.raises(RouteError, match=r"Motion.Speed .* its bytes in the other order"):
        read_log(log)


def asc(blocks: list[tuple[np.ndarray, np.ndarray]], kind: str = "absolute") -> str:
    text = f"date Mon May 4 07:30:00.000 am 2026\nbase hex timestamps {kind}\nno internal events logged\n"
    for times, speeds in blocks:
        stamps = np.diff(times, prepend=0.0) if kind == "relative" else times
        frames = zip(stamps, speed_bytes(speeds), strict=True)
        rows = [f"{at:.6f} 1 100 Rx d 8 {data.hex(' ').upper()}" for at, data in frames]
        head = "Begin TriggerBlock Mon May 4 07:30:00.000 am 2026"
        text += "\n".join([head, *rows, "End TriggerBlock", ""])
    return text


def test_logs_in_asc(tmp_path: Path) -> None:
    log, times = tmp_path / "a.asc", FAST.times_s
    for kind in ("absolute", "relative"):
        log.write_text(asc([(times, FAST.speeds)], kind))
        is_the_drive(read_log(log), silent=True)
    whole = log.read_text()
    log.write_text(whole[: len(whole) * 2 // 3])
    trip = read_log(log)
    assert "the log was cut short" in "; ".join(trip.notes)
    half = times < 60.0
    again = [(times[half], true_speed(times[half])), (times[half], true_speed(60.0 + times[half]))]
    log.write_text(asc(again))
    with pytest.raises(RouteError, match=r"frame 60\d: time is 59.* another recording begins"):
        read_log(log)


@pytest.mark.parametrize("suffix", [".blf", ".trc", ".csv", ".asc"])
def test_logs_of_python_can(tmp_path: Path, suffix: str) -> None:
    is_the_drive(read_log(write_frames(tmp_path / f"a{suffix}", Driven.at(100.0))), silent=True)
