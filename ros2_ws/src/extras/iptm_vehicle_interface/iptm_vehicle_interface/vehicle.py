"""A vehicle as data: which signals of its DBC mean what, what it accepts, and within which limits.

A vehicle is a folder with ``vehicle.yaml`` and a DBC. Units come from the DBC; the mapping names signals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from iptm_core.errors import ParameterError
from iptm_core.parameters import available_parameter_sets
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.routes.can_files import library
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import StrictMapping, shown

VEHICLES = Path(__file__).parent / "vehicles"

UNITS: Mapping[str, tuple[str, float, float]] = {
    "m/s": ("m/s", 1.0, 0.0),
    "km/h": ("m/s", 1.0 / 3.6, 0.0),
    "mph": ("m/s", 0.44704, 0.0),
    "m/s2": ("m/s^2", 1.0, 0.0),
    "m/s^2": ("m/s^2", 1.0, 0.0),
    "m": ("m", 1.0, 0.0),
    "K": ("K", 1.0, 0.0),
    "degC": ("K", 1.0, CELSIUS_ZERO_K),
    "°C": ("K", 1.0, CELSIUS_ZERO_K),
    "V": ("V", 1.0, 0.0),
    "A": ("A", 1.0, 0.0),
    "W": ("W", 1.0, 0.0),
    "kW": ("W", 1e3, 0.0),
    "%": ("1", 0.01, 0.0),
    "": ("1", 1.0, 0.0),
}
"""SI unit, factor and offset by the unit that a DBC states."""

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
    "cancel_button": "1",
    "vehicle_fault": "1",
    "control_active": "1",
}
"""Signals that the suite has a use for, and their SI units. Currents are positive when discharging, relative
speeds when the vehicle ahead pulls away. `control_active` is 1 while the car acts on requests."""
REQUIRED = ("speed_m_s", "brake_pressed")


@dataclass(frozen=True)
class SignalSource:
    """Where a signal comes from.

    Attributes:
        message: name in the DBC.
        signal: name in that message.
        timeout_s: age from which the value is stale.
        factor: from the unit of the DBC to SI, before the offset.
        offset: the same.
    """

    message: str
    signal: str
    timeout_s: float
    factor: float
    offset: float

    def to_si(self, value: float) -> float:
        """Return a value of the DBC in SI units."""
        return value * self.factor + self.offset


@dataclass(frozen=True)
class CommandTarget:
    """A message that the vehicle accepts.

    Attributes:
        message: name in the DBC.
        signal: the requested value in it.
        enable: signal that is 1 while the request counts; empty for none.
        factor: from the unit of the DBC to SI, before the offset.
        offset: the same.
    """

    message: str
    signal: str
    enable: str
    factor: float
    offset: float

    def from_si(self, value: float) -> float:
        """Return an SI value in the unit of the DBC."""
        return (value - self.offset) / self.factor


@dataclass(frozen=True)
class Protection:
    """Counter and checksum of protected messages, by the name of the signal; empty for none.

    A message of the DBC that has signals of these names is protected by them.
    """

    counter: str = ""
    checksum: str = ""


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
    """

    min_acceleration_m_s2: float
    max_acceleration_m_s2: float
    max_jerk_m_s3: float
    max_command_age_s: float
    reaction_s: float
    lead_deceleration_m_s2: float
    margin_m: float
    max_compressor_power_w: float

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
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ParameterError(f"limits: {name} is {value}; allowed: {low:g} to {high:g}")


@dataclass(frozen=True)
class Vehicle:
    """A vehicle; see the module.

    Attributes:
        parameter_set: model of the car, for controller and ageing.
        database: the DBC.
        signals: sources by the name of `SIGNALS`; what the car does not offer is missing.
        acceleration: where the acceleration is requested.
        compressor: where the compressor power is; None where the car cools by itself.
    """

    name: str
    description: str
    parameter_set: str
    database: Any
    signals: Mapping[str, SignalSource]
    acceleration: CommandTarget
    compressor: CommandTarget | None
    protection: Protection
    limits: ActuationLimits


def available_vehicles() -> list[str]:
    """Return the names of the shipped vehicles."""
    return sorted(path.parent.name for path in VEHICLES.glob("*/vehicle.yaml"))


