"""Vehicle folders that fit published DBC files: their frames by checkers that are not the project's own.

Vectors were made with the packers of opendbc 0.3.1 (MIT licence, github.com/commaai/opendbc); with the
package installed, its packers make others at random. Check values of CRCs are the ones of the Catalogue of
parametrised CRC algorithms (https://reveng.sourceforge.io/crc-catalogue).
"""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cantools
import numpy as np
import pytest

from iptm_core.errors import MessageError, ParameterError
from iptm_core.state import Command
from iptm_vehicle_interface.bus import Frame
from iptm_vehicle_interface.channel import CommandTarget
from iptm_vehicle_interface.driving import Driver
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.protection import Checksum, ChecksumKind, FrameFault
from iptm_vehicle_interface.vehicle import VEHICLES, available_vehicles, load_vehicle

CARS = ("rivian_r1", "tesla_model_3", "hyundai_ioniq_5")
REQUESTS = ((0.0, False), (-1.0, True), (2.0, True))
VECTORS = {
    "rivian_r1": ("d200800000", "4f01738010", "a302990010"),
    "tesla_model_3": ("d0d2a483bc7b17d2", "d042a483f47a3799", "d042a4834c9d5a37"),
    "hyundai_ioniq_5": (
        "0b83000a003064000400000300080000fff33f1e0a0002000000000000000000",
        "1c4b010a0030640014000003000800009bb3391e320002000000000000000000",
        "1c93020a003064001400000300080000c7744c1e320002000000000000000000",
    ),
}
"""Requests in m/s^2, enabled or not, in this order with counters from 0 on; Tesla at 20 m/s."""


def codec_of(name: str) -> FrameCodec:
    """Return a codec that has heard the own speed of the car, which one of them repeats in its requests."""
    codec = FrameCodec(load_vehicle(name))
    if name == "tesla_model_3":
        codec.decode(*FrameCodec(codec.vehicle).encode("DI_speed", {"DI_vehicleSpeed": 72.0}))
    return codec


@pytest.mark.parametrize(
    ("size", "polynomial", "start", "final", "check"),
    [
        (1, 0x1D, 0x00, 0x00, 0x37),  # CRC-8/GSM-A, Rivian's but for its final value
        (1, 0x1D, 0xFF, 0xFF, 0x4B),  # CRC-8/SAE-J1850
        (1, 0x2F, 0xFF, 0xFF, 0xDF),  # CRC-8/AUTOSAR, Volkswagen's but for its byte by counter
        (
            2,
            0x1021,
            0x0000,
            0x0000,
            0x31C3,
        ),  # CRC-16/XMODEM, Hyundai's but for identifier and final value
    ],
)
def test_crcs_have_the_check_values_of_the_catalogue(
    size: int, polynomial: int, start: int, final: int, check: int
) -> None:
    crc = Checksum(0, size, True, ChecksumKind.CRC, polynomial, start, final)
    assert crc.value(0, bytes(size) + b"123456789", 0) == check


@pytest.mark.parametrize("name", CARS)
def test_requests_are_the_published_frames(name: str) -> None:
    codec = codec_of(name)
    for (value, enabled), expected in zip(REQUESTS, VECTORS[name], strict=True):
        frame_id, data = codec.encode_command(codec.vehicle.motion, value, enabled=enabled)
        assert data.hex() == expected
        found = FrameCodec(codec.vehicle).command(frame_id, data)
        assert found is not None
        assert found[1:] == (pytest.approx(value, abs=0.02), enabled)


def _rivian(value: float, count: int) -> bytes:
    can = importlib.import_module("opendbc.car.rivian.riviancan")
    packer = importlib.import_module("opendbc.can").CANPacker("rivian_primary_actuator")
    return bytes(can.create_longitudinal(packer, count, value, True)[1])


