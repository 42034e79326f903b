"""A car whose own cruise control keeps the gap: the plan as its set speed, and cooling in stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from iptm_core.state import Command
from iptm_vehicle_interface.authority import report_frame
from iptm_vehicle_interface.bus import Frame
from iptm_vehicle_interface.driving import Driver
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.gateway import Gateway
from iptm_vehicle_interface.vehicle import load_vehicle

DBC = """VERSION ""

BS_:

BU_: CAR SUITE

BO_ 100 MOTION: 8 CAR
 SG_ speed : 0|16@1+ (0.01,0) [0|300] "kph" SUITE
 SG_ brake : 16|1@1+ (1,0) [0|1] "" SUITE
 SG_ acc_state : 17|3@1+ (1,0) [0|7] "" SUITE

BO_ 200 ACC_SET: 8 SUITE
 SG_ set_speed : 0|16@1+ (0.1,0) [0|250] "kph" CAR
 SG_ takes : 16|1@1+ (1,0) [0|1] "" CAR

BO_ 201 COOLING: 8 SUITE
 SG_ stage : 0|4@1+ (1,0) [0|15] "" CAR
"""
YAML = """description: A car that takes a set speed
parameter_set: bmw_i3
database: car.dbc
signals:
  speed_m_s: {message: MOTION, signal: speed, timeout_s: 0.1}
  brake_pressed: {message: MOTION, signal: brake, timeout_s: 0.1}
  cruise_engaged: {message: MOTION, signal: acc_state, values: [3, 4], timeout_s: 0.1}
commands:
  set_speed: {message: ACC_SET, signal: set_speed, enable: takes}
  compressor: {message: COOLING, signal: stage, inactive: {stage: 0},
    levels: {0: 0, 1500: 1, 3000: 2, -2000: 5}}
protection: {}
limits: {min_acceleration_m_s2: -3.5, max_acceleration_m_s2: 2.0, max_jerk_m_s3: 5.0, max_command_age_s: 0.1,
  reaction_s: 0.5, lead_deceleration_m_s2: 8.0, margin_m: 2.0, max_compressor_power_w: 3000,
  max_set_speed_m_s: 30.0}
"""
BEGINS, BRAKES = 100, 400


@pytest.mark.parametrize(("planned_m_s", "sent_m_s"), [(25.0, 25.0), (35.0, 30.0)])
def test_the_plan_is_the_set_speed_once_a_second_until_the_brake(
    tmp_path: Path, planned_m_s: float, sent_m_s: float
) -> None:
    (tmp_path / "car.dbc").write_text(DBC, "utf-8")
    (tmp_path / "vehicle.yaml").write_text(YAML, "utf-8")
    vehicle = load_vehicle(str(tmp_path))
    assert vehicle.cooling == "in stages"
    driver, gateway, car, judge = (
        Driver(vehicle),
        Gateway(vehicle),
        FrameCodec(vehicle),
        FrameCodec(vehicle),
    )
    sent: list[tuple[int, float, bool]] = []
    cooled: dict[int, float] = {}
    for step in range(500):
        now_s = 1000.0 + 0.02 * step
        on, brakes = BEGINS <= step < BRAKES, step >= BRAKES
        values = {"speed": 72.0, "acc_state": 3.0 * on, "brake": float(brakes)}
        frame_id, data = car.encode("MOTION", values)
        gateway.from_car(frame_id, data, now_s)
        driver.receive(Frame(frame_id, data, now_s))
        driver.receive(Frame(*report_frame(gateway.report), now_s))
        if step % 50 == 0:
            assert driver.measured(now_s, now_s) is not None
            plan = (now_s + np.arange(4.0), np.full(4, planned_m_s), np.zeros(4))
            assert driver.follow(now_s, plan, Command(0.0, 1400.0))
        for frame in driver.step(now_s):
            gateway.from_suite(*frame, now_s)
        for frame in gateway.frames(now_s):
            command = judge.command(*frame)
            assert command is not None
            target, value, enabled = command
            if target is vehicle.set_speed:
                sent.append((step, value, enabled))
            else:
                cooled[step] = value
        assert driver.engagement.is_active is (BEGINS <= step < BRAKES)
    taken = [(step, value) for step, value, enabled in sent if enabled]
    assert [value for _, value in taken] == pytest.approx([sent_m_s] * len(taken), abs=0.02)
    assert np.diff([step for step, _ in taken]).tolist() == [50] * (len(taken) - 1)
    assert taken[0][0] <= BEGINS + 1
    let_go = next(step for step, _, enabled in sent if not enabled and step >= BEGINS)
    assert let_go == BRAKES
    assert {cooled[step] for step in range(BEGINS + 5, BRAKES)} == {1500.0}
    assert {cooled[step] for step in (0, BEGINS - 1, BRAKES, 499)} == {0.0}
