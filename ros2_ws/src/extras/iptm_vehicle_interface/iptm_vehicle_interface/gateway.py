"""The process between the suite and the car's bus: passes commands that keep the limits, and nothing else.

It reads the car itself (button, pedals, speed, range sensor), gives the suite authority only after the driver
has enabled (see `authority`), and shares nothing with the suite but the description of the vehicle. When the
suite falls silent the car is inactive after ``max_command_age_s``; when this process dies, the car's own
timeout ends it. Frames of the car pass to the suite unchanged.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import time
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iptm_core.errors import IptmError, MessageError
from iptm_core.program import EXIT_OK, go_first, refused
from iptm_vehicle_interface import bus_key
from iptm_vehicle_interface.authority import (
    BENCH_BUTTON_ID,
    DECISION_ID,
    Authority,
    GatewayReport,
    Loss,
    Readings,
    report_frame,
)
from iptm_vehicle_interface.bus import BusReader, open_buses, send
from iptm_vehicle_interface.channel import ENABLES, CommandTarget, VehicleLink
from iptm_vehicle_interface.engagement import HAND_OVER_RATE_M_S3
from iptm_vehicle_interface.frames import FrameCodec, Plausibility, SignalTable
from iptm_vehicle_interface.inner_loop import LONGEST_FOLLOWED_S
from iptm_vehicle_interface.safety_layer import (
    Passed,
    Request,
    Violation,
    checked,
    checked_set_speed,
    too_old,
)
from iptm_vehicle_interface.vehicle import load_vehicle

PERIOD_S = 0.02
POLL_S = 0.002
SET_SPEED_PERIOD_S = 1.0
"""Between two frames of a set speed; one that lets go leaves at once."""
CONFIRMED_S = 0.3
"""Time after which a car that states whether it acts on requests has to do so."""
RIVAL_S = 1.0
"""For how long another sender of a command is one after its last frame."""
STANDING_M_S = 0.1
BENCH_PRESSED_S = 0.3
_ECHOES = 64
_LOSSES = {
    "cancel_button": Loss.CANCEL,
    "door_open": Loss.DOOR,
    "vehicle_fault": Loss.FAULT,
}
_NEEDED = ("speed_m_s", "brake_pressed", "accelerator_pressed", *ENABLES, "cancel_button")
_VIOLATIONS = {Violation.AGE: Loss.AGE, Violation.NOT_FINITE: Loss.NOT_FINITE}


@dataclass
class _Command:
    """The newest command of the suite."""

    value: float = 0.0
    enabled: bool = False
    time_s: float = -math.inf


class Gateway:
    """What the process remembers; time is passed in, so that tests need no clock."""

    def __init__(self, vehicle: VehicleLink, *, is_bench: bool = False) -> None:
        """Set up a gateway.

        Args:
            is_bench: whether a frame of the suite counts as the button, which no car may have.
        """
        self._vehicle, self._is_bench = vehicle, is_bench
        self._codec = FrameCodec(vehicle)
        self._signals, self._plausibility = SignalTable(vehicle.signals), Plausibility()
        self._motion, self._compressor = _Command(), _Command()
        self._decision, self._decision_s = b"", -math.inf
        self._authority = Authority()
        self._sent: Passed = Passed(0.0, enabled=False)
        self._sent_s = self._set_speed_s = -math.inf
        self._active_since_s = math.inf
        self._is_latched = True
        self._echoes: deque[tuple[int, bytes]] = deque(maxlen=_ECHOES)
        self._rival_s = self._bench_pressed_s = -math.inf
        self._own = {
            vehicle.messages[target.message].frame_id: vehicle.buses[target.message]
            for target in vehicle.commands
        }
        self.counts: Counter[str] = Counter()
        """What was refused or cut, by reason."""

    @property
    def report(self) -> GatewayReport:
        """What the suite learns."""
        return GatewayReport(self._authority.is_armed, self._sent.enabled, self._authority.loss)

    def from_car(self, frame_id: int, data: bytes, now_s: float, bus: int = 0) -> bool:
        """Take a frame of the car; return whether the suite has a use for it."""
        if self._own.get(frame_id) == bus:
            self._hear_own(frame_id, data, now_s)
            return False
        decoded = self._codec.decode(frame_id, data, bus)
        if decoded.fault is not None:
            self.counts[f"{decoded.message}: {decoded.fault.value}"] += 1
        self._signals.take(decoded.values, now_s)
        if decoded.values:
            self._plausibility.take(self._signals, decoded.values, now_s)
            self._read(now_s)
        return bool(decoded.message)

    def _hear_own(self, frame_id: int, data: bytes, now_s: float) -> None:
        """Take a command on the car's bus: the echo of one's own frame, or that of another sender."""
        if (frame_id, data) in self._echoes:
            self._echoes.remove((frame_id, data))
            return
        self.counts[Loss.RIVAL.value] += 1
        self._rival_s = now_s
        self._read(now_s)

    def from_suite(self, frame_id: int, data: bytes, now_s: float) -> bool:
        """Take a frame of the suite; only commands of the vehicle count.

        Some buses return what this process sends, so frames of the car are heard here, too.

        Returns:
            Whether the suite lets go with it, which the car learns at once.
        """
        if frame_id == DECISION_ID:
            if data != self._decision:
                self._decision, self._decision_s = data, now_s
            return False
        if frame_id == BENCH_BUTTON_ID and self._is_bench:
            self._bench_pressed_s = now_s
            self._read(now_s)
            return False
        try:
            command = self._codec.command(frame_id, data)
        except MessageError as error:
            self.counts[str(error)] += 1
            return False
        if command is None:
            return False
        target, value, enabled = command
        kept = self._motion if target is self._vehicle.motion else self._compressor
        kept.value, kept.enabled, kept.time_s = value, enabled, now_s
        lets_go = kept is self._motion and not enabled
        self._is_latched &= not lets_go
        return lets_go and self._sent.enabled

    def _read(self, now_s: float) -> None:
        """Update the authority from what the car states."""
        signals = self._signals
        before = self._authority
        is_pressed = now_s - self._bench_pressed_s < BENCH_PRESSED_S
        readings = Readings(
            button=is_pressed or signals.is_set("enable_button", now_s),
            cruise=signals.is_set("cruise_engaged", now_s),
            accelerator=signals.is_set("accelerator_pressed", now_s),
            requested=self._motion.enabled,
            loss=self._loss(now_s),
        )
        self._authority = before.step(readings, now_s)
        if before.is_armed and not self._authority.is_armed:
            self.counts[self._authority.loss.value] += 1
            print(f"gateway: inactive: {self._authority.loss.value}", flush=True)

    def _loss(self, now_s: float) -> Loss | None:
        """Return why the suite may not drive now."""
        signals = self._signals
        if signals.is_set("brake_pressed", now_s):
            return Loss.BRAKE
        if signals.stale((*_NEEDED, *self._needed(now_s)), now_s):
            return Loss.STALE
        for name, loss in _LOSSES.items():
            if signals.is_set(name, now_s):
                return loss
        if "cruise_engaged" in self._vehicle.signals and not signals.is_set(
            "cruise_engaged", now_s
        ):
            return Loss.CRUISE
        if contradiction := self._plausibility.contradiction(now_s):
            return Loss(contradiction.value)
        if now_s - self._rival_s <= RIVAL_S:
            return Loss.RIVAL
        is_confirmed = (
            "control_active" not in self._vehicle.signals
            or signals.is_set("control_active", now_s)
            or now_s - self._active_since_s <= CONFIRMED_S
        )
        return None if is_confirmed else Loss.UNCONFIRMED

    def _needed(self, now_s: float) -> tuple[str, ...]:
        """Return what a vehicle ahead that is seen has to be stated by."""
        return ("gap_m",) if self._signals.is_set("target_valid", now_s) else ()

    def passed(self, now_s: float) -> Passed:
        """Return what may be sent now."""
        signals, vehicle = self._signals, self._vehicle
        known = {"gap_m", "relative_speed_m_s"} <= vehicle.signals.keys()
        target = known and signals.is_set("target_valid", now_s)
        request = Request(
            acceleration_m_s2=self._motion.value,
            enabled=self._motion.enabled and self._authority.is_armed,
            age_s=now_s - self._motion.time_s,
            last_m_s2=self._last_m_s2(now_s),
            since_last_s=min(now_s - self._sent_s, 2.0 * PERIOD_S),
            speed_m_s=signals.value("speed_m_s", now_s),
            gap_m=signals.value("gap_m", now_s) if target else math.nan,
            relative_speed_m_s=signals.value("relative_speed_m_s", now_s) if known else 0.0,
            pedal=signals.is_set("accelerator_pressed", now_s),
        )
        judge = checked_set_speed if vehicle.set_speed else checked
        result = judge(request, vehicle.limits)
        for violation in result.violations:
            self.counts[violation.value] += 1
        return result

    def _last_m_s2(self, now_s: float) -> float:
        """Return the acceleration from which the request goes on: as the car moves, where it was inactive."""
        if self._sent.enabled:
            return self._sent.value
        measured = self._signals.value("acceleration_m_s2", now_s)
        return 0.0 if math.isnan(measured) else measured

    def has_expired(self, now_s: float) -> bool:
        """Return whether the car follows a command that has become too old, which it learns at once."""
        age_s = now_s - self._motion.time_s
        return self._sent.enabled and too_old(age_s, self._vehicle.limits)

    def inactive(self) -> tuple[int, bytes]:
        """Return the frame that makes the car inactive."""
        return self._encoded(self._vehicle.motion, 0.0, enabled=False)

    def frames(self, now_s: float) -> list[tuple[int, bytes]]:
        """Return the frames to send at an instant.

        Once the car has been made inactive against a request, and after a start, it stays so until the
        suite has let go as well.
        """
        self._read(now_s)
        result = self.passed(now_s)
        found = next((loss for why, loss in _VIOLATIONS.items() if why in result.violations), None)
        if found is None and self._motion.enabled and now_s - self._decision_s > self._life_s:
            found = Loss.DECISION
        if found is not None and self._authority.is_armed:
            self._lose(found)
            result = Passed(0.0, enabled=False, violations=result.violations)
        if self._motion.enabled and not result.enabled:
            self._is_latched = True
        if self._is_latched and result.enabled:
            self.counts["no new request"] += 1
            result = Passed(0.0, enabled=False, violations=result.violations)
        if result.enabled and not self._sent.enabled:
            self._active_since_s = now_s
        elif not result.enabled:
            self._active_since_s = math.inf
        before, self._sent, self._sent_s = self._sent, result, now_s
        sent = []
        if self._is_due(before, now_s):
            self._set_speed_s = now_s
            sent.append(self._encoded(self._vehicle.motion, result.value, enabled=result.enabled))
        return sent + self._compressor_frames(now_s)

    @property
    def _life_s(self) -> float:
        """Age of a decision from which nothing follows it: the hand-over has ended then."""
        return LONGEST_FOLLOWED_S - self._vehicle.limits.min_acceleration_m_s2 / HAND_OVER_RATE_M_S3

    def _lose(self, loss: Loss) -> None:
        self._authority = Authority(loss=loss, before=self._authority.before)
        self.counts[loss.value] += 1
        print(f"gateway: inactive: {loss.value}", flush=True)

    def _is_due(self, before: Passed, now_s: float) -> bool:
        """Return whether a frame of the motion is due: always, of a set speed once a second or to let go."""
        if self._vehicle.set_speed is None or before.enabled is not self._sent.enabled:
            return True
        return now_s - self._set_speed_s >= SET_SPEED_PERIOD_S - 0.5 * PERIOD_S

    def _compressor_frames(self, now_s: float) -> list[tuple[int, bytes]]:
        """Return the compressor's frame; without authority or a new decision its own value, or none."""
        target = self._vehicle.compressor
        if target is None:
            return []
        limits = self._vehicle.limits
        command = self._compressor
        may_pass = (
            self._authority.is_armed
            and command.enabled
            and now_s - command.time_s <= limits.max_command_age_s
            and now_s - self._decision_s <= LONGEST_FOLLOWED_S
            and math.isfinite(command.value)
        )
        if may_pass:
            lowest_w = min((0.0, *target.levels))
            power_w = min(max(command.value, lowest_w), limits.max_compressor_power_w)
            return [self._encoded(target, power_w, enabled=True)]
        return [self._encoded(target, 0.0, enabled=False)] if target.inactive else []

    def _encoded(self, target: CommandTarget, value: float, *, enabled: bool) -> tuple[int, bytes]:
        speed_m_s = self._signals.value("speed_m_s", self._sent_s)
        standing = abs(speed_m_s) < STANDING_M_S
        frame = self._codec.encode_command(target, value, enabled=enabled, standing=standing)
        self._echoes.append(frame)
        return frame


