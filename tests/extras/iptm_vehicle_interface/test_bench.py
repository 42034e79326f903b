"""The bench car with the nodes over ROS 2: enabled, braked, killed, stopped, recorded."""

from __future__ import annotations

import json
import os
import signal
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from tests.waiting import wait_until

from iptm_core.state import NS_PER_S
from iptm_ros.codecs import decode_leader_preview, decode_slope
from iptm_ros.recording.bag_reader import BagReader
from iptm_vehicle_interface.authority import (
    BENCH_BUTTON_ID,
    GatewayReport,
    Loss,
    decision_frame,
    report_frame,
)
from iptm_vehicle_interface.bus import LOOPBACK, LOOPBACK_GROUP, BusReader, open_bus, send
from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.drive_record import replayed
from iptm_vehicle_interface.driving import Driver
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.node_bench import (
    BRIDGE,
    CAR,
    CONTROLLER,
    GATEWAY,
    VEHICLE,
    BenchOptions,
    BenchProcesses,
    free_ports,
)

# In real time on whatever machine: what fails is run once more, and listed.
pytestmark = [pytest.mark.integration, pytest.mark.flaky(reruns=1)]
PATIENCE_S = 60.0


class Commands:
    """The commands on the car's bus, as a foreign listener sees them."""

    def __init__(self, processes: BenchProcesses, vehicle: VehicleLink) -> None:
        self._reader = BusReader(open_bus(processes.car_bus))
        self._codec, self._vehicle = FrameCodec(vehicle), vehicle

    def wait_until(self, *, enabled: bool) -> None:
        """Wait until the newest command is enabled, or is not."""
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            for frame in self._reader.taken():
                command = self._codec.command(frame.frame_id, frame.data)
                if command and command[0] is self._vehicle.acceleration and command[2] is enabled:
                    return
            time.sleep(0.01)
        raise AssertionError(f"no command with enabled={enabled} within {PATIENCE_S} s")

    def wait_until_car(self, *, active: bool) -> None:
        """Wait until the car states that it is moved by the suite, or is not."""
        wait_until(lambda: active in self._stated(), what=f"a car with active={active}")

    def _stated(self) -> set[bool]:
        decoded = [self._codec.decode(each.frame_id, each.data) for each in self._reader.taken()]
        return {
            bool(each.values["control_active"])
            for each in decoded
            if "control_active" in each.values
        }

    def ever_enabled(self) -> bool:
        """Return whether any command since the last call was enabled."""
        found = [self._codec.command(each.frame_id, each.data) for each in self._reader.taken()]
        assert any(found)
        return any(command[2] for command in found if command)

    def close(self) -> None:
        self._reader.close()


def test_what_is_no_frame_does_not_end_the_reader(vehicle: VehicleLink) -> None:
    port = free_ports(os.getpid())
    sender, reader = open_bus(f"udp:{port}"), BusReader(open_bus(f"udp:{port}"))
    try:
        until_s = time.monotonic() + PATIENCE_S
        frames = []
        while not (frames and reader.unreadable) and time.monotonic() < until_s:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
                interface = socket.inet_aton(LOOPBACK)
                foreign.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
                foreign.sendto(b"RTPS, not a frame", (LOOPBACK_GROUP, port))
            assert send(sender, *FrameCodec(vehicle).encode("SPEED", {"VehicleSpeed": 50.0}))
            time.sleep(0.05)
            frames += reader.taken()
        assert reader.unreadable
        assert frames
    finally:
        reader.close()
        sender.shutdown()


def test_the_suite_drives_the_car_and_the_brake_ends_it(
    tmp_path: Path, vehicle: VehicleLink
) -> None:
    """The record of the drive, replayed through the interface, gives every sent frame again."""
    events = ("enable_button:5:0.3", "enable_button:8:0.3", "brake_pressed:13:0.5")
    options = BenchOptions(
        duration_s=15.0,
        car=[part for event in events for part in ("--press", event)],
        node={
            "record": str(tmp_path / "record"),
            "capacity_loss_file": str(tmp_path / "losses.json"),
        },
    )
    with BenchProcesses(tmp_path, options) as bench:
        result = bench.result()
    assert result.car["engagements"] == 1
    assert 4.0 < result.car["active_s"] < 8.5
    assert len(result.car["inactive_at_s"]) == 1
    assert result.car["smallest_gap_m"] > 4.0
    assert result.car["rejected_frames"] == 0
    modes = [mode for _, mode, _ in result.suite["changes"]]
    assert modes[:3] == ["ready", "engaged", "ready"]
    assert result.suite["decisions"] >= 8
    assert result.suite["fallbacks"] == 0
    losses = json.loads((tmp_path / "losses.json").read_text("utf-8"))
    assert Driver(vehicle).estimator.capacity_losses < tuple(losses)
    frames = list(replayed(tmp_path / "record", Driver(vehicle)))
    assert len(frames) > 500
    assert all(recorded == computed for _, recorded, computed in frames)


