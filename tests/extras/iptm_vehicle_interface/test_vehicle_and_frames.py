"""A vehicle from its folder, refusals of a malformed one, and frames with counter and checksum."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from iptm_core.decision_record import DrivingMode
from iptm_core.errors import MessageError, ParameterError
from iptm_core.state import Command
from iptm_vehicle_interface.authority import report_frame
from iptm_vehicle_interface.bus import Frame
from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.driving import Driver
from iptm_vehicle_interface.frames import FrameCodec, RangeWatch, SignalTable
from iptm_vehicle_interface.gateway import Gateway
from iptm_vehicle_interface.protection import FrameFault
from iptm_vehicle_interface.vehicle import VEHICLES, load_vehicle

OTHER_DBC = """VERSION ""

BS_:

BU_: CAR SUITE

BO_ 1168 ESP: 8 CAR
 SG_ v_mph : 7|16@0+ (0.01,0) [0|200] "mph" SUITE
 SG_ brake : 16|1@1+ (1,0) [0|1] "" SUITE
 SG_ set : 17|1@1+ (1,0) [0|1] "" SUITE

BO_ 1200 REQUEST: 4 SUITE
 SG_ a_req : 7|16@0- (0.001,0) [-8|8] "m/s^2" CAR
 SG_ a_on : 16|1@1+ (1,0) [0|1] "" CAR
"""
OTHER_YAML = """description: Another car
parameter_set: bmw_i3
database: other.dbc
signals:
  speed_m_s: {message: ESP, signal: v_mph, timeout_s: 0.2}
  brake_pressed: {message: ESP, signal: brake, timeout_s: 0.2}
  enable_button: {message: ESP, signal: set, timeout_s: 0.2}
commands:
  acceleration: {message: REQUEST, signal: a_req, enable: a_on}
protection: {}
limits: {min_acceleration_m_s2: -2.0, max_acceleration_m_s2: 1.5, max_jerk_m_s3: 3.0,
  max_command_age_s: 0.1, reaction_s: 0.5, lead_deceleration_m_s2: 7.0,
  margin_m: 2.0, max_compressor_power_w: 0.0}