def _tesla(value: float, count: int) -> bytes:
    can = importlib.import_module("opendbc.car.tesla.teslacan")
    packer = importlib.import_module("opendbc.can").CANPacker("tesla_model3_party")
    made = can.TeslaCAN(None, packer).create_longitudinal_command(
        4, value, count % 8, 20.0 - value, True
    )
    return bytes(made[1])


def _hyundai(value: float, count: int) -> bytes:
    can = importlib.import_module("opendbc.car.hyundai.hyundaicanfd")
    packer = importlib.import_module("opendbc.can").CANPacker("hyundai_canfd_generated")
    bus, shown = SimpleNamespace(ECAN=0), SimpleNamespace(leadDistanceBars=3)
    for _ in range(count + 1):
        made = can.create_acc_control(packer, bus, True, value, value, False, False, 0, shown)
    return bytes(made[1])


@pytest.mark.parametrize(
    ("name", "packed"), list(zip(CARS, (_rivian, _tesla, _hyundai), strict=True)), ids=CARS
)
def test_requests_are_those_of_a_foreign_packer(
    name: str, packed: Callable[[float, int], bytes]
) -> None:
    pytest.importorskip("opendbc")
    codec, draws = codec_of(name), np.random.default_rng(3)
    limits = codec.vehicle.limits
    for count in range(40):
        value = draws.uniform(limits.min_acceleration_m_s2, limits.max_acceleration_m_s2)
        _, data = codec.encode_command(codec.vehicle.motion, value, enabled=True)
        assert data.hex() == packed(value, count).hex()


@pytest.mark.parametrize("name", CARS)
def test_frames_of_the_car_are_read_by_a_foreign_reader(name: str) -> None:
    """cantools with the same DBC, and a checksum of its own making by the published algorithm."""
    vehicle = load_vehicle(name)
    draws = np.random.default_rng(1)
    for path in (VEHICLES / name).glob("*.dbc"):
        foreign = cantools.database.load_file(path)
        sender, receiver = FrameCodec(vehicle), FrameCodec(vehicle)
        for message in foreign.messages:
            if message.name == vehicle.motion.message:
                continue
            protection = vehicle.protections.get(message.name)
            own = {protection.counter, "CHECKSUM"} if protection else set()
            for count in range(40):
                wanted = {
                    signal.name: float(
                        draws.integers(0, 1 << min(signal.length - 1, 6)) * signal.scale
                        + signal.offset
                    )
                    for signal in message.signals
                    if signal.name not in own and "Checksum" not in signal.name
                }
                frame_id, data = sender.encode(message.name, wanted)
                read = foreign.decode_message(frame_id, data)
                assert {key: read[key] for key in wanted} == pytest.approx(wanted)
                if protection:
                    assert read[protection.counter] == count % protection.modulo
                    assert_checksum(name, frame_id, data, read)
                number = vehicle.buses[message.name]
                assert receiver.decode(frame_id, data, number).fault is None


def assert_checksum(name: str, frame_id: int, data: bytes, read: Any) -> None:
    """Compare the checksum of a frame with the algorithm as it is published, bit by bit."""
    stated = [value for key, value in read.items() if "checksum" in key.lower()]
    if not stated:
        return
    if name == "tesla_model_3":
        rest = sum(data) - stated[0]
        assert stated[0] == ((frame_id & 0xFF) + (frame_id >> 8) + rest) & 0xFF
    elif name == "rivian_r1":
        finals = {0x150: 0x9A, 0x208: 0xB1, 0x162: 0xD1}
        assert stated[0] == division(data[1:], 8, 0x1D) ^ finals[frame_id]
    else:
        covered = data[2:] + frame_id.to_bytes(2, "little")
        assert stated[0] == division(covered, 16, 0x1021) ^ {24: 0x819D, 32: 0x9F5B}[len(data)]


def division(data: bytes, bits: int, polynomial: int) -> int:
    """Return the remainder of a polynomial division."""
    value = int.from_bytes(data, "big") << bits
    divisor = 1 << bits | polynomial
    for place in range(8 * len(data) - 1, -1, -1):
        if value >> (place + bits) & 1:
            value ^= divisor << place
    return value


