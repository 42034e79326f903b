"""The bench in steps, which real time is compared with, and the car whose DBC is another one."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("cantools", reason="requirements/can.txt is not installed")
pytest.importorskip("can", reason="requirements/can.txt is not installed")

from studies.vehicle.bench import other_dbc
from studies.vehicle.in_steps import BenchInSteps

from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.vehicle import load_vehicle


def test_the_suite_drives_the_bench_in_steps_and_twice_the_same() -> None:
    pressed_s, held_s, end_s = 4.0, 0.3, 14.0
    press = ("enable_button", pressed_s, held_s, 10.0)
    logs = [BenchInSteps("us06", "reference", press).drive(end_s) for _ in range(2)]
    assert logs[0] == logs[1]
    assert logs[0]["engagements"] == 1
    # It arms when the button is released.
    assert logs[0]["active_s"] == pytest.approx(end_s - pressed_s - held_s, abs=0.1)
    assert logs[0]["oldest_command_s"] <= 0.03
    assert logs[0]["smallest_gap_m"] > 3.0
    assert 15.0 < logs[0]["distance_m"] < 40.0


def test_frames_of_the_other_dbc_have_no_use(tmp_path: Path) -> None:
    other: VehicleLink = load_vehicle(str(other_dbc(tmp_path)))
    frame = FrameCodec(other).encode("SPEED", {"VehicleSpeed": 50.0})
    assert FrameCodec(other).decode(*frame).message == "SPEED"
    assert FrameCodec(load_vehicle("bench")).decode(*frame).message == ""