"""


@pytest.fixture
def other(tmp_path: Path) -> Path:
    (tmp_path / "other.dbc").write_text(OTHER_DBC, encoding="utf-8")
    (tmp_path / "vehicle.yaml").write_text(OTHER_YAML, encoding="utf-8")
    return tmp_path


def test_a_second_vehicle_is_a_folder(other: Path) -> None:
    """Big-endian signals in mph and no protection, without a line of code."""
    vehicle = load_vehicle(str(other))
    codec = FrameCodec(vehicle)
    frame_id, data = FrameCodec(vehicle).encode("ESP", {"v_mph": 60.0, "brake": 1.0})
    decoded = codec.decode(frame_id, data)
    assert decoded.values["speed_m_s"] == pytest.approx(26.8224)
    assert decoded.values["brake_pressed"] == 1.0
    frame_id, data = codec.encode_command(vehicle.acceleration, -1.5, enabled=True)
    assert frame_id == 1200
    assert int.from_bytes(data[:2], "big", signed=True) == -1500
    assert vehicle.compressor is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "signal: v_mph",
            "signal: v_kmh",
            r"signal is 'v_kmh'; allowed: one of ESP: brake, set, v_mph",
        ),
        (
            "message: ESP, signal: brake",
            "message: BCM, signal: brake",
            r"message is 'BCM'; allowed",
        ),
        ("enable: a_on", "enable: a_off", r"allowed: one of REQUEST: a_on, a_req"),
        (", enable: a_on", "", r"enable is None|enable.*allowed: the signal that is 1"),
        ("parameter_set: bmw_i3", "parameter_set: bmw_i4", r"parameter_set is 'bmw_i4'; allowed"),
        ("min_acceleration_m_s2: -2.0", "min_acceleration_m_s2: 2.0", r"is 2\.0; allowed: -10 to"),
        ("  brake_pressed", "  brakes_pressed", r"unknown signal 'brakes_pressed'; did you mean"),
        (
            "v_mph, timeout_s: 0.2",
            "brake, timeout_s: 0.2",
            r"the DBC states None|the DBC states ''",
        ),
        ("other.dbc", "none.dbc", r"no such file; allowed: a DBC"),
        (
            "  enable_button: {message: ESP, signal: set, timeout_s: 0.2}\n",
            "",
            r"enable_button is None; allowed: enable_button or cruise_engaged: only the driver",
        ),
    ],
)
def test_a_malformed_vehicle_is_refused(other: Path, old: str, new: str, message: str) -> None:
    path = other / "vehicle.yaml"
    path.write_text(OTHER_YAML.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ParameterError, match=message):
        load_vehicle(str(other))


def test_an_unknown_vehicle_names_the_known_ones() -> None:
    with pytest.raises(ParameterError, match="vehicle is 'model_t'; allowed: bench"):
        load_vehicle("model_t")


def test_the_shipped_folder_is_all_that_a_vehicle_needs(
    tmp_path: Path, vehicle: VehicleLink
) -> None:
    shutil.copytree(VEHICLES / "bench", tmp_path / "mine")
    assert load_vehicle(str(tmp_path / "mine")).limits == vehicle.limits


def test_values_survive_within_their_resolution(vehicle: VehicleLink) -> None:
    sender, receiver = FrameCodec(vehicle), FrameCodec(vehicle)
    frame = sender.encode("SPEED", {"VehicleSpeed": 87.654, "Acceleration": -1.234})
    values = receiver.decode(*frame).values
    assert values["speed_m_s"] == pytest.approx(87.654 / 3.6, abs=0.005 / 3.6)
    assert values["acceleration_m_s2"] == pytest.approx(-1.234, abs=0.005)
    thermal = receiver.decode(*sender.encode("THERMAL", {"LowestCellTemperature": -12.3})).values
    assert thermal["lowest_cell_temperature_k"] == pytest.approx(260.85, abs=0.05)


def test_every_flipped_bit_of_a_protected_frame_is_noticed(vehicle: VehicleLink) -> None:
    frame_id, data = FrameCodec(vehicle).encode("SPEED", {"VehicleSpeed": 50.0})
    used = [*range(32), *range(56, 64)]
    for bit in used:
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        assert FrameCodec(vehicle).decode(frame_id, bytes(changed)).fault is FrameFault.CHECKSUM


def test_a_repeated_or_short_frame_does_not_count(vehicle: VehicleLink) -> None:
    sender, receiver = FrameCodec(vehicle), FrameCodec(vehicle)
    frame_id, data = sender.encode("SPEED", {"VehicleSpeed": 50.0})
    assert receiver.decode(frame_id, data).fault is None
    assert receiver.decode(frame_id, data).fault is FrameFault.COUNTER
    assert receiver.decode(frame_id, data[:4]).fault is FrameFault.LENGTH
    assert receiver.decode(0x7FF, b"").message == ""


def test_a_value_outside_of_the_range_of_the_dbc_is_missing(vehicle: VehicleLink) -> None:
    message = vehicle.messages["BATTERY"]
    data = message.encode(
        {"PackVoltage": 350.0, "PackCurrent": 20.0, "StateOfCharge": 102.3}, strict=False
    )
    values = FrameCodec(vehicle).decode(message.frame_id, data).values
    assert "state_of_charge" not in values
    assert values["pack_voltage_v"] == pytest.approx(350.0)


def test_a_command_with_a_wrong_checksum_is_refused(vehicle: VehicleLink) -> None:
    frame_id, data = FrameCodec(vehicle).encode_command(vehicle.acceleration, 1.0, enabled=True)
    changed = data[:1] + bytes([data[1] ^ 1]) + data[2:]
    with pytest.raises(MessageError, match="ACC_COMMAND: wrong checksum"):
        FrameCodec(vehicle).command(frame_id, changed)


def test_ages_and_timeouts(vehicle: VehicleLink) -> None:
    table = SignalTable(vehicle.signals)
    names = ("speed_m_s", "gap_m", "no_such_signal")
    assert table.stale(names, 0.0) == ("speed_m_s", "gap_m")
    table.take({"speed_m_s": 10.0}, 1.0)
    assert table.value("speed_m_s", 1.09) == 10.0
    assert table.age_s("speed_m_s", 1.05) == pytest.approx(0.05)
    assert table.stale(names, 1.11) == ("speed_m_s", "gap_m")


def test_a_second_vehicle_drives_without_another_line(other: Path) -> None:
    """Speed, brake, a button and a request are all that it has: no radar, no pack, no compressor.

    The button engages, the request follows the plan within the limits of its folder, and the brake ends it.
    """
    lines = [line for path in other.iterdir() for line in path.read_text("utf-8").splitlines()]
    assert len(lines) <= 200
    vehicle = load_vehicle(str(other))
    driver, gateway = Driver(vehicle), Gateway(vehicle)
    car, judge = FrameCodec(vehicle), FrameCodec(vehicle)
    received: list[tuple[float, bool]] = []
    for step in range(200):
        now_s = 1000.0 + 0.02 * step
        pressed = {"brake": float(step >= 180), "set": float(step == 60)}
        values = {"v_mph": 45.0, **pressed}
        frame_id, data = car.encode("ESP", values)
        assert gateway.from_car(frame_id, data, now_s)
        driver.receive(Frame(frame_id, data, now_s))
        driver.receive(Frame(*report_frame(gateway.report), now_s))
        if step % 50 == 0:
            observed = driver.measured(now_s, now_s)
            assert observed is not None
            nodes = now_s + np.arange(4.0)
            plan = (nodes, 20.0 + 0.5 * np.arange(4.0), np.full(4, 0.5))
            assert driver.follow(now_s, plan, Command(0.5, 0.0))
        for frame in driver.step(now_s):
            gateway.from_suite(*frame, now_s)
        for frame in gateway.frames(now_s):
            command = judge.command(*frame)
            assert command is not None
            received.append(command[1:])
    assert not any(enabled for _, enabled in received[:60])
    assert all(enabled for _, enabled in received[62:180])
    assert received[179][0] == pytest.approx(0.5, abs=0.3)
    assert all(value <= 1.5 for value, _ in received)
    assert received[181:] == [(0.0, False)] * (len(received) - 181)


@pytest.mark.parametrize("inactive_from_s", [0.0, 2.0])
def test_a_car_that_stays_inactive_ends_the_engagement(
    vehicle: VehicleLink, inactive_from_s: float
) -> None:
    """From the enable on, or in the middle of a drive: the suite hands over and needs a new enable."""
    driver, car = Driver(vehicle), FrameCodec(vehicle)
    modes: list[DrivingMode] = []
    for step in range(200):
        now_s = 1000.0 + 0.02 * step
        active = driver.engagement.is_active and 0.02 * step < inactive_from_s
        for message, values in (
            ("SPEED", {"VehicleSpeed": 72.0}),
            ("PEDALS", {"ControlActive": float(active)}),
            ("BATTERY", {"PackVoltage": 350.0}),
            ("THERMAL", {"LowestCellTemperature": 25.0, "HighestCellTemperature": 26.0}),
            ("RADAR", {}),
        ):
            driver.receive(Frame(*car.encode(message, values), now_s))
        if step % 50 == 0:
            assert driver.measured(now_s, now_s) is not None
            nodes = now_s + np.arange(4.0)
            assert driver.follow(now_s, (nodes, np.full(4, 20.0), np.zeros(4)), Command(0.0, 0.0))
        if step == 10:
            driver.press("enable_button", now_s)
        driver.step(now_s)
        modes.append(driver.engagement.mode)
    ended = modes.index(DrivingMode.HAND_OVER)
    begun = modes.index(DrivingMode.ENGAGED)
    assert 0.02 * (ended - begun) == pytest.approx(max(inactive_from_s - 0.2, 0.3), abs=0.06)
    assert any("does not act on requests" in reason for _, _, reason in driver.log.changes)
    assert DrivingMode.ENGAGED not in modes[ended:]


@pytest.mark.parametrize(
    ("gap_m", "relative_m_s", "speed_m_s", "frozen_after_s"),
    [
        # Closing with 3 m/s, 0.3 m are missing after 0.1 s; with hardly any relative speed after 2 s.
        (40.0, -3.0, 20.0, 0.1),
        (40.0, 0.02, 20.0, 2.0),
        (5.0, 0.0, 0.0, math.inf),
    ],
)
def test_a_range_sensor_that_repeats_itself_is_noticed(
    gap_m: float, relative_m_s: float, speed_m_s: float, frozen_after_s: float
) -> None:
    watch = RangeWatch()
    found = [watch.is_frozen(gap_m, relative_m_s, speed_m_s, 0.02 * step) for step in range(200)]
    first = found.index(True) * 0.02 if True in found else math.inf
    assert first == pytest.approx(frozen_after_s, abs=0.03)


def test_a_range_sensor_with_noise_is_not_frozen() -> None:
    watch, random = RangeWatch(), np.random.default_rng(0)
    for step in range(500):
        gap_m = 0.05 * round(float(random.normal(40.0, 0.1)) / 0.05)
        relative = 0.02 * round(float(random.normal(0.0, 0.05)) / 0.02)
        for repeated in range(3):  # 20 Hz, seen at 50 Hz
            assert not watch.is_frozen(gap_m, relative, 20.0, 0.06 * step + 0.02 * repeated)


def test_with_the_dbc_of_another_car_nothing_is_ever_ready(
    other: Path, vehicle: VehicleLink
) -> None:
    driver, car = Driver(load_vehicle(str(other))), FrameCodec(vehicle)
    for step in range(100):
        now_s = 0.02 * step
        for message in ("SPEED", "PEDALS", "RADAR"):
            driver.receive(Frame(*car.encode(message, {}), now_s))
        driver.press("enable_button", now_s)
        driver.step(now_s)
    assert driver.engagement.mode is DrivingMode.OFF
    assert "no fresh speed_m_s" in driver.hindrance(2.0)
