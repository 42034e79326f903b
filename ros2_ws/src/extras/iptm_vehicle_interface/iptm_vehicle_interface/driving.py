"""The suite's side of a car's bus without ROS: signals in, decisions in, commands to the gateway out.

Time is passed in, on the clock of the system. The same frames, steps and decisions in the same order give the
same commands, bit by bit: see `drive_record`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from iptm_core.decision_record import DrivingMode
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, FloatArray, LeaderState, PlantObservation
from iptm_vehicle_interface.authority import (
    REPORT_ID,
    REPORT_TIMEOUT_S,
    GatewayReport,
    decision_frame,
    read_report,
)
from iptm_vehicle_interface.bus import Frame
from iptm_vehicle_interface.channel import ENABLES, VehicleLink
from iptm_vehicle_interface.engagement import Engagement, EngagementConditions
from iptm_vehicle_interface.frames import FrameCodec, Plausibility, RangeWatch, SignalTable
from iptm_vehicle_interface.inner_loop import (
    LONGEST_FOLLOWED_S,
    Followed,
    followed,
    wanted_acceleration_m_s2,
)
from iptm_vehicle_interface.vehicle_state import LEADER, NEEDED, VehicleStateEstimator

LOOP_S = 0.02
ACTIVE_WITHIN_S = 0.3
"""Time after which a car that is enabled has to act on requests."""
PRESSED_S = 0.3
"""For how long a request of a service counts as a pressed button."""
SET_SPEED_AHEAD_S = 2.0
"""The plan's speed this long from now is the set speed: a cruise control needs about that to reach it."""
KEPT_CHANGES = 1000
"""Changes of the engagement that a log keeps, the newest: a flickering signal makes some every second."""
_KEPT_TICKS = 16


def controller_limits(vehicle: VehicleLink, jerk_m_s3: float = 1.0) -> dict[str, float]:
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


class LateSteps:
    """By how much longer than the period of the loop each step came after the one before, of any number.

    Attributes:
        largest_s: of all steps, exact; NaN without any.
    """

    BIN_S, BINS = 1e-4, 10_000

    def __init__(self) -> None:
        self.largest_s = math.nan
        self._recent_s = 0.0
        self._counts = np.zeros(self.BINS + 1, dtype=np.int64)

    def add(self, late_s: float) -> None:
        """Count a step."""
        self._counts[min(int(late_s / self.BIN_S), self.BINS)] += 1
        self.largest_s = max(late_s, 0.0 if math.isnan(self.largest_s) else self.largest_s)
        self._recent_s = max(self._recent_s, late_s)

    def take_recent_s(self) -> float:
        """Return the largest since the last call, 0 without a step."""
        recent_s, self._recent_s = self._recent_s, 0.0
        return recent_s

    def percentile_s(self, percent: float) -> float:
        """Return the lateness that a share of the steps does not exceed, up to `BIN_S` too long."""
        counts = np.cumsum(self._counts)
        place = int(np.searchsorted(counts, math.ceil(0.01 * percent * counts[-1])))
        beyond = place == self.BINS or not counts[-1]
        return self.largest_s if beyond else min((place + 1) * self.BIN_S, self.largest_s)


@dataclass
class DriveLog:
    """What the suite's side saw.

    Attributes:
        late: steps of the loop.
        decisions: number of decisions, and of those without a plan.
        changes: time since the first frame, state and reason of the newest changes of the engagement.
        changes_left_out: number of those before.
        faults: frames that did not count, by reason.
    """

    late: LateSteps = field(default_factory=LateSteps)
    decisions: int = 0
    fallbacks: int = 0
    changes: deque[tuple[float, str, str]] = field(
        default_factory=lambda: deque(maxlen=KEPT_CHANGES)
    )
    changes_left_out: int = 0
    faults: dict[str, int] = field(default_factory=dict)

    def note_change(self, since_start_s: float, engagement: Engagement) -> None:
        """Note that the engagement has changed its state."""
        self.changes_left_out += len(self.changes) == KEPT_CHANGES
        self.changes.append((since_start_s, engagement.mode.value, engagement.reason))

    def summary(self) -> dict[str, Any]:
        """Return the figures of a drive."""
        return {
            "decisions": self.decisions,
            "fallbacks": self.fallbacks,
            "late_p99_s": self.late.percentile_s(99.0),
            "late_max_s": self.late.largest_s,
            "changes": list(self.changes),
            "changes_left_out": self.changes_left_out,
            "faults": self.faults,
        }