def load_vehicle(name_or_folder: str) -> Vehicle:
    """Return a shipped vehicle by its name, or a user's own by its folder.

    Raises:
        ParameterError: there is none, or its files are malformed.
    """
    folder = VEHICLES / name_or_folder
    if not (folder / "vehicle.yaml").is_file():
        folder = Path(name_or_folder)
    path = folder / "vehicle.yaml"
    if not path.is_file():
        known = ", ".join(available_vehicles())
        raise ParameterError(
            f"vehicle is {shown(name_or_folder)}; allowed: {known}, or a folder with vehicle.yaml"
        )
    texts = ("description", "parameter_set", "database")
    keys = (*texts, "signals", "commands", "protection", "limits")
    written = StrictMapping(read_yaml(path), str(path), keys, error=ParameterError)
    database = _database(folder / written.text("database"))
    wanted = written.section("signals", SIGNALS, kind="signal")
    wanted.require(*REQUIRED)
    signals = {
        name: _source(wanted.section(name, ("message", "signal", "timeout_s")), name, database)
        for name in wanted
    }
    commands = written.section("commands", ("acceleration", "compressor"))
    commands.require("acceleration")
    targets = {
        name: _target(commands.section(name, ("message", "signal", "enable")), unit, database)
        for name, unit in (("acceleration", "m/s^2"), ("compressor", "W"))
        if name in commands
    }
    if not targets["acceleration"].enable:
        # A request that cannot be taken back would count while the suite is not engaged.
        commands.section("acceleration").refuse("enable", "the signal that is 1 while it counts")
    names = tuple(entry.name for entry in fields(ActuationLimits))
    limits = written.section("limits", names)
    limits.require(*names)
    protection = written.section("protection", ("counter", "checksum"))
    parameter_set = written.text("parameter_set")
    if parameter_set not in available_parameter_sets():
        written.refuse("parameter_set", ", ".join(available_parameter_sets()))
    return Vehicle(
        name=folder.name,
        description=written.text("description"),
        parameter_set=parameter_set,
        database=database,
        signals=signals,
        acceleration=targets["acceleration"],
        compressor=targets.get("compressor"),
        protection=Protection(**{key: protection.text(key) for key in protection}),
        limits=ActuationLimits(**{name: limits.number(name) for name in names}),
    )


def _database(path: Path) -> Any:
    if not path.is_file():
        raise ParameterError(f"{path}: no such file; allowed: a DBC")
    database = library("cantools").database
    try:
        return database.load_file(path, strict=False)
    except Exception as error:
        raise ParameterError(f"{path}: cannot be read as a DBC: {error}") from error


def _signal(written: StrictMapping, message: str, name: str, database: Any) -> Any:
    """Return a signal of the DBC."""
    messages = {each.name: each for each in database.messages}
    if message not in messages:
        written.refuse("message", f"one of the DBC: {', '.join(sorted(messages))}")
    signals = {each.name: each for each in messages[message].signals}
    if name not in signals:
        written.refuse("signal", f"one of {message}: {', '.join(sorted(signals))}")
    return signals[name]


def _unit(written: StrictMapping, signal: Any, unit: str) -> tuple[float, float]:
    """Return factor and offset from the unit of the DBC to SI."""
    si, factor, offset = UNITS.get(signal.unit or "", (None, 0.0, 0.0))
    if si != unit:
        stated = ", ".join(repr(name) for name, (to, *_) in UNITS.items() if to == unit)
        written.refuse("signal", f"one in {stated}; the DBC states {signal.unit!r}")
    return factor, offset


def _source(written: StrictMapping, name: str, database: Any) -> SignalSource:
    message, signal = written.text("message"), written.text("signal")
    found = _signal(written, message, signal, database)
    timeout_s = written.number("timeout_s")
    if not 0.01 <= timeout_s <= 60.0:
        written.refuse("timeout_s", "0.01 to 60")
    return SignalSource(message, signal, timeout_s, *_unit(written, found, SIGNALS[name]))


def _target(written: StrictMapping, unit: str, database: Any) -> CommandTarget:
    message, signal = written.text("message"), written.text("signal")
    found = _signal(written, message, signal, database)
    enable = written.text("enable", "")
    if enable:
        _signal(written, message, enable, database)
    return CommandTarget(message, signal, enable, *_unit(written, found, unit))