class _Link:
    """Carries frames between a gateway and its buses."""

    def __init__(
        self, gateway: Gateway, vehicle: VehicleLink, cars: Sequence[Any], suites: Sequence[Any]
    ) -> None:
        self._gateway, self._vehicle, self._cars, self._suites = gateway, vehicle, cars, suites
        self._of_cars, self._of_suites = (
            [BusReader(bus, number=number) for number, bus in enumerate(buses)]
            for buses in (cars, suites)
        )
        self._next_s, self._reported = time.monotonic(), gateway.report

    def run(self) -> None:
        """Take what has arrived, and send what is due."""
        gateway, now_s = self._gateway, time.monotonic()
        for frame in (frame for reader in self._of_cars for frame in reader.taken()):
            if gateway.from_car(frame.frame_id, frame.data, frame.time_s, frame.bus):
                is_fd = self._vehicle.has_fd[frame.bus]
                send(self._suites[frame.bus], frame.frame_id, frame.data, is_fd=is_fd)
        for frame in (frame for reader in self._of_suites for frame in reader.taken()):
            if gateway.from_suite(frame.frame_id, frame.data, frame.time_s):
                self._next_s = now_s
        is_due = now_s >= self._next_s or gateway.has_expired(now_s)
        if is_due:
            self._next_s = max(self._next_s + PERIOD_S, now_s)
            self._send(gateway.frames(now_s))
        if is_due or gateway.report != self._reported:
            self._reported = gateway.report
            send(self._suites[0], *report_frame(self._reported))

    def close(self) -> None:
        """Leave the car inactive, and close the buses."""
        self._send([self._gateway.inactive()])
        for reader in (*self._of_cars, *self._of_suites):
            reader.close()

    def _send(self, frames: Iterable[tuple[int, bytes]]) -> None:
        for frame_id, data in frames:
            number, is_fd = self._vehicle.route(frame_id)
            send(self._cars[number], frame_id, data, is_fd=is_fd)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the gateway until a signal ends it; returns the exit code."""
    parser = argparse.ArgumentParser("gateway", description=__doc__)
    add = parser.add_argument
    add("--vehicle", default="bench", help="name or folder of the vehicle")
    add("--car", required=True, metavar="BUS[,BUS]", help="buses of the car, one per database")
    add("--suite", required=True, metavar="BUS[,BUS]", help="buses of the suite, in the same order")
    add(
        "--bus-key",
        type=Path,
        metavar="FILE",
        help="key of the suite's buses, where they leave the machine",
    )
    add(
        "--bench", action="store_true", help="obey the service bench_enable as well: never in a car"
    )
    options = parser.parse_args(arguments)
    try:
        vehicle = load_vehicle(options.vehicle)
        gateway = Gateway(vehicle, is_bench=options.bench)
        key = bus_key.read_key(options.bus_key) if options.bus_key else None
        cars = open_buses(options.car.split(","), vehicle.has_fd)
        suites = bus_key.open_keyed(options.suite.split(","), vehicle.has_fd, key, bus_key.GATEWAY)
    except IptmError as error:
        return refused("gateway", error)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: ended.append(received))
    go_first()
    link = _Link(gateway, vehicle, cars, suites)
    print("gateway: ready" + (", BENCH: a service may enable" * options.bench), flush=True)
    while not ended:
        link.run()
        time.sleep(POLL_S)
    link.close()
    print(json.dumps(dict(gateway.counts)), flush=True)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
