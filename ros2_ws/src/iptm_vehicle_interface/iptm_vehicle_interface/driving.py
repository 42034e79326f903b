"""The suite in a car, without ROS: signals, decisions, the inner loop, and commands to the gateway.

Ticks begin at multiples of the period on the system's clock. A decision has what was measured at its tick, is
computed in a thread of its own, and is followed from its tick on; while it is computed the last one is.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.errors import IptmError
from iptm_core.parameters import load_parameters
from iptm_core.program import EXIT_OK, refused
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_vehicle_interface.bus import BusReader, Frame, open_bus, send
from iptm_vehicle_interface.engagement import Conditions, Engagement, Mode
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.inner_loop import (
    LONGEST_FOLLOWED_S,
    Followed,
    followed,
    wanted_acceleration_m_s2,
)
from iptm_vehicle_interface.signals import SignalTable
from iptm_vehicle_interface.vehicle import Vehicle, load_vehicle
from iptm_vehicle_interface.vehicle_state import (
    LEADER,
    NEEDED,
    VehicleStateEstimator,
    shifted,
)

LOOP_S = 0.02
NO_SLOPE = SlopePreview(np.zeros(1), np.zeros(1))


def controller_limits(vehicle: Vehicle, jerk_m_s3: float) -> dict[str, float]:
    """Return what the controller has to plan with in a vehicle, as overrides of its parameters."""
    own = load_parameters(vehicle.parameter_set).values.limits
    limits = vehicle.limits
    found = {
        "limits.min_acceleration_m_s2": max(
            own.min_acceleration_m_s2, limits.min_acceleration_m_s2
        ),
        "limits.max_acceleration_m_s2": min(
            own.max_acceleration_m_s2, limits.max_acceleration_m_s2
        ),
        "limits.max_jerk_m_s3": min(own.max_jerk_m_s3, jerk_m_s3),
        # Beyond comfort the car has the authority of its channel, not brakes of its own.
        "brakes.max_deceleration_m_s2": -limits.min_acceleration_m_s2,
    }
    if vehicle.compressor is not None:
        found["limits.max_compressor_power_w"] = min(
            own.max_compressor_power_w, limits.max_compressor_power_w
        )
    return found


@dataclass
class DriveLog:
    """What the suite's side saw.

    Attributes:
        late_s: how late each step of the inner loop began.
        decisions: number of decisions, and of those by a fallback.
        changes: time, state and reason of each change of the engagement.
        faults: frames that did not count, by reason.
    """

    late_s: list[float] = field(default_factory=list)
    decisions: int = 0
    fallbacks: int = 0
    changes: list[tuple[float, str, str]] = field(default_factory=list)
    faults: dict[str, int] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Return the figures of a drive."""
        late = np.array(self.late_s or [math.nan])
        return {
            "decisions": self.decisions,
            "fallbacks": self.fallbacks,
            "late_p99_s": float(np.percentile(late, 99)),
            "late_max_s": float(late.max()),
            "changes": self.changes,
            "faults": self.faults,
        }