def test_the_bridge_joins_the_radar_with_v2x_and_knows_the_slope(
    tmp_path: Path, vehicle: VehicleLink
) -> None:
    options = BenchOptions(
        slope="large",
        v2x=True,
        duration_s=300.0,
        car=["--press", "enable_button:4:0.3:2"],
        bag=str(tmp_path / "bag"),
    )
    with BenchProcesses(tmp_path, options) as bench:
        commands = Commands(bench, vehicle)
        try:
            until_s = time.monotonic() + 3.0 * PATIENCE_S
            heard = tmp_path / f"{BRIDGE}.log"
            while "predictions arrive" not in heard.read_text("utf-8"):
                assert time.monotonic() < until_s
                time.sleep(0.1)
            commands.wait_until(enabled=True)
        finally:
            commands.close()
        bench.running[CAR].terminate()
        result = bench.result()
    assert result.car["active_s"] > 0.0
    assert result.car["smallest_gap_m"] > 3.0
    with BagReader(tmp_path / "bag") as bag:
        messages = list(bag.messages())
    reached_s = [
        preview.times_s[-1] - stamp_ns / NS_PER_S
        for found in messages
        if found.topic == "/v2x/leader_preview"
        for stamp_ns, preview in [decode_leader_preview(found.message)]
        if preview.times_s.size
    ]
    assert max(reached_s) >= 59.0
    slopes = [decode_slope(found.message) for found in messages if found.topic == "/v2x/slope"]
    assert np.abs(slopes[0].slopes_rad).max() > 0.05
    reports = [
        {value.key: value.value for value in status.values}
        for found in messages
        if found.topic == "/diagnostics"
        for status in found.message.status
    ]
    agreed = [int(report["ticks_agreed"]) for report in reports if "ticks_agreed" in report]
    assert max(agreed) >= 1


ATTACKED_S = 3.0


def attack(bench: BenchProcesses, vehicle: VehicleLink) -> None:
    """Send frames of car and suite on the bus between both for some seconds."""
    port = int(bench.car_bus.split(":")[1])
    attacker, codec = open_bus(f"udp:{port + 1}"), FrameCodec(vehicle)
    try:
        until_s = time.monotonic() + ATTACKED_S
        while time.monotonic() < until_s:
            for frame in (
                codec.encode("PEDALS", {"EnableButton": float(time.monotonic() % 1.0 > 0.5)}),
                (BENCH_BUTTON_ID, b""),
                report_frame(GatewayReport(is_armed=True, is_active=True, loss=Loss.NOT_ENABLED)),
                decision_frame(round(time.monotonic())),
                codec.encode_command(vehicle.acceleration, -3.5, enabled=True),
            ):
                assert send(attacker, *frame)
            time.sleep(0.02)
    finally:
        attacker.shutdown()


FATES = (
    (VEHICLE, signal.SIGKILL),
    (GATEWAY, signal.SIGSTOP),
    (CONTROLLER, signal.SIGSTOP),
    (BRIDGE, signal.SIGKILL),
    (GATEWAY, signal.SIGSTOP),
)


def test_nothing_but_the_driver_engages_and_a_process_that_dies_or_hangs_leaves_the_car_inactive(
    tmp_path: Path, vehicle: VehicleLink
) -> None:
    """Forged frames engage nothing, the button of the car does; then process after process dies or hangs.

    The time that it takes is measured by the study; here it has to happen, until a new enable.
    """
    options = BenchOptions(duration_s=600.0, car=["--press", "enable_button:12:0.3:4"])
    with BenchProcesses(tmp_path, options) as bench:
        commands = Commands(bench, vehicle)
        try:
            attack(bench, vehicle)
            assert not commands.ever_enabled()
            commands.wait_until(enabled=True)
            for name, how in FATES:
                commands.wait_until_car(active=True)
                bench.running[name].send_signal(how)
                if name != GATEWAY:
                    commands.wait_until(enabled=False)
                commands.wait_until_car(active=False)
                if how is signal.SIGKILL:
                    bench.running[name].wait(PATIENCE_S)
                    bench.start(name)
                else:
                    bench.running[name].send_signal(signal.SIGCONT)
        finally:
            commands.close()
        bench.running[CAR].terminate()
        bench.running[CAR].wait(PATIENCE_S)
    car = json.loads((tmp_path / "car.json").read_text("utf-8"))
    assert len(car["inactive_at_s"]) == car["engagements"] >= len(FATES)
    assert car["smallest_gap_m"] > 0.0
