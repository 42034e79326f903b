"""The gateway with a clock that is passed in: silence, pedals, frozen counters, and what reaches the car."""

from __future__ import annotations

from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.gateway import PERIOD_S, Gateway
from iptm_vehicle_interface.vehicle import Vehicle


class Bench:
    """Both ends of a gateway, in steps of its period."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle, self.gateway = vehicle, Gateway(vehicle)
        self.car, self.suite, self.judge = (
            FrameCodec(vehicle),
            FrameCodec(vehicle),
            FrameCodec(vehicle),
        )
        self.now_s = 100.0
        self.let_go()

    def let_go(self) -> None:
        """Send a request that leaves the car to its driver."""
        frame = self.suite.encode_command(self.vehicle.acceleration, 0.0, enabled=False)
        self.gateway.from_suite(*frame, self.now_s)

    def step(
        self,
        wanted: float | None = 0.0,
        *,
        speed_m_s: float = 20.0,
        gap_m: float = 100.0,
        brake: bool = False,
    ) -> tuple[float, bool]:
        """Run one period; None for a silent suite. Return what reaches the car."""
        self.now_s += PERIOD_S
        for message, values in (
            ("SPEED", {"VehicleSpeed": 3.6 * speed_m_s}),
            ("PEDALS", {"BrakePressed": float(brake)}),
            ("RADAR", {"TargetValid": 1.0, "Distance": gap_m}),
        ):
            assert self.gateway.from_car(*self.car.encode(message, values), self.now_s)
        if wanted is not None:
            frame = self.suite.encode_command(self.vehicle.acceleration, wanted, enabled=True)
            self.gateway.from_suite(*frame, self.now_s)
        command = self.judge.command(*self.gateway.frames(self.now_s)[0])
        assert command is not None
        return command[1], command[2]


def test_a_command_passes_within_the_rate(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    sent = [bench.step(1.0) for _ in range(30)]
    assert all(enabled for _, enabled in sent)
    assert [round(value, 2) for value, _ in sent[:3]] == [0.08, 0.12, 0.16]
    assert sent[-1] == (1.0, True)


def test_a_silent_suite_makes_the_car_inactive_in_time(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    for _ in range(5):
        bench.step(-1.0)
    silent = [bench.step(None) for _ in range(10)]
    active = [enabled for _, enabled in silent].index(False)
    assert active * PERIOD_S <= vehicle.limits.max_command_age_s
    assert not any(enabled for _, enabled in silent[active:])


def test_letting_go_is_passed_on_at_once(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    bench.step(0.0)
    frame = bench.suite.encode_command(vehicle.acceleration, 0.0, enabled=False)
    assert bench.gateway.from_suite(*frame, bench.now_s)
    command = bench.judge.command(*bench.gateway.frames(bench.now_s)[0])
    assert command is not None
    assert not command[2]


def test_a_repeated_frame_of_the_suite_is_silence(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    bench.step(0.5)
    frame = bench.suite.encode_command(vehicle.acceleration, 0.5, enabled=True)
    for _ in range(10):
        bench.gateway.from_suite(*frame, bench.now_s)
        found = bench.step(None)
    assert found == (0.0, False)
    assert bench.gateway.counts["ACC_COMMAND: repeated counter"] == 9


def test_the_brake_makes_the_car_inactive_in_the_next_frame(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    assert bench.step(0.0)[1]
    assert bench.step(0.0, brake=True) == (0.0, False)


def test_inactive_is_inactive_until_the_suite_has_let_go(vehicle: Vehicle) -> None:
    """After a pedal, after silence, and after a start of the gateway while the suite is engaged."""
    bench = Bench(vehicle)
    assert bench.step(0.0)[1]
    for cause in ({"brake": True}, {"wanted": None}):
        for _ in range(5):
            bench.step(**cause)  # type: ignore[arg-type]
        assert not any(bench.step(0.0)[1] for _ in range(20))
        bench.let_go()
        assert bench.step(0.0)[1]
    bench.gateway = Gateway(vehicle)
    assert not any(bench.step(0.0)[1] for _ in range(20))


def test_below_the_safe_gap_it_brakes_whatever_the_suite_wants(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    sent = [bench.step(2.0, gap_m=30.0)[0] for _ in range(60)]
    assert sent[-1] == vehicle.limits.min_acceleration_m_s2
    assert max(sent) <= 0.0


def test_without_speed_or_brake_nothing_passes(vehicle: Vehicle) -> None:
    bench = Bench(vehicle)
    frame = bench.suite.encode_command(vehicle.acceleration, 0.5, enabled=True)
    bench.gateway.from_suite(*frame, 100.0)
    assert not bench.gateway.passed(100.0).enabled


def test_what_the_gateway_sends_is_no_command_of_the_suite(vehicle: Vehicle) -> None:
    """Some buses return own frames: they must not be forwarded to the suite and come back as commands."""
    bench = Bench(vehicle)
    bench.step(1.0)
    for frame in bench.gateway.frames(bench.now_s):
        assert not bench.gateway.from_car(*frame, bench.now_s)
