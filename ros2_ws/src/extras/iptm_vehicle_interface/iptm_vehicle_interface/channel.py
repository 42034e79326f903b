"""A vehicle as data: which signals of its DBC mean what, what it accepts, and within which limits.

Read from a folder by `vehicle`. Units come from the DBC; the mapping names signals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from iptm_core.errors import ParameterError
from iptm_vehicle_interface.protection import Protection

SIGNALS: Mapping[str, str] = {
    "speed_m_s": "m/s",
    "acceleration_m_s2": "m/s^2",
    "lowest_cell_temperature_k": "K",
    "highest_cell_temperature_k": "K",
    "state_of_charge": "1",
    "pack_voltage_v": "V",
    "pack_current_a": "A",
    "compressor_power_w": "W",
    "gap_m": "m",
    "relative_speed_m_s": "m/s",
    "target_valid": "1",
    "brake_pressed": "1",
    "accelerator_pressed": "1",
    "enable_button": "1",
    "cruise_engaged": "1",
    "cancel_button": "1",
    "door_open": "1",
    "vehicle_fault": "1",
    "control_active": "1",
}
"""Signals that the suite has a use for, and their SI units. Currents are positive when discharging, relative
speeds when the vehicle ahead pulls away. `acceleration_m_s2` is
the change of the speed, without gravity on a slope. `control_active` is 1 while the car acts on requests;
`cruise_engaged` while the car's own cruise control is on, which the driver does, in place of a button."""
FLAGS = frozenset(name for name, unit in SIGNALS.items() if unit == "1") - {"state_of_charge"}
REQUIRED = ("speed_m_s", "brake_pressed")
ENABLES = ("enable_button", "cruise_engaged")
"""One of these: only a reading of the driver's own action gives the suite authority."""


@dataclass(frozen=True)
class SignalSource:
    """Where a signal comes from.

    Attributes:
        message: name in the DBC.
        signal: name in that message.
        timeout_s: age from which the value is stale.
        factor: from the unit of the DBC to SI, before the offset.
        offset: the same.
        values: of a flag that is stated by a number: those for which it is set.
        above: of a flag that is stated by a quantity, such as the position of a pedal: set above this.
    """

    message: str
    signal: str
    timeout_s: float
    factor: float = 1.0
    offset: float = 0.0
    values: frozenset[float] = frozenset()
    above: float | None = None

    def to_si(self, value: float) -> float:
        """Return a value of the DBC in SI units."""
        if self.values:
            return float(value in self.values)
        if self.above is not None:
            return float(value > self.above)
        return value * self.factor + self.offset


@dataclass(frozen=True)
class CommandTarget:
    """A message that the vehicle accepts.

    Attributes:
        message: name in the DBC.
        signal: the requested value in it.
        enable: signal that states whether the request counts; empty for none.
        factor: from the unit of the DBC to SI, before the offset.
        offset: the same.
        same: signals that carry the value as well.
        positive: signals that carry it where it is positive, else 0.
        fixed: values of other signals, in the units of the DBC.
        active: values of signals while the request counts; 1 for `enable` unless stated.
        inactive: values while it does not; 0 for `enable` and `signal` unless stated.
        copied: signals that repeat what the car stated last, as message and signal.
        hold: signal that is 1 where the car shall stand.
        resume: signal that is 1 where it shall start from a standstill.
        levels: values of the DBC by power in W, for a command in stages; negative power heats.
    """

    message: str
    signal: str
    enable: str = ""
    factor: float = 1.0
    offset: float = 0.0
    same: tuple[str, ...] = ()
    positive: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)
    active: Mapping[str, float] = field(default_factory=dict)
    inactive: Mapping[str, float] = field(default_factory=dict)
    copied: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    hold: str = ""
    resume: str = ""
    levels: Mapping[float, float] = field(default_factory=dict)

    def from_si(self, value: float) -> float:
        """Return an SI value in the unit of the DBC; of a command in stages, the nearest one."""
        if self.levels:
            return self.levels[min(self.levels, key=lambda power_w: abs(power_w - value))]
        return (value - self.offset) / self.factor

    def to_si(self, value: float) -> float:
        """Return a value of the DBC in SI units."""
        if self.levels:
            return min(self.levels, key=lambda power_w: abs(self.levels[power_w] - value))
        return value * self.factor + self.offset

    def is_enabled(self, raw: Mapping[str, Any]) -> bool:
        """Return whether a frame's request counts."""
        return not self.enable or float(raw[self.enable]) == self.active[self.enable]