@pytest.mark.parametrize("name", CARS)
def test_a_car_drives_in_shadow_on_its_frames(name: str) -> None:
    """Speed, pedals and the enabling of each; on another bus or with another checksum nothing counts."""
    vehicle = load_vehicle(name)
    driver, car = Driver(vehicle), FrameCodec(vehicle)
    states = {
        "rivian_r1": (
            ("ESP_Status", "ESP_Vehicle_Speed"),
            ("ACM_Status", "ACM_FeatureStatus", 1.0),
        ),
        "tesla_model_3": (("DI_speed", "DI_vehicleSpeed"), ("DI_state", "DI_cruiseState", 2.0)),
        "hyundai_ioniq_5": (
            ("WHEEL_SPEEDS", "WHL_SpdFLVal"),
            ("CRUISE_BUTTONS", "CRUISE_BUTTONS", 2.0),
        ),
    }
    (moves, speed), (enables, signal, on) = states[name]
    brake = vehicle.signals["brake_pressed"]
    for step in range(300):
        now_s = 1000.0 + 0.02 * step
        is_on = step == 100 or (step > 100 and "cruise_engaged" in vehicle.signals)
        values = {
            moves: {speed: 72.0},
            enables: {signal: on * is_on},
            brake.message: {brake.signal: 1.0} if name == "tesla_model_3" else {},
            vehicle.signals["accelerator_pressed"].message: {},
        }
        for message, each in values.items():
            frame_id, data = car.encode(message, each)
            number = vehicle.buses[message]
            if vehicle.protections.get(message) and vehicle.protections[message].checksum:
                broken = bytes([data[0] ^ 1]) + data[1:]
                assert car.decode(frame_id, broken, number).fault is FrameFault.CHECKSUM
            assert driver.receive(Frame(frame_id, data, now_s, number + 1)) != message
            assert driver.receive(Frame(frame_id, data, now_s, number)) == message
        if step % 50 == 0:
            assert driver.measured(now_s, now_s) is not None
            plan = (now_s + np.arange(4.0), np.full(4, 20.0), np.zeros(4))
            assert driver.follow(now_s, plan, Command(0.0, 0.0))
        frames = driver.step(now_s)
        assert driver.engagement.is_active is (step >= 100)
    codec = FrameCodec(vehicle)
    command = codec.command(*frames[0])
    assert command is not None
    assert command[1:] == (pytest.approx(0.0, abs=0.05), True)
    assert driver.signals.value("speed_m_s", now_s) == pytest.approx(20.0, abs=0.02)


def test_every_folder_is_short_and_states_its_source() -> None:
    for name in available_vehicles():
        text = (VEHICLES / name / "vehicle.yaml").read_text("utf-8")
        assert text.count("\n") <= 30
        assert name == "bench" or ("opendbc 0.3.1 (MIT licence)" in text and "Never driven" in text)


