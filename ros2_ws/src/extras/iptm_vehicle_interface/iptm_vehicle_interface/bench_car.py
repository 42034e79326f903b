"""A car on a bus, for tests and first contact: the project's vehicle model behind a production car's channel.

The suite sees nothing of it but its DBC. Between a request and the motion lie dead time and lag of the
actuator; sensors have rates, noise and the resolution of their signals; frames may be lost or late. A driver
with pedals drives while the car is not active, follows the lead vehicle, and acts by a list of events. Time
is the wall's.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from iptm_controller.ladder import safe_following
from iptm_core.errors import MessageError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import build_route
from iptm_core.state import Command, LeaderState, VehicleState
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.plant import Plant
from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.frames import FrameCodec

STEP_S = 0.01
DEAD_TIME_S = 0.1
LAG_S = 0.2
TIMEOUT_S = 0.065
"""Age of the last command from which the car is inactive by itself, and its compressor off."""
DRIVER_REACTION_S = 1.0
"""Time after the car has become inactive in which neither suite nor driver acts: it coasts."""
DRIVER_MARGIN_M = 2.0
COASTING_M_S2 = -0.3
RADAR_RANGE_M = 250.0
PERIODS: dict[str, int] = {"SPEED": 1, "PEDALS": 2, "RADAR": 5, "BATTERY": 10, "THERMAL": 100}
"""Steps between two frames of a message; the one with the state of the channel leaves at once on a change."""


@dataclass(frozen=True)
class BusFaults:
    """What goes wrong on the way to the suite.

    Attributes:
        lost: share of frames that are lost.
        late_s: frames are late by up to this.
        frozen_from_s: time from which the values of the radar repeat; infinite for never.
        silent: beginning and end of a time without any frame.
        bad_checksum: share of frames with a wrong checksum.
    """

    lost: float = 0.0
    late_s: float = 0.0
    frozen_from_s: float = math.inf
    silent: tuple[float, float] = (math.inf, math.inf)
    bad_checksum: float = 0.0


@dataclass
class CarLog:
    """What the car saw of the commands; the judge of a drive."""

    active_s: float = 0.0
    engagements: int = 0
    smallest_gap_m: float = math.inf
    largest_jerk_m_s3: float = 0.0
    oldest_command_s: float = 0.0
    rejected_frames: int = 0
    inactive_at_s: list[float] = field(default_factory=list)
    distance_m: float = 0.0
    battery_energy_j: float = 0.0
    capacity_loss: float = 0.0
    began_s: float = math.nan
    """On the monotonic clock of the machine, which other processes share."""


class BenchCar:
    """The car without its bus; time is passed in."""

    def __init__(
        self,
        vehicle: VehicleLink,
        cycle: str,
        events: Sequence[tuple[str, float, float, float]] = (),
        seed: int = 0,
        faults: BusFaults | None = None,
        slope: str = "flat",
    ) -> None:
        """Set up a car behind a leader.

        Args:
            cycle: what the lead vehicle drives.
            events: name of a pedal or button (`SIGNALS`), when it is pressed, for how long, and after
                which time again, in s; infinite for once.
            slope: of the road, see `build_route`.
        """
        limits = vehicle.limits
        channel = {
            "limits.min_acceleration_m_s2": limits.min_acceleration_m_s2,
            "limits.max_acceleration_m_s2": limits.max_acceleration_m_s2,
            "limits.max_jerk_m_s3": 50.0,
        }
        self.parameters: ModelParameters = load_parameters(vehicle.parameter_set, channel).values
        self._driver = load_parameters(vehicle.parameter_set).values
        self._route = build_route(cycle, slope, initial_gap_m=self.parameters.gap.initial_gap_m)
        self._plant = Plant(self.parameters, self._route.slope.slope_at)
        self.state: VehicleState = self._plant.initial_state()
        self._step = self._plant.observe(self.state)
        self._codec = FrameCodec(vehicle)
        self._vehicle, self._events = vehicle, tuple(events)
        self._faults, self._rng = faults or BusFaults(), np.random.default_rng(seed)
        self._requests: deque[tuple[float, float]] = deque()
        self._request, self._enabled, self._command_s = 0.0, False, -math.inf
        self._compressor_w, self._acceleration, self._count = 0.0, 0.0, 0
        self._compressor_s = -math.inf
        self._wanted_m_s2 = 0.0
        self._inactive_since_s = -math.inf
        self._was_active = self._stated_active = False
        self._jerk_window: deque[float] = deque(maxlen=11)
        self._radar: dict[str, float] = {}
        self.log = CarLog()

    @property
    def time_s(self) -> float:
        """Time since the start."""
        return self._count * STEP_S

    @property
    def is_active(self) -> bool:
        """Whether requests of the suite move the car."""
        return self._enabled and self.time_s - self._command_s <= TIMEOUT_S

    def pressed(self, name: str) -> bool:
        """Return whether the driver presses a pedal or button now."""
        return any(
            event == name
            and self.time_s - begin_s >= 0.0
            and (self.time_s - begin_s) % every_s < for_s
            for event, begin_s, for_s, every_s in self._events
        )

    def leader(self) -> LeaderState:
        """Return the vehicle ahead."""
        return self._route.leader.state_at(self.time_s)

    def receive(self, frame_id: int, data: bytes) -> None:
        """Take a frame of the gateway."""
        try:
            command = self._codec.command(frame_id, data)
        except MessageError:
            self.log.rejected_frames += 1
            return
        if command is None:
            return
        target, value, enabled = command
        if target is self._vehicle.acceleration:
            if self.is_active:
                self.log.oldest_command_s = max(
                    self.log.oldest_command_s, self.time_s - self._command_s
                )
            self._request, self._enabled, self._command_s = value, enabled, self.time_s
        else:
            self._compressor_w, self._compressor_s = value, self.time_s

    def advance(self) -> None:
        """Move on by one step."""
        leader = self.leader()
        active = self.is_active and not self.pressed("brake_pressed")
        if self._was_active and not active:
            self._inactive_since_s = self.time_s
            self.log.inactive_at_s.append(self.time_s)
        self.log.engagements += active and not self._was_active
        self._was_active = active
        self._requests.append((self.time_s, self._request if active else self._by_driver(leader)))
        while self._requests and self._requests[0][0] <= self.time_s - DEAD_TIME_S:
            self._wanted_m_s2 = self._requests.popleft()[1]
        self._acceleration += (self._wanted_m_s2 - self._acceleration) * STEP_S / LAG_S
        before = self.state
        is_commanded = self.time_s - self._compressor_s <= TIMEOUT_S
        command = Command(self._acceleration, self._compressor_w if is_commanded else 0.0)
        self._step = self._plant.advance(before, command, STEP_S)
        self.state = self._step.state
        self._count += 1
        self._note(leader, active)

    def _by_driver(self, leader: LeaderState) -> float:
        """Return what the driver asks for."""
        if self.pressed("brake_pressed"):
            return -3.0
        if self.pressed("accelerator_pressed"):
            return 1.5
        if self.time_s - self._inactive_since_s < DRIVER_REACTION_S:
            return COASTING_M_S2 if self.state.speed_m_s > 0.0 else 0.0
        following = safe_following(self.state, leader, self._driver, 1.0).acceleration_m_s2
        return min(following, self._in_need_m_s2(leader))

    def _in_need_m_s2(self, leader: LeaderState) -> float:
        """Return how hard the driver brakes where the comfortable law comes too late, else infinity."""
        closing = self.state.speed_m_s - leader.speed_m_s
        delay_m = closing * (DEAD_TIME_S + LAG_S)
        room_m = leader.position_m - self.state.position_m - DRIVER_MARGIN_M - delay_m
        needed = closing * closing / (2.0 * max(room_m, 0.1)) if closing > 0.0 else 0.0
        if needed < -self._driver.limits.min_acceleration_m_s2:
            return math.inf
        return max(-needed, self.parameters.limits.min_acceleration_m_s2)

    def _note(self, leader: LeaderState, active: bool) -> None:  # noqa: FBT001
        log = self.log
        log.smallest_gap_m = min(log.smallest_gap_m, leader.position_m - self.state.position_m)
        self._jerk_window.append(self._acceleration)
        if active:
            log.active_s += STEP_S
            if len(self._jerk_window) == self._jerk_window.maxlen:
                jerk = abs(self._jerk_window[-1] - self._jerk_window[0]) / (10.0 * STEP_S)
                log.largest_jerk_m_s3 = max(log.largest_jerk_m_s3, jerk)
        else:
            self._jerk_window.clear()
        log.distance_m = self.state.position_m
        log.battery_energy_j += self._step.powers.battery_power_w * STEP_S
        losses = self.state.cell_1_capacity_loss + self.state.cell_n_capacity_loss
        log.capacity_loss = losses - 2.0 * self.parameters.aging.initial_capacity_loss

    def frames(self) -> list[tuple[float, int, bytes]]:
        """Return the frames that are due, each with the time by which it is late."""
        faults, due = self._faults, []
        if faults.silent[0] <= self.time_s < faults.silent[1]:
            return []
        has_changed = self._stated_active is not self._was_active
        self._stated_active = self._was_active
        for message, every in PERIODS.items():
            if self._count % every and not (has_changed and message == "PEDALS"):
                continue
            frame_id, data = self._codec.encode(message, self._values(message))
            if faults.bad_checksum and self._rng.random() < faults.bad_checksum:
                data = data[:-1] + bytes([data[-1] ^ 0x5A])
            if faults.lost and self._rng.random() < faults.lost:
                continue
            due.append(
                (faults.late_s * self._rng.random() if faults.late_s else 0.0, frame_id, data)
            )
        return due

    def _values(self, message: str) -> dict[str, float]:
        """Return the values of a message, in the units of the DBC."""
        state, step = self.state, self._step
        if message == "SPEED":
            return {"VehicleSpeed": 3.6 * state.speed_m_s, "Acceleration": self._acceleration}
        if message == "PEDALS":
            buttons = {
                "BrakePressed": "brake_pressed",
                "AcceleratorPressed": "accelerator_pressed",
                "EnableButton": "enable_button",
                "CancelButton": "cancel_button",
                "VehicleFault": "vehicle_fault",
            }
            pressed = {name: float(self.pressed(event)) for name, event in buttons.items()}
            return pressed | {"ControlActive": float(self._was_active)}
        if message == "RADAR":
            return self._radar_values()
        if message == "BATTERY":
            return {
                "PackVoltage": step.pack_voltage_v,
                "PackCurrent": step.pack_current_a,
                "StateOfCharge": 100.0 * min(max(state.state_of_charge, 0.0), 1.0),
            }
        return {
            "LowestCellTemperature": state.cell_1_temperature_k - CELSIUS_ZERO_K,
            "HighestCellTemperature": state.cell_n_temperature_k - CELSIUS_ZERO_K,
            "CompressorPower": max(state.compressor_power_w, 0.0),
        }

    def _radar_values(self) -> dict[str, float]:
        if self.time_s >= self._faults.frozen_from_s:
            return self._radar
        leader = self.leader()
        gap_m = leader.position_m - self.state.position_m + self._rng.normal(0.0, 0.1)
        relative = leader.speed_m_s - self.state.speed_m_s + self._rng.normal(0.0, 0.05)
        seen = gap_m <= RADAR_RANGE_M
        self._radar = {
            "TargetValid": float(seen),
            "Distance": min(max(gap_m, 0.0), 400.0) if seen else 0.0,
            "RelativeSpeed": relative if seen else 0.0,
        }
        return self._radar