@dataclass(frozen=True)
class ActuationLimits:
    """What may reach the bus, whatever the suite asks for; see `safety_layer`.

    Attributes:
        min_acceleration_m_s2: hardest braking that the channel passes, negative.
        max_acceleration_m_s2: hardest acceleration.
        max_jerk_m_s3: largest rate of change of the request.
        max_command_age_s: no command older than this leaves.
        reaction_s: time until the vehicle begins to follow a request, for the gap monitor.
        lead_deceleration_m_s2: braking of the vehicle ahead that the gap monitor allows for.
        margin_m: gap that is left when both stand.
        max_compressor_power_w: largest compressor power that may be requested.
        max_set_speed_m_s: fastest set speed that may be requested.
    """

    min_acceleration_m_s2: float
    max_acceleration_m_s2: float
    max_jerk_m_s3: float
    max_command_age_s: float
    reaction_s: float
    lead_deceleration_m_s2: float
    margin_m: float
    max_compressor_power_w: float = 0.0
    max_set_speed_m_s: float = 0.0

    def __post_init__(self) -> None:
        ranges = {
            "min_acceleration_m_s2": (-10.0, -0.5),
            "max_acceleration_m_s2": (0.1, 5.0),
            "max_jerk_m_s3": (0.5, 50.0),
            "max_command_age_s": (0.02, 1.0),
            "reaction_s": (0.0, 3.0),
            "lead_deceleration_m_s2": (0.5, 12.0),
            "margin_m": (0.0, 20.0),
            "max_compressor_power_w": (0.0, 2e4),
            "max_set_speed_m_s": (0.0, 70.0),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ParameterError(f"limits: {name} is {value}; allowed: {low:g} to {high:g}")


@dataclass(frozen=True)
class VehicleLink:
    """A vehicle; see the module.

    Attributes:
        parameter_set: model of the car, for controller and ageing.
        databases: a DBC for each of its buses.
        signals: sources by the name of `SIGNALS`; what the car does not offer is missing.
        acceleration: where the acceleration is requested.
        set_speed: or else the set speed of the car's own cruise control, which keeps the gap.
        compressor: where the compressor power is; None where the car cools by itself.
        protections: of messages, by name.
    """

    name: str
    description: str
    parameter_set: str
    databases: tuple[Any, ...]
    signals: Mapping[str, SignalSource]
    acceleration: CommandTarget | None
    set_speed: CommandTarget | None
    compressor: CommandTarget | None
    protections: Mapping[str, Protection]
    limits: ActuationLimits

    @property
    def cooling(self) -> str:
        """How the car takes thermal requests, in words."""
        if self.compressor is None:
            return "plans, does not cool"
        return "in stages" if self.compressor.levels else "by power"

    @property
    def database(self) -> Any:
        """DBC of the first bus."""
        return self.databases[0]

    @property
    def motion(self) -> CommandTarget:
        """The request of acceleration or set speed; a vehicle has one of them."""
        return self.acceleration or self.set_speed  # type: ignore[return-value]

    @property
    def commands(self) -> tuple[CommandTarget, ...]:
        """All that it accepts."""
        return tuple(filter(None, (self.motion, self.compressor)))

    @cached_property
    def messages(self) -> dict[str, Any]:
        """Messages of the databases, by name."""
        return {each.name: each for database in self.databases for each in database.messages}

    @cached_property
    def buses(self) -> dict[str, int]:
        """Number of the bus of each message, by name."""
        return {
            each.name: number
            for number, database in enumerate(self.databases)
            for each in database.messages
        }

    @property
    def has_fd(self) -> list[bool]:
        """Whether each bus carries frames of CAN FD."""
        return [any(map(is_fd, database.messages)) for database in self.databases]

    def route(self, frame_id: int) -> tuple[int, bool]:
        """Return the bus of a command, and whether its frame is one of CAN FD; the first bus for others."""
        for target in self.commands:
            message = self.messages[target.message]
            if message.frame_id == frame_id:
                return self.buses[target.message], is_fd(message)
        return 0, False


def is_fd(message: Any) -> bool:
    """Return whether a message of a DBC travels in frames of CAN FD."""
    return bool(message.is_fd) or message.length > 8