@pytest.mark.parametrize(
    ("name", "old", "new", "why"),
    [
        ("rivian_r1", "kind: crc", "kind: md5", "kind is 'md5'; allowed: sum"),
        ("rivian_r1", "polynomial: 0x1D, final: 0xB1", "final: 1", "polynomial is None; allowed"),
        ("rivian_r1", "0x1D, final: 0xB1", "0x1D, final: 0x1B1", "final is '0x1B1'; allowed: 0 to"),
        ("rivian_r1", "modulo: 15, checksum: ESP", "modulo: 17, checksum: ESP", "modulo is 17; allowed: 2"),
        ("rivian_r1", "counter: ESP_Status_Counter", "counter: ESP_Counter", "counter is 'ESP_Counter'"),
        ("rivian_r1", "checksum: ESP_Status_Checksum", "checksum: ESP_Vehicle_Speed_Q", "whole bytes"),
        ("rivian_r1", "rivian.dbc, rivian_camera.dbc", "rivian.dbc", "message is 'ACM_Status'"),
        ("rivian_r1", "rivian_camera.dbc", "rivian.dbc", "allowed: .* in one of them"),
        ("rivian_r1", "values: [1]", "values: on", "values is 'on'; allowed: a list"),
        ("tesla_model_3", "signal: DI_vehicleSpeed,", "signal: DI_speedCounter,", "allowed: one in 'm/s'"),
        ("tesla_model_3", "DI_speed.DI_vehicleSpeed", "DI_speed.DI_speed", "'DI_speed.DI_speed'; allowed"),
        ("tesla_model_3", "inactive: {DAS_accState: 13}", "inactive: {DAS_accState: 4}", "another value"),
        ("tesla_model_3", "fixed: {DAS_jerkMin", "fixed: {DAS_jerk", "fixed is .*; allowed"),
        ("hyundai_ioniq_5", "hold: StopReq", "hold: Stop", "hold is 'Stop'; allowed: one of SCC_CONTROL"),
        ("hyundai_ioniq_5", "  acceleration: {message", "  set_speed: {message", "allowed: one in 'm/s'"),
        ("hyundai_ioniq_5", "identifier: true, final: 0x9F5B", "identifier: 1", "identifier is 1"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(
    tmp_path: Path, name: str, old: str, new: str, why: str
) -> None:
    folder = tmp_path / name
    shutil.copytree(VEHICLES / name, folder)
    path = folder / "vehicle.yaml"
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ParameterError, match=why) as caught:
        load_vehicle(str(folder))
    assert "\n" not in str(caught.value)


def test_a_byte_by_counter_and_a_sum_with_a_start() -> None:
    """Volkswagen's ACC_06 and Toyota's ACC_CONTROL, by opendbc 0.3.1's functions."""
    by_counter = bytes.fromhex("377DF3A91846 6D4D3D71929CE53210B9")
    volkswagen = Checksum(
        0, 1, True, ChecksumKind.CRC, 0x2F, 0xFF, 0xFF, by_counter=tuple(by_counter)
    )
    assert volkswagen.value(0x122, bytes.fromhex("00056A1200FF0340"), 5) == 0xC6
    toyota = Checksum(7, 1, False, ChecksumKind.SUM, start=8, has_identifier=True)
    assert toyota.value(0x343, bytes.fromhex("FE1A634000C10000"), 0) == 0xCA


def test_thermal_commands_in_stages() -> None:
    """Off, cooling and preheating as values of a signal; the nearest to the planned power counts."""
    target = CommandTarget(
        "HVAC", "Mode", levels={0.0: 0.0, 1500.0: 1.0, 3000.0: 2.0, -2000.0: 5.0}
    )
    assert [target.from_si(power_w) for power_w in (0.0, 700.0, 800.0, 9000.0, -1500.0)] == [
        0,
        0,
        1,
        2,
        5,
    ]
    assert [target.to_si(value) for value in (0.0, 1.0, 2.0, 5.0)] == [0.0, 1500.0, 3000.0, -2000.0]


def test_hold_and_resume_are_set_at_a_standstill_alone() -> None:
    codec = codec_of("hyundai_ioniq_5")
    message = codec.vehicle.messages["SCC_CONTROL"]
    for value, enabled, standing, holds in (
        (-0.5, True, True, 1),
        (-0.5, True, False, 0),
        (0.5, True, True, 0),
        (-0.5, False, True, 0),
    ):
        target = codec.vehicle.motion
        _, data = codec.encode_command(target, value, enabled=enabled, standing=standing)
        assert message.decode(data)["StopReq"] == holds


def test_a_command_that_cannot_be_sent_is_an_error_of_the_message() -> None:
    codec = codec_of("tesla_model_3")
    with pytest.raises(MessageError, match="DI_speed cannot carry"):
        codec.encode("DI_speed", {"DI_vehicleSpeed": 400.0})
