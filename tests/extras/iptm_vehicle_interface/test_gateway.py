"""The gateway with a clock that is passed in: silence, pedals, frozen counters, and what reaches the car."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from iptm_vehicle_interface.authority import BENCH_BUTTON_ID, GatewayReport, Loss, decision_frame
from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.gateway import PERIOD_S, Gateway


class Bench:
    """Both ends of a gateway, in steps of its period."""

    def __init__(self, vehicle: VehicleLink, speed_m_s: float = 20.0) -> None:
        self.vehicle, self.gateway, self.speed_m_s = vehicle, Gateway(vehicle), speed_m_s
        self.car, self.suite, self.judge = (
            FrameCodec(vehicle),
            FrameCodec(vehicle),
            FrameCodec(vehicle),
        )
        self.now_s, self.decisions, self.sent_frames = 100.0, 0, 0
        self.press()

    def press(self) -> None:
        """Let the driver press and release the button, and the suite let go before."""
        self.let_go()
        for pressed in (False, True, False):
            self.step(None, button=pressed)

    def let_go(self) -> None:
        """Send a request that leaves the car to its driver."""
        frame = self.suite.encode_command(self.vehicle.acceleration, 0.0, enabled=False)
        self.gateway.from_suite(*frame, self.now_s)

    def step(
        self,
        wanted: float | None = 0.0,
        *,
        speed_m_s: float | None = None,
        gap_m: float = 100.0,
        relative_m_s: float | None = 0.0,
        brake: bool = False,
        accelerator: bool = False,
        cancel: bool = False,
        fault: bool = False,
        button: bool = False,
        confirms: bool = True,
        decides: bool = True,
    ) -> tuple[float, bool]:
        """Run one period; None for a silent suite. Return what reaches the car."""
        self.now_s += PERIOD_S
        pedals = {
            "BrakePressed": brake,
            "AcceleratorPressed": accelerator,
            "EnableButton": button,
            "CancelButton": cancel,
            "VehicleFault": fault,
            "ControlActive": confirms and self.gateway.report.is_active,
        }
        for message, values in (
            ("SPEED", {"VehicleSpeed": 3.6 * (speed_m_s or self.speed_m_s)}),
            ("PEDALS", {name: float(value) for name, value in pedals.items()}),
        ):
            assert self.gateway.from_car(*self.car.encode(message, values), self.now_s)
        self.gateway.from_car(*self._radar(gap_m, relative_m_s), self.now_s)
        self.decisions += decides
        self.gateway.from_suite(*decision_frame(self.decisions), self.now_s)
        if wanted is not None:
            frame = self.suite.encode_command(self.vehicle.acceleration, wanted, enabled=True)
            self.gateway.from_suite(*frame, self.now_s)
        sent = self.gateway.frames(self.now_s)
        self.sent_frames = len(sent)
        command = self.judge.command(*sent[0])
        assert command is not None
        return command[1], command[2]

    def _radar(self, gap_m: float, relative_m_s: float | None) -> tuple[int, bytes]:
        """Return a frame of the range sensor; None for a relative speed that is not available."""
        values = {"TargetValid": 1.0, "Distance": gap_m, "RelativeSpeed": relative_m_s or 0.0}
        frame_id, data = self.car.encode("RADAR", values)
        if relative_m_s is None:
            message = self.vehicle.messages["RADAR"]
            raw = message.decode(data) | {"RelativeSpeed": -81.92}
            checksum = self.vehicle.protections["RADAR"].checksum
            assert checksum is not None
            data = checksum.put(frame_id, message.encode(raw, strict=False), int(raw["Counter"]))
        return frame_id, data


def test_a_command_passes_within_the_rate(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    sent = [bench.step(1.0) for _ in range(30)]
    assert all(enabled for _, enabled in sent)
    assert [round(value, 2) for value, _ in sent[:3]] == [0.04, 0.08, 0.12]
    assert sent[-1] == (1.0, True)


def test_a_silent_suite_makes_the_car_inactive_in_time(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    for _ in range(5):
        bench.step(-1.0)
    silent = [bench.step(None) for _ in range(10)]
    active = [enabled for _, enabled in silent].index(False)
    assert active * PERIOD_S <= vehicle.limits.max_command_age_s
    assert not any(enabled for _, enabled in silent[active:])


def test_a_command_expires_between_two_frames(vehicle: VehicleLink) -> None:
    """Not up to a period later."""
    bench = Bench(vehicle)
    assert bench.step(-1.0)[1]
    at_s, oldest_s = bench.now_s, vehicle.limits.max_command_age_s
    assert not bench.gateway.has_expired(at_s + oldest_s - 1e-6)
    assert bench.gateway.has_expired(at_s + oldest_s + 1e-6)
    command = bench.judge.command(*bench.gateway.frames(at_s + oldest_s + 1e-6)[0])
    assert command is not None
    assert not command[2]
    assert not bench.gateway.has_expired(at_s + 1.0)


def test_letting_go_is_passed_on_at_once(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    bench.step(0.0)
    frame = bench.suite.encode_command(vehicle.acceleration, 0.0, enabled=False)
    assert bench.gateway.from_suite(*frame, bench.now_s)
    command = bench.judge.command(*bench.gateway.frames(bench.now_s)[0])
    assert command is not None
    assert not command[2]


def test_a_repeated_frame_of_the_suite_is_silence(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    bench.step(0.5)
    frame = bench.suite.encode_command(vehicle.acceleration, 0.5, enabled=True)
    for _ in range(10):
        bench.gateway.from_suite(*frame, bench.now_s)
        found = bench.step(None)
    assert found == (0.0, False)
    assert bench.gateway.counts["ACC_COMMAND: repeated counter"] == 9


def test_the_brake_makes_the_car_inactive_in_the_next_frame(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    assert bench.step(0.0)[1]
    assert bench.step(0.0, brake=True) == (0.0, False)


def test_inactive_is_inactive_until_the_suite_has_let_go(vehicle: VehicleLink) -> None:
    """After a pedal, after silence, and after a start of the gateway while the suite is engaged."""
    bench = Bench(vehicle)
    assert bench.step(0.0)[1]
    for cause in ({"brake": True}, {"wanted": None}):
        for _ in range(5):
            bench.step(**cause)  # type: ignore[arg-type]
        assert not any(bench.step(0.0)[1] for _ in range(20))
        bench.let_go()
        assert not bench.step(0.0)[1]
        bench.press()
        assert bench.step(0.0)[1]
    bench.gateway = Gateway(vehicle)
    assert not any(bench.step(0.0)[1] for _ in range(20))


def test_a_suite_that_asks_without_the_button_drives_nothing(vehicle: VehicleLink) -> None:
    """However often it lets go and asks again; and a press counts for a second."""
    bench = Bench(vehicle)
    bench.gateway = Gateway(vehicle)
    for _ in range(20):
        bench.let_go()
        assert not any(bench.step(0.0)[1] for _ in range(5))
    assert bench.gateway.report.loss is Loss.NOT_ENABLED
    for pressed in (False, True, True):
        assert not bench.step(None, button=pressed)[1]
    assert not bench.gateway.report.is_armed  # not before its release
    bench.press()
    for _ in range(round(1.2 / PERIOD_S)):
        bench.let_go()
        bench.step(None)
    assert not bench.step(0.0)[1]
    bench.press()
    assert bench.step(0.0)[1]


def test_a_button_of_the_suite_counts_on_the_bench_only(vehicle: VehicleLink) -> None:
    for is_bench in (False, True):
        bench = Bench(vehicle)
        bench.gateway = Gateway(vehicle, is_bench=is_bench)
        bench.let_go()
        bench.step(None)
        bench.gateway.from_suite(BENCH_BUTTON_ID, b"", bench.now_s)
        for _ in range(20):
            bench.let_go()
            bench.step(None)
        assert bench.step(0.0)[1] is is_bench


def test_the_accelerator_overrides_and_its_release_gives_back(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    assert bench.step(0.5)[1]
    assert not any(bench.step(0.5, accelerator=True)[1] for _ in range(3))
    bench.let_go()
    for _ in range(100):
        assert not bench.step(None, accelerator=True)[1]
    assert bench.step(0.5)[1]


@pytest.mark.parametrize(
    ("pressed", "loss"),
    [
        ({"cancel": True}, Loss.CANCEL),
        ({"brake": True}, Loss.BRAKE),
        ({"fault": True}, Loss.FAULT),
    ],
)
def test_what_the_car_states_ends_the_authority_until_the_button(
    vehicle: VehicleLink, pressed: dict[str, Any], loss: Loss
) -> None:
    bench = Bench(vehicle)
    assert bench.step(0.0)[1]
    assert not bench.step(0.0, **pressed)[1]
    assert bench.gateway.report == GatewayReport(is_armed=False, is_active=False, loss=loss)
    bench.let_go()
    assert not any(bench.step(0.0)[1] for _ in range(20))
    bench.press()
    assert bench.step(0.0)[1]


def test_another_sender_of_the_command_is_named(vehicle: VehicleLink) -> None:
    bench, rival = Bench(vehicle), FrameCodec(vehicle)
    for _ in range(5):
        assert bench.step(0.0)[1]
    frame = rival.encode_command(vehicle.acceleration, 2.0, enabled=True)
    bench.gateway.from_car(*frame, bench.now_s)
    assert not bench.step(0.0)[1]
    assert bench.gateway.report.loss is Loss.RIVAL
    bench.press()
    assert not bench.step(0.0)[1]  # it may be there still
    bench.now_s += 1.0
    bench.press()
    assert bench.step(0.0)[1]


def test_a_car_that_does_not_confirm_is_named(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    sent = [bench.step(0.0, confirms=False)[1] for _ in range(30)]
    assert sent.index(False) * PERIOD_S == pytest.approx(0.32, abs=0.04)
    assert bench.gateway.report.loss is Loss.UNCONFIRMED


def test_a_counter_with_two_senders_does_not_count(vehicle: VehicleLink) -> None:
    """Their frames alternate; a tenth of lost frames is none."""
    bench, other = Bench(vehicle), FrameCodec(vehicle)
    for _ in range(7):
        other.encode("SPEED", {})
    passed = 0
    for _ in range(40):
        bench.gateway.from_car(*other.encode("SPEED", {"VehicleSpeed": 72.0}), bench.now_s)
        if not bench.step(0.0)[1]:
            break
        passed += 1
    assert 2 <= passed <= 10
    assert any("second sender" in name for name in bench.gateway.counts)
    assert bench.gateway.report.loss is Loss.STALE
    codec, random = FrameCodec(vehicle), np.random.default_rng(5)
    lossy = [bench.car.encode("SPEED", {}) for _ in range(3000)]
    kept = [frame for frame in lossy if random.random() > 0.1]
    assert sum(codec.decode(*frame).fault is not None for frame in kept) <= 3


def test_a_vehicle_ahead_without_a_relative_speed_counts_as_standing(vehicle: VehicleLink) -> None:
    """Outside of the range of the DBC means not available; 12 m ahead at 100 km/h."""
    bench = Bench(vehicle, speed_m_s=100.0 / 3.6)
    sent = [bench.step(1.5, gap_m=12.0)[0] for _ in range(60)]
    assert sent[-1] == vehicle.limits.min_acceleration_m_s2
    sent = [bench.step(1.5, gap_m=12.0, relative_m_s=None)[0] for _ in range(60)]
    assert set(sent) == {vehicle.limits.min_acceleration_m_s2}


def test_measurements_that_contradict_each_other_are_named(vehicle: VehicleLink) -> None:
    """A gap that stays while the vehicle ahead comes nearer, and a speed without its acceleration."""
    for changed, loss in (({"relative_m_s": -3.0}, Loss.RANGE), ({"speeds": True}, Loss.SPEED)):
        bench = Bench(vehicle)
        for step in range(200):
            speed = 20.0 + 0.02 * step * ("speeds" in changed)
            found = {name: value for name, value in changed.items() if name != "speeds"}
            if not bench.step(0.0, speed_m_s=speed, **found)[1]:
                break
        assert bench.gateway.report.loss is loss


def test_frames_that_have_waited_contradict_nothing(vehicle: VehicleLink) -> None:
    """A gateway that was stopped for 6 s reads them all at once."""
    bench = Bench(vehicle)
    for step in range(120):
        values = {"TargetValid": 1.0, "Distance": 60.0 - 0.1 * step, "RelativeSpeed": -2.0}
        bench.gateway.from_car(*bench.car.encode("RADAR", values), bench.now_s + 1e-4 * step)
    assert bench.gateway.report.is_armed


def test_a_decision_that_is_not_renewed_ends_the_compressor_and_then_the_drive(
    vehicle: VehicleLink,
) -> None:
    bench = Bench(vehicle)
    assert bench.step(0.0)[1]
    cooled, driven = [], []
    for step in range(400):
        compressor = bench.suite.encode_command(vehicle.compressor, 2000.0, enabled=True)
        bench.gateway.from_suite(*compressor, bench.now_s)
        driven.append(bench.step(0.0, decides=step < 50)[1])
        cooled.append(bench.sent_frames == 2)
    assert cooled.index(False) * PERIOD_S == pytest.approx(1.0 + 3.0, abs=0.05)
    assert driven.index(False) * PERIOD_S == pytest.approx(1.0 + 3.0 + 3.5, abs=0.05)
    assert bench.gateway.report.loss is Loss.DECISION


def test_before_anybody_enables_no_compressor_frame_leaves(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    bench.gateway = Gateway(vehicle)
    for _ in range(50):
        compressor = bench.suite.encode_command(vehicle.compressor, 2000.0, enabled=True)
        bench.gateway.from_suite(*compressor, bench.now_s)
        bench.step(None)
        assert bench.sent_frames == 1


def test_below_the_safe_gap_it_brakes_whatever_the_suite_wants(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    sent = [bench.step(2.0, gap_m=30.0)[0] for _ in range(60)]
    assert sent[-1] == vehicle.limits.min_acceleration_m_s2
    assert max(sent) <= 0.0


def test_without_speed_or_brake_nothing_passes(vehicle: VehicleLink) -> None:
    bench = Bench(vehicle)
    assert bench.step(0.5)[1]
    bench.now_s += 0.2
    frame = bench.suite.encode_command(vehicle.acceleration, 0.5, enabled=True)
    bench.gateway.from_suite(*frame, bench.now_s)
    command = bench.judge.command(*bench.gateway.frames(bench.now_s)[0])
    assert command is not None
    assert not command[2]
    assert bench.gateway.report.loss is Loss.STALE


def test_what_the_gateway_sends_is_no_command_of_the_suite(vehicle: VehicleLink) -> None:
    """Some buses return own frames: they must not be forwarded to the suite and come back as commands."""
    bench = Bench(vehicle)
    bench.step(1.0)
    for frame in bench.gateway.frames(bench.now_s):
        assert not bench.gateway.from_car(*frame, bench.now_s)