class Driver:
    """The suite's side of the bus; time is passed in, frames go in and out, decisions are made elsewhere."""

    def __init__(self, vehicle: Vehicle, tick_s: float = 1.0) -> None:
        self.vehicle, self.tick_s = vehicle, tick_s
        self._codec = FrameCodec(vehicle)
        self.signals = SignalTable(vehicle.signals)
        parameters = load_parameters(vehicle.parameter_set).values
        self.estimator = VehicleStateEstimator(parameters)
        self.engagement = Engagement()
        self.log = DriveLog()
        self._followed: Followed | None = None
        self._requested_m_s2, self._last_s = 0.0, -math.inf
        self._start_s = math.nan

    def receive(self, frame: Frame) -> None:
        """Take a frame of the car."""
        decoded = self._codec.decode(frame.frame_id, frame.data)
        if decoded.fault is not None:
            key = f"{decoded.message}: {decoded.fault.value}"
            self.log.faults[key] = self.log.faults.get(key, 0) + 1
        if math.isnan(self._start_s) and decoded.values:
            self._start_s = frame.time_s
        self.signals.take(decoded.values, frame.time_s)

    def measured(self, now_s: float) -> tuple[VehicleState | None, LeaderState | None]:
        """Return the state and the vehicle ahead at a tick."""
        state = self.estimator.state_at_tick(self.signals, now_s)
        return state, self.estimator.leader(self.signals, now_s)

    def follow(
        self, decision: Decision, made_s: float, speed_m_s: float, leader: LeaderState | None
    ) -> None:
        """Follow a decision from now on."""
        self.log.decisions += 1
        self.log.fallbacks += decision.plan is None
        self._followed = followed(
            made_s, decision.plan, decision.command, speed_m_s, leader, self.tick_s
        )

    def hindrance(self, now_s: float) -> str:
        """Return why the suite cannot drive, empty for nothing."""
        stale = self.signals.stale((*NEEDED, *LEADER), now_s)
        if stale:
            return f"no fresh {', '.join(stale)}"
        if self.signals.is_set("vehicle_fault", now_s):
            return "the vehicle reports a fault"
        if self._followed is None:
            return "no decision yet"
        if now_s - self._followed.made_s > LONGEST_FOLLOWED_S:
            return f"no decision for {now_s - self._followed.made_s:.1f} s"
        return ""

    def step(self, now_s: float) -> list[tuple[int, bytes]]:
        """Run one step of the inner loop; return the frames for the gateway."""
        signals = self.signals
        self.estimator.update(signals, now_s)
        since_s = min(now_s - self._last_s, 5.0 * LOOP_S)
        self._last_s = now_s
        conditions = Conditions(
            brake=signals.is_set("brake_pressed", now_s),
            accelerator=signals.is_set("accelerator_pressed", now_s),
            enable=signals.is_set("enable_button", now_s),
            cancel=signals.is_set("cancel_button", now_s),
            hindrance=self.hindrance(now_s),
        )
        before = self.engagement
        self.engagement = before.step(conditions, self._requested_m_s2, since_s)
        if self.engagement.mode is not before.mode:
            since_start_s = now_s - self._start_s
            self.log.changes.append(
                (since_start_s, self.engagement.mode.value, self.engagement.reason)
            )
        self._requested_m_s2 = self._wanted(now_s, since_s)
        acceleration = self.vehicle.acceleration
        frames = [
            self._codec.encode_command(
                acceleration, self._requested_m_s2, enabled=self.engagement.is_active
            )
        ]
        if self.vehicle.compressor is not None and self._followed is not None:
            power_w = max(self._followed.compressor_power_w, 0.0)
            frames.append(
                self._codec.encode_command(self.vehicle.compressor, power_w, enabled=True)
            )
        return frames

    def _wanted(self, now_s: float, since_s: float) -> float:
        mode = self.engagement.mode
        if mode is Mode.HAND_OVER:
            return self.engagement.released_m_s2
        speed = self.signals.value("speed_m_s", now_s)
        if mode is not Mode.ENGAGED or self._followed is None or math.isnan(speed):
            # Engaged from here, the car goes on as it moves.
            own = self.signals.value("acceleration_m_s2", now_s)
            return 0.0 if math.isnan(own) else own
        leader = self.estimator.leader(self.signals, now_s)
        limits = self.vehicle.limits
        wanted = wanted_acceleration_m_s2(
            self._followed, now_s, speed, leader, self._requested_m_s2, since_s
        )
        return min(max(wanted, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)


class Decisions:
    """Decides in a thread of its own, one tick after the other; a tick that comes too early is left out."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._origin_s = math.nan
        self._lock = threading.Lock()
        self._done: tuple[Decision, float, float, LeaderState | None] | None = None
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a decision is being made."""
        return self._thread is not None and self._thread.is_alive()

    def ask(self, state: VehicleState, leader: LeaderState | None) -> None:
        """Begin to decide a tick."""
        if self.is_busy:
            return
        if math.isnan(self._origin_s):
            self._origin_s = state.time_s
        self._thread = threading.Thread(target=self._decide, args=(state, leader), daemon=True)
        self._thread.start()

    def taken(self) -> tuple[Decision, float, float, LeaderState | None] | None:
        """Return a decision once it is made, with its tick, the speed then and the vehicle ahead then."""
        with self._lock:
            done, self._done = self._done, None
        return done

    def _decide(self, state: VehicleState, leader: LeaderState | None) -> None:
        own, ahead = shifted(state, leader, self._origin_s)
        decision = self._controller.decide(
            Measurements(own, ahead, LeaderPreview.empty(), NO_SLOPE)
        )
        with self._lock:
            self._done = decision, state.time_s, state.speed_m_s, leader


def drive(
    driver: Driver, decisions: Decisions, bus: Any, duration_s: float, ended: Sequence[int]
) -> None:
    """Drive in real time until the duration is over or a signal has come."""
    reader = BusReader(bus)
    start_s = next_s = time.monotonic()
    # Ticks begin at multiples of the period on the system's clock.
    offset_s = time.time() - start_s
    tick = math.floor((start_s + offset_s) / driver.tick_s)
    while not ended and time.monotonic() - start_s < duration_s:
        time.sleep(max(next_s - time.monotonic(), 0.0))
        now_s = time.monotonic()
        driver.log.late_s.append(now_s - next_s)
        next_s = max(next_s + LOOP_S, now_s)
        for frame in reader.taken():
            driver.receive(frame)
        if math.floor((now_s + offset_s) / driver.tick_s) > tick:
            tick = math.floor((now_s + offset_s) / driver.tick_s)
            state, leader = driver.measured(now_s)
            if state is not None and leader is not None:
                decisions.ask(state, leader)
        done = decisions.taken()
        if done is not None:
            driver.follow(*done)
        for frame_id, data in driver.step(now_s):
            send(bus, frame_id, data)
    reader.close()


def build_controller(vehicle: Vehicle, strategy: str) -> Controller:
    """Return a controller that plans with what the vehicle offers."""
    overrides = controller_limits(vehicle, jerk_m_s3=1.0)
    parameters = load_parameters(vehicle.parameter_set, overrides).values
    return Controller(parameters, ControllerOptions(strategy=strategy_by_name(strategy)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive a car on a bus; prints what was seen as JSON at the end."""
    parser = argparse.ArgumentParser("drive_vehicle", description=__doc__)
    parser.add_argument("--vehicle", default="bench", help="name or folder of the vehicle")
    parser.add_argument("--bus", required=True, metavar="BUS", help="bus of the gateway")
    parser.add_argument("--strategy", default="aging_cost_to_go", help="strategy of the controller")
    parser.add_argument("--duration-s", type=float, default=math.inf, help="for how long")
    parser.add_argument("--log", type=Path, metavar="FILE", help="JSON of the result")
    options = parser.parse_args(arguments)
    try:
        vehicle = load_vehicle(options.vehicle)
        controller = build_controller(vehicle, options.strategy)
        bus = open_bus(options.bus)
    except IptmError as error:
        return refused("drive_vehicle", error)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: ended.append(received))
    driver = Driver(vehicle)
    print("drive_vehicle: ready", flush=True)
    drive(driver, Decisions(controller), bus, options.duration_s, ended)
    text = json.dumps(driver.log.summary())
    if options.log:
        options.log.write_text(text, "utf-8")
    print(text, flush=True)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
