"""Reads the folder of a vehicle: ``vehicle.yaml`` and a DBC for each of its buses."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, NoReturn

from iptm_core.errors import ParameterError
from iptm_core.parameters import available_parameter_sets
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import StrictMapping, shown
from iptm_drives.can_files import library
from iptm_vehicle_interface.channel import (
    ENABLES,
    FLAGS,
    REQUIRED,
    SIGNALS,
    ActuationLimits,
    CommandTarget,
    SignalSource,
    VehicleLink,
)
from iptm_vehicle_interface.protection import Checksum, ChecksumKind, Protection

VEHICLES = Path(__file__).parent / "vehicles"
ALL = "all"
"""In place of a message: all messages that have signals of these names."""

_NAMES: Mapping[tuple[str, float, float], str] = {
    ("m/s", 1.0, 0.0): "m/s, Unit_MeterPerSecon",
    ("m/s", 1.0 / 3.6, 0.0): "km/h, kph, km^h, kmh, Unit_KiloMeterPerHour",
    ("m/s", 0.44704, 0.0): "mph, Unit_MilesPerHour",
    ("m/s^2", 1.0, 0.0): "m/s2, m/s^2, m/s/s, Unit_MeterPerSeconSquar, Unit_MeterPerSquareSecond",
    ("m/s^2", 9.80665, 0.0): "g",
    ("m", 1.0, 0.0): "m, meter, meters, Unit_Meter",
    ("K", 1.0, 0.0): "K",
    ("K", 1.0, CELSIUS_ZERO_K): "degC, °C, C, deg C, degreesC, Degrees C, Cel, Unit_DegreCelsi",
    ("K", 5.0 / 9.0, CELSIUS_ZERO_K - 160.0 / 9.0): "F, degF, °F",
    ("V", 1.0, 0.0): "V, Volt, Volts, Unit_Volt",
    ("V", 1e-3, 0.0): "mV, Unit_MilliVolt",
    ("A", 1.0, 0.0): "A, Amp, Amps, Unit_Amper",
    ("W", 1.0, 0.0): "W, Unit_Watt",
    ("W", 1e3, 0.0): "kW, Unit_KiloWatt",
    ("1", 0.01, 0.0): "%, percent, Unit_PerCent",
    ("1", 1.0, 0.0): ", Unit_None, unitless, none",
}
UNITS: Mapping[str, tuple[str, float, float]] = {
    name: conversion for conversion, names in _NAMES.items() for name in names.split(", ")
}
"""SI unit, factor and offset by the unit that a DBC states, in the spellings of published files."""
_FOLDED = {name.casefold(): conversion for name, conversion in UNITS.items()}

_TARGET_KEYS = (
    "message", "signal", "enable", "same", "positive", "fixed", "active", "inactive", "copied", "hold",
    "resume", "levels",
)  # fmt: skip
_PROTECTION_KEYS = (
    "counter", "modulo", "checksum", "kind", "polynomial", "start", "final", "identifier", "by_counter",
)  # fmt: skip
_UNUSED = re.compile(r"^(?:VAL_|CM_)\s+(?:[^;\"]|\"(?:[^\"\\]|\\.)*\")*;", re.MULTILINE)
"""Comments and names of values, which in published files name signals that are not there."""
_PSEUDO = re.compile(r"^BO_ 3221225472 .*\n(?:\s+SG_ .*\n)*", re.MULTILINE)
"""The pseudo-message of signals without one."""
_IDENTIFIER = re.compile(r"^BO_ (\d+) ", re.MULTILINE)
_LARGEST_STANDARD, _EXTENDED = 0x7FF, 1 << 31
"""Published files state identifiers of 29 bits with and without the flag that marks them."""


def available_vehicles() -> list[str]:
    """Return the names of the shipped vehicles."""
    return sorted(path.parent.name for path in VEHICLES.glob("*/vehicle.yaml"))


def load_vehicle(name_or_folder: str) -> VehicleLink:
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
    return _Reader(folder, path).vehicle()


class _Reader:
    """Reads the parts of a vehicle; every refusal names the file, the value and what is allowed."""

    def __init__(self, folder: Path, path: Path) -> None:
        texts = ("description", "parameter_set", "database")
        keys = (*texts, "signals", "commands", "protection", "limits")
        self._folder = folder
        self._written = StrictMapping(read_yaml(path), str(path), keys, error=ParameterError)
        names = self._written.text("database").split(", ")
        self._databases = tuple(_database(folder / name) for name in names)
        self._messages: dict[str, Any] = {}
        for database in self._databases:
            for message in database.messages:
                if message.name in self._messages:
                    self._refuse("database", f"{message.name} in one of them")
                self._messages[message.name] = message

    def vehicle(self) -> VehicleLink:
        """Return the vehicle."""
        written = self._written
        parameter_set = written.text("parameter_set")
        if parameter_set not in available_parameter_sets():
            self._refuse("parameter_set", ", ".join(available_parameter_sets()))
        wanted = written.section("signals", SIGNALS, kind="signal")
        wanted.require(*REQUIRED)
        signals = {name: self._source(wanted, name) for name in wanted}
        if not signals.keys() & {*ENABLES}:
            wanted.refuse("enable_button", f"{' or '.join(ENABLES)}: only the driver engages")
        commands = written.section("commands", ("acceleration", "set_speed", "compressor"))
        if ("acceleration" in commands) == ("set_speed" in commands):
            commands.refuse("acceleration", "one of acceleration and set_speed")
        targets = {
            name: self._target(commands.section(name, _TARGET_KEYS), unit)
            for name, unit in (("acceleration", "m/s^2"), ("set_speed", "m/s"), ("compressor", "W"))
            if name in commands
        }
        for name in targets.keys() - {"compressor"}:
            if not targets[name].enable:
                # A request that cannot be taken back would count while the suite is not engaged.
                commands.section(name).refuse("enable", "the signal that is 1 while it counts")
        entries = fields(ActuationLimits)
        limits = written.section("limits", [entry.name for entry in entries])
        limits.require(*(entry.name for entry in entries if entry.default is MISSING))
        return VehicleLink(
            name=self._folder.name,
            description=written.text("description"),
            parameter_set=parameter_set,
            databases=self._databases,
            signals=signals,
            acceleration=targets.get("acceleration"),
            set_speed=targets.get("set_speed"),
            compressor=targets.get("compressor"),
            protections=self._protections(),
            limits=ActuationLimits(**{name: limits.number(name) for name in limits}),
        )

    def _refuse(self, key: str, allowed: str) -> NoReturn:
        self._written.refuse(key, allowed)

    def _signal(self, written: StrictMapping, message: str, name: str, key: str = "signal") -> Any:
        """Return a signal of the databases."""
        if message not in self._messages:
            written.refuse("message", f"one of the DBC: {', '.join(sorted(self._messages))}")
        signals = {each.name: each for each in self._messages[message].signals}
        if name not in signals:
            written.refuse(key, f"one of {message}: {', '.join(sorted(signals))}")
        return signals[name]

    def _source(self, wanted: StrictMapping, name: str) -> SignalSource:
        keys = ("message", "signal", "timeout_s", "values", "above", "unit")
        written = wanted.section(name, keys)
        message, signal = written.text("message"), written.text("signal")
        found = self._signal(written, message, signal)
        timeout_s = written.number("timeout_s")
        if not 0.01 <= timeout_s <= 60.0:
            written.refuse("timeout_s", "0.01 to 60")
        if name in FLAGS and {"values", "above"} & {*written}:
            values = frozenset(_numbers(written, "values")) if "values" in written else frozenset()
            above = written.number("above") if "above" in written else None
            return SignalSource(message, signal, timeout_s, values=values, above=above)
        factor, offset = _unit(written, found, SIGNALS[name])
        return SignalSource(message, signal, timeout_s, factor, offset)

    def _target(self, written: StrictMapping, unit: str) -> CommandTarget:
        message, signal = written.text("message"), written.text("signal")
        found = self._signal(written, message, signal)
        enable, hold, resume = (written.text(key, "") for key in ("enable", "hold", "resume"))
        levels = {}
        if "levels" in written:
            section = written.content["levels"]
            if not isinstance(section, Mapping) or not section:
                written.refuse("levels", "values of the signal by power in W")
            levels = {float(power_w): float(value) for power_w, value in section.items()}
        factor, offset = (1.0, 0.0) if levels else _unit(written, found, unit)
        given = {key: self._values(written, key) for key in ("fixed", "active", "inactive")}
        if enable:
            given["active"] = {enable: 1.0, **given["active"]}
            given["inactive"] = {enable: 0.0, **given["inactive"]}
        same, positive = (tuple(_texts(written, key)) for key in ("same", "positive"))
        copied = {name: self._copied(written, name) for name in written.section("copied")}
        named: dict[str, Iterable[str]] = {
            "enable": [enable], "hold": [hold], "resume": [resume], "same": same, "positive": positive,
            **given, "copied": copied,
        }  # fmt: skip
        for key, names in named.items():
            for name in filter(None, names):
                self._signal(written, message, name, key)
        if enable and given["active"][enable] == given["inactive"][enable]:
            written.refuse("active", f"another value of {enable} than in inactive")
        return CommandTarget(
            message, signal, enable, factor, offset, same, positive, given["fixed"], given["active"],
            given["inactive"], copied, hold, resume, levels,
        )  # fmt: skip

    def _values(self, written: StrictMapping, key: str) -> dict[str, float]:
        section = written.section(key)
        return {name: section.number(name) for name in section}

    def _copied(self, written: StrictMapping, name: str) -> tuple[str, str]:
        section = written.section("copied")
        message, _, signal = section.text(name).partition(".")
        if message not in self._messages:
            section.refuse(name, "MESSAGE.SIGNAL of the DBC")
        self._signal(section, message, signal, name)
        return message, signal

    def _protections(self) -> dict[str, Protection]:
        """Return what protects each message: by its name, else by the names of its signals."""
        written = self._written.section("protection", (ALL, *self._messages), kind="message")
        found = {}
        for name in written:
            section = written.section(name, _PROTECTION_KEYS)
            if name != ALL:
                found[name] = self._protection(section, name)
                continue
            needed = {section.text(key) for key in ("counter", "checksum") if key in section}
            for message, each in self._messages.items():
                if message not in written and needed <= {signal.name for signal in each.signals}:
                    found[message] = self._protection(section, message)
        return found

    def _protection(self, written: StrictMapping, message: str) -> Protection:
        counter, modulo = written.text("counter", ""), 0
        if counter:
            largest = 1 << self._signal(written, message, counter, "counter").length
            modulo = _number(written, "modulo", largest)
            if not 2 <= modulo <= largest:
                written.refuse("modulo", f"2 to {largest}")
        checksum = self._checksum(written, message, modulo) if "checksum" in written else None
        return Protection(counter, modulo, checksum)

    def _checksum(self, written: StrictMapping, message: str, modulo: int) -> Checksum:
        signal = self._signal(written, message, written.text("checksum"), "checksum")
        little = signal.byte_order == "little_endian"
        if signal.length not in {8, 16} or signal.start % 8 != (0 if little else 7):
            written.refuse("checksum", "a signal of one or two whole bytes")
        kind = ChecksumKind(written.choice("kind", [each.value for each in ChecksumKind]))
        most = (1 << signal.length) - 1
        numbers = {key: _number(written, key, 0) for key in ("polynomial", "start", "final")}
        for key, number in numbers.items():
            if not 0 <= number <= most:
                written.refuse(key, f"0 to {most:#x}")
        if (kind is ChecksumKind.CRC) != bool(numbers["polynomial"]):
            written.refuse("polynomial", "one for a CRC, none else")
        try:
            by_counter = tuple(bytes.fromhex(written.text("by_counter", "")))
        except ValueError:
            by_counter = (0,)
        if by_counter and len(by_counter) != modulo:
            allowed = f"{modulo} bytes, one by value of the counter, as hexadecimal digits"
            written.refuse("by_counter", allowed)
        identifier = written.content.get("identifier", False)
        if not isinstance(identifier, bool):
            written.refuse("identifier", "true or false")
        place, size = signal.start // 8, signal.length // 8
        return Checksum(
            place, size, little, kind, **numbers, has_identifier=identifier, by_counter=by_counter
        )


def _database(path: Path) -> Any:
    if not path.is_file():
        raise ParameterError(f"{path}: no such file; allowed: a DBC")
    load = library("cantools").database.load_string
    text = path.read_bytes().decode("utf-8", errors="replace")
    text = _PSEUDO.sub("", _UNUSED.sub("", text.replace("\r\n", "\n")))
    text = _IDENTIFIER.sub(_flagged, text)
    try:
        return load(text, database_format="dbc", strict=False)
    except Exception as error:
        raise ParameterError(f"{path}: cannot be read as a DBC: {error}") from error


def _flagged(found: re.Match[str]) -> str:
    """Return the beginning of a message with the flag of an identifier of 29 bits."""
    number = int(found[1])
    return f"BO_ {number | _EXTENDED if number > _LARGEST_STANDARD else number} "


def _unit(written: StrictMapping, signal: Any, unit: str) -> tuple[float, float]:
    """Return factor and offset to SI, from the unit of the DBC or, where that states none, of the folder."""
    stated = signal.unit or written.text("unit", "")
    found = UNITS.get(stated) or _FOLDED.get(stated.casefold(), ("", 0.0, 0.0))
    if found[0] != unit:
        allowed = ", ".join(repr(name) for name, (si, *_) in UNITS.items() if si == unit)
        written.refuse("signal", f"one in {allowed}; the DBC states {signal.unit!r}")
    return found[1:]


def _numbers(written: StrictMapping, key: str) -> list[float]:
    return [float(each) for each in _list(written, key, (int, float), "a list of numbers")]


def _texts(written: StrictMapping, key: str) -> list[str]:
    return [str(each) for each in _list(written, key, (str,), "a list of signals")]


def _list(written: StrictMapping, key: str, kinds: tuple[type, ...], allowed: str) -> list[Any]:
    found = written.entries(key) if key in written else []
    if not all(isinstance(each, kinds) and not isinstance(each, bool) for each in found):
        written.refuse(key, allowed)
    return found


def _number(written: StrictMapping, key: str, default: float) -> int:
    """Return a whole number, which may be hexadecimal: 0x1D."""
    given = written.content.get(key, default)
    if isinstance(given, str) and re.fullmatch("0x[0-9A-Fa-f]{1,8}", given):
        return int(given, 16)
    if not isinstance(given, int) or isinstance(given, bool):
        written.refuse(key, "a whole number")
    return given
