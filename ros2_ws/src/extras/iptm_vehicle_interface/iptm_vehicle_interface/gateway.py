"""The process between the suite and the car's bus: passes commands that keep the limits, and nothing else.

It reads the car itself (speed, pedals, range sensor) and shares nothing with the suite but the description of
the vehicle. When the suite falls silent the car is inactive after ``max_command_age_s``; when this process
dies, the car's own timeout ends it. Frames of the car pass to the suite unchanged.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from iptm_core.errors import IptmError, MessageError
from iptm_core.program import EXIT_OK, go_first, refused
from iptm_vehicle_interface.bus import BusReader, open_bus, send
from iptm_vehicle_interface.frames import FrameCodec, SignalTable
from iptm_vehicle_interface.safety_layer import Passed, Request, checked
from iptm_vehicle_interface.vehicle import Vehicle, load_vehicle

PERIOD_S = 0.02
POLL_S = 0.002
PEDALS = ("brake_pressed", "accelerator_pressed")


@dataclass
class _Command:
    """The newest command of the suite."""

    value: float = 0.0
    enabled: bool = False
    time_s: float = -math.inf


class Gateway:
    """What the process remembers; time is passed in, so that tests need no clock."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._codec = FrameCodec(vehicle)
        self._signals = SignalTable(vehicle.signals)
        self._acceleration, self._compressor = _Command(), _Command()
        self._sent: Passed = Passed(0.0, enabled=False)
        self._sent_s = -math.inf
        self._is_latched = True
        self.counts: Counter[str] = Counter()
        """What was refused or cut, by reason."""

    def from_car(self, frame_id: int, data: bytes, now_s: float) -> bool:
        """Take a frame of the car; return whether the suite has a use for it."""
        decoded = self._codec.decode(frame_id, data)
        if decoded.fault is not None:
            self.counts[f"{decoded.message}: {decoded.fault.value}"] += 1
        self._signals.take(decoded.values, now_s)
        return bool(decoded.message)

    def from_suite(self, frame_id: int, data: bytes, now_s: float) -> bool:
        """Take a frame of the suite; only commands of the vehicle count.

        Some buses return what this process sends, so frames of the car are heard here, too.

        Returns:
            Whether the suite lets go with it, which the car learns at once.
        """
        try:
            command = self._codec.command(frame_id, data)
        except MessageError as error:
            self.counts[str(error)] += 1
            return False
        if command is None:
            return False
        target, value, enabled = command
        kept = self._acceleration if target is self._vehicle.acceleration else self._compressor
        kept.value, kept.enabled, kept.time_s = value, enabled, now_s
        lets_go = kept is self._acceleration and not enabled
        self._is_latched &= not lets_go
        return lets_go and self._sent.enabled

    def passed(self, now_s: float) -> Passed:
        """Return what may be sent now."""
        signals = self._signals
        target = not signals.stale(("target_valid",), now_s) and signals.is_set(
            "target_valid", now_s
        )
        known = {"gap_m", "relative_speed_m_s"} <= self._vehicle.signals.keys()
        # A brake that cannot be read counts as pressed.
        pedal = bool(signals.stale(("brake_pressed", "speed_m_s"), now_s)) or any(
            signals.is_set(name, now_s) for name in PEDALS
        )
        request = Request(
            acceleration_m_s2=self._acceleration.value,
            enabled=self._acceleration.enabled,
            age_s=now_s - self._acceleration.time_s,
            last_m_s2=self._last_m_s2(now_s),
            since_last_s=min(now_s - self._sent_s, 2.0 * PERIOD_S),
            speed_m_s=signals.value("speed_m_s", now_s),
            gap_m=signals.value("gap_m", now_s) if target and known else math.nan,
            relative_speed_m_s=signals.value("relative_speed_m_s", now_s) if known else 0.0,
            pedal=pedal,
        )
        result = checked(request, self._vehicle.limits)
        for violation in result.violations:
            self.counts[violation.value] += 1
        return result

    def _last_m_s2(self, now_s: float) -> float:
        """Return the acceleration from which the request goes on: as the car moves, where it was inactive."""
        if self._sent.enabled:
            return self._sent.acceleration_m_s2
        measured = self._signals.value("acceleration_m_s2", now_s)
        return 0.0 if math.isnan(measured) else measured

    def inactive(self) -> tuple[int, bytes]:
        """Return the frame that makes the car inactive."""
        return self._codec.encode_command(self._vehicle.acceleration, 0.0, enabled=False)

    def frames(self, now_s: float) -> list[tuple[int, bytes]]:
        """Return the frames to send at an instant.

        Once the car has been made inactive against a request, and after a start, it stays so until the
        suite has let go as well: a new request needs a new enable of the driver.
        """
        result = self.passed(now_s)
        if self._acceleration.enabled and not result.enabled:
            if not self._is_latched:
                reasons = ", ".join(each.value for each in result.violations)
                print(f"gateway: inactive: {reasons}", flush=True)
            self._is_latched = True
        if self._is_latched and result.enabled:
            self.counts["no new enable"] += 1
            result = Passed(0.0, enabled=False, violations=result.violations)
        self._sent, self._sent_s = result, now_s
        vehicle = self._vehicle
        sent = [
            self._codec.encode_command(
                vehicle.acceleration, result.acceleration_m_s2, enabled=result.enabled
            )
        ]
        is_fresh = now_s - self._compressor.time_s <= 1.0
        if vehicle.compressor is not None and is_fresh:
            power_w = min(max(self._compressor.value, 0.0), vehicle.limits.max_compressor_power_w)
            sent.append(self._codec.encode_command(vehicle.compressor, power_w, enabled=True))
        return sent


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the gateway until a signal ends it; returns the exit code."""
    parser = argparse.ArgumentParser("gateway", description=__doc__)
    parser.add_argument("--vehicle", default="bench", help="name or folder of the vehicle")
    parser.add_argument("--car", required=True, metavar="BUS", help="bus of the car")
    parser.add_argument("--suite", required=True, metavar="BUS", help="bus of the suite")
    options = parser.parse_args(arguments)
    try:
        gateway = Gateway(load_vehicle(options.vehicle))
        car, suite = open_bus(options.car), open_bus(options.suite)
    except IptmError as error:
        return refused("gateway", error)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: ended.append(received))
    go_first()
    of_car, of_suite = BusReader(car), BusReader(suite)
    print("gateway: ready", flush=True)
    next_s = time.monotonic()
    while not ended:
        now_s = time.monotonic()
        for frame in of_car.taken():
            if gateway.from_car(frame.frame_id, frame.data, frame.time_s):
                send(suite, frame.frame_id, frame.data)
        for frame in of_suite.taken():
            if gateway.from_suite(frame.frame_id, frame.data, frame.time_s):
                next_s = now_s
        if now_s >= next_s:
            next_s = max(next_s + PERIOD_S, now_s)
            for frame_id, data in gateway.frames(now_s):
                send(car, frame_id, data)
        time.sleep(POLL_S)
    send(car, *gateway.inactive())
    of_car.close()
    of_suite.close()
    print(json.dumps(dict(gateway.counts)), flush=True)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