class Driver:
    """What the suite's side remembers; frames go in and out, decisions are made elsewhere."""

    def __init__(
        self, vehicle: VehicleLink, capacity_losses: tuple[float, float] | None = None
    ) -> None:
        """Set up a drive.

        Args:
            capacity_losses: of the first and the last cell at the start; None for a new pack.
        """
        self.vehicle = vehicle
        self._codec = FrameCodec(vehicle)
        self.signals, self._plausibility = SignalTable(vehicle.signals), Plausibility()
        self.parameters = load_parameters(vehicle.parameter_set).values
        self.estimator = VehicleStateEstimator(self.parameters, capacity_losses)
        self.engagement = Engagement()
        self._range, self._is_range_frozen = RangeWatch(), False
        self._report: tuple[GatewayReport, float] | None = None
        self.log = DriveLog()
        self.requested_m_s2 = 0.0
        self._followed: Followed | None = None
        self._ticks: dict[int, tuple[float, LeaderState | None]] = {}
        self._pressed_until_s = {"enable_button": -math.inf, "cancel_button": -math.inf}
        self._last_s = -math.inf
        self._start_s = math.nan
        self._engaged_s = math.inf
        self._silent: tuple[str, ...] = ()

    def receive(self, frame: Frame) -> str:
        """Take a frame of the car; return the name of its message, empty for one that does not count."""
        if frame.frame_id == REPORT_ID:
            report = read_report(frame.data)
            self._report = self._report if report is None else (report, frame.time_s)
            return ""
        decoded = self._codec.decode(frame.frame_id, frame.data, frame.bus)
        if decoded.fault is not None:
            key = f"{decoded.message}: {decoded.fault.value}"
            self.log.faults[key] = self.log.faults.get(key, 0) + 1
            return ""
        if math.isnan(self._start_s) and decoded.values:
            self._start_s = frame.time_s
        self.signals.take(decoded.values, frame.time_s)
        self._plausibility.take(self.signals, decoded.values, frame.time_s)
        return decoded.message

    def press(self, button: str, now_s: float) -> None:
        """Press ``enable_button`` or ``cancel_button`` for a moment."""
        self._pressed_until_s[button] = now_s + PRESSED_S

    def note_silent(self, names: Sequence[str]) -> None:
        """Note which processes of the suite show no sign of life from now on."""
        self._silent = tuple(names)

    def is_pressed(self, name: str, now_s: float) -> bool:
        """Return whether a pedal or button is pressed, by the driver or a request."""
        return self.signals.is_set(name, now_s) or now_s < self._pressed_until_s.get(name, 0.0)

    def measured(self, tick_s: float, now_s: float) -> PlantObservation | None:
        """Return the observation at a tick that has just begun; None while a needed signal is stale."""
        observed = self.estimator.at_tick(self.signals, tick_s, now_s)
        if observed is not None:
            leader = self.estimator.leader(self.signals, now_s)
            self._ticks[_key(tick_s)] = observed.state.speed_m_s, leader
            while len(self._ticks) > _KEPT_TICKS:
                del self._ticks[next(iter(self._ticks))]
        return observed

    def follow(self, tick_s: float, plan: Sequence[FloatArray], command: Command) -> bool:
        """Follow the decision on a tick from now on; return whether it is newer than the present one.

        Args:
            plan: see `inner_loop.followed`.
        """
        known = self._ticks.get(_key(tick_s))
        if known is None or (self._followed and tick_s <= self._followed.made_s):
            return False
        self.log.decisions += 1
        self.log.fallbacks += plan[0].size == 0
        self._followed = followed(tick_s, plan, command, *known)
        return True

    def hindrance(self, now_s: float) -> str:
        """Return why the suite cannot drive, empty for nothing."""
        stale = self.signals.stale((*NEEDED, *LEADER, "control_active"), now_s)
        if stale:
            return f"no fresh {', '.join(stale)}"
        if why := self._without_authority(now_s) or self._implausible(now_s):
            return why
        if self.signals.is_set("vehicle_fault", now_s):
            return "the vehicle reports a fault"
        # A vehicle that does not state it shows its driver, not the suite, that it is inactive.
        states_it = "control_active" in self.vehicle.signals
        is_active = not states_it or self.signals.is_set("control_active", now_s)
        # The gateway makes the car inactive with the accelerator, too: that is overriding.
        is_active |= self.signals.is_set("accelerator_pressed", now_s)
        if now_s - self._engaged_s > ACTIVE_WITHIN_S and not is_active:
            return "the car does not act on requests"
        if self._followed is None:
            return "no decision yet"
        if now_s - self._followed.made_s > LONGEST_FOLLOWED_S:
            return f"no decision for {now_s - self._followed.made_s:.1f} s"
        return ""

    def _implausible(self, now_s: float) -> str:
        """Return which measurements cannot be right."""
        if self._is_range_frozen:
            return "the range sensor repeats itself"
        contradiction = self._plausibility.contradiction(now_s)
        return contradiction.value if contradiction else ""

    def _without_authority(self, now_s: float) -> str:
        """Return why the gateway does not let the suite drive; empty where it does, or there is none."""
        if self._report is None:
            return ""
        report, heard_s = self._report
        if now_s - heard_s > REPORT_TIMEOUT_S:
            return "no sign of life from the gateway"
        return report.loss.value if self._engaged_s < math.inf and not report.is_armed else ""

    def _is_enabled(self, now_s: float) -> bool:
        """Return whether the driver enables the suite: as the gateway reads it, where there is one."""
        if self._report is not None:
            return self._report[0].is_armed
        return any(self.is_pressed(name, now_s) for name in ENABLES)

    def step(self, now_s: float) -> list[tuple[int, bytes]]:
        """Run one step of the inner loop; return the frames for the gateway."""
        signals = self.signals
        self.estimator.update(signals, now_s)
        gap_m, relative_m_s, _ = (signals.value(name, now_s) for name in LEADER)
        arrived_s = now_s - signals.age_s("gap_m", now_s)
        own_m_s = signals.value("speed_m_s", now_s)
        repeats = self._range.is_frozen(gap_m, relative_m_s, own_m_s, arrived_s)
        self._is_range_frozen = repeats and signals.is_set("target_valid", now_s)
        since_s = min(now_s - self._last_s, 5.0 * LOOP_S)
        self._last_s = now_s
        conditions = EngagementConditions(
            brake=signals.is_set("brake_pressed", now_s),
            accelerator=signals.is_set("accelerator_pressed", now_s),
            enable=self._is_enabled(now_s),
            cancel=self.is_pressed("cancel_button", now_s),
            hindrance=self.hindrance(now_s),
            stopped=f"no sign of life from {', '.join(self._silent)}" if self._silent else "",
        )
        before = self.engagement
        self.engagement = before.step(conditions, self.requested_m_s2, since_s)
        if self.engagement.mode is not before.mode:
            engaged = self.engagement.mode is DrivingMode.ENGAGED
            self._engaged_s = now_s if engaged else math.inf
            self.log.note_change(now_s - self._start_s, self.engagement)
        self.requested_m_s2 = self._wanted(now_s, since_s)
        request, is_active = self.requested_m_s2, self.engagement.is_active
        if self.vehicle.set_speed is not None:
            # A set speed has no ramp: the car's own cruise control goes on with what it was given.
            is_active = self.engagement.mode is DrivingMode.ENGAGED
            request = self._set_speed_m_s(now_s) if is_active else 0.0
        frames = [
            self._codec.encode_command(self.vehicle.motion, request, enabled=is_active),
            decision_frame(self.log.decisions),
        ]
        if self.vehicle.compressor is not None and self._may_cool(now_s):
            power_w = self._followed.compressor_power_w if self._followed else 0.0
            frames.append(
                self._codec.encode_command(self.vehicle.compressor, power_w, enabled=True)
            )
        return frames

    def _may_cool(self, now_s: float) -> bool:
        """Return whether the compressor's power is the suite's: of a new decision, in a car it drives."""
        drives = self.engagement.mode in {DrivingMode.ENGAGED, DrivingMode.OVERRIDDEN}
        made_s = self._followed.made_s if self._followed else -math.inf
        return drives and now_s - made_s <= LONGEST_FOLLOWED_S

    def _set_speed_m_s(self, now_s: float) -> float:
        """Return the speed that the plan has a moment from now."""
        if self._followed is None:
            return 0.0
        at_s = now_s + SET_SPEED_AHEAD_S
        planned = np.interp(at_s, self._followed.node_times_s, self._followed.speeds_m_s)
        return float(min(max(planned, 0.0), self.vehicle.limits.max_set_speed_m_s))

    def _wanted(self, now_s: float, since_s: float) -> float:
        mode = self.engagement.mode
        if mode is DrivingMode.HAND_OVER:
            return self.engagement.released_m_s2
        speed = self.signals.value("speed_m_s", now_s)
        if mode is not DrivingMode.ENGAGED or self._followed is None or math.isnan(speed):
            # Engaged from here, the car goes on as it moves.
            own = self.signals.value("acceleration_m_s2", now_s)
            return 0.0 if math.isnan(own) else own
        leader = self.estimator.leader(self.signals, now_s)
        limits = self.vehicle.limits
        wanted = wanted_acceleration_m_s2(
            self._followed,
            now_s,
            speed,
            leader,
            self.requested_m_s2,
            since_s,
            limits.reaction_s,
        )
        return min(max(wanted, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)


def _key(tick_s: float) -> int:
    """Return a tick in milliseconds: stamps are rounded on their way."""
    return round(1e3 * tick_s)
