"""Parameters declared once: a frozen dataclass whose fields carry unit, range, choices and meaning.

    @dataclass(frozen=True)
    class LinkSettings(Settings):
        latency_s: float = parameter(0.0, "age of a prediction on arrival", "s", 0.0, 60.0)

An instance holds only permitted values, whether built by a node, a scenario file or a study. Code that
needs the same parameter inherits from the group or refers to its declaration with `declared`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from enum import Enum
from typing import Any, TypeVar

from iptm_core.errors import ParameterError
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S
from iptm_core.user_input import is_path, nearest, shown


class TextEnum(str, Enum):
    """Members are their words, also inside texts."""

    def __str__(self) -> str:
        """Return the bare word."""
        return str(self.value)


_ROUND_OFF = 1e-9
"""-20 degC are 253.14999999999998 K: by this share a number may be outside of its range."""

Scalar = bool | int | float | str
"""A value as files and messages hold it."""

Value = Scalar | Enum
"""A value as the code holds it; an `Enum` of texts is written by the value of its members."""


@dataclass(frozen=True)
class ParameterSpec:
    """The declaration of one parameter.

    Attributes:
        name: name of the field; of a model parameter the dotted key, ``group.field``.
        default: default value; its type is the type of the parameter. The type itself where a value is
            required.
        unit: unit of the value, empty for none.
        choices: permitted texts, empty for any.
        suffixes: of files that are permitted in addition to the choices.
        symbol: symbol of a model parameter.
    """

    name: str
    default: Any
    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    suffixes: tuple[str, ...] = ()
    optional: bool = False
    symbol: str = ""

    @property
    def required(self) -> bool:
        """Whether it has to be given."""
        return isinstance(self.default, type)

    @property
    def kind(self) -> type[Scalar]:
        """Type of the value as it is written."""
        kind: type[Scalar] = self.default if self.required else type(plain(self.default))
        return kind

    @property
    def allowed(self) -> str:
        """The permitted values, in words."""
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
        kind = "one of " + ", ".join(self.choices) if self.choices else words[self.kind]
        kind += f", the path of a file ({', '.join(self.suffixes)})" if self.suffixes else ""
        bounds = {
            (True, True): f" from {self.minimum:g} to {self.maximum:g}",
            (True, False): f", at least {self.minimum:g}",
            (False, True): f", at most {self.maximum:g}",
            (False, False): "",
        }[math.isfinite(self.minimum), math.isfinite(self.maximum)]
        return kind + bounds + (f" {self.unit}" if self.unit and bounds else "")


def parameter(
    default: Value,
    description: str,
    unit: str = "",
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
    suffixes: tuple[str, ...] = (),
) -> Any:
    """Declare a dataclass field as a parameter; see `ParameterSpec`."""
    if isinstance(default, Enum):
        choices = tuple(member.value for member in type(default))
    spec = ParameterSpec("", default, description, unit, minimum, maximum, choices, suffixes)
    return field(default=default, metadata={"spec": spec})


def quantity(
    symbol: str, unit: str, minimum: float, maximum: float, neutral: float | None = None
) -> Any:
    """Declare a number with the paper's symbol, its unit and its closed range; see `ParameterSpec`.

    Args:
        neutral: value at which a law that refines the paper's changes nothing. It counts where a set does
            not state the parameter; without one the parameter is required.
    """
    default = float if neutral is None else neutral
    spec = ParameterSpec("", default, "", unit, minimum, maximum, symbol=symbol)
    return field(default=MISSING if neutral is None else neutral, metadata={"spec": spec})


def has_effect(value: object, neutral: float = 0.0) -> bool:
    """Return whether a number is other than the one that changes nothing; an expression is taken to be."""
    return not isinstance(value, (int, float)) or value != neutral


def count(symbol: str, minimum: int, maximum: int) -> Any:
    """Declare a whole number; see `quantity`."""
    spec = ParameterSpec("", int, "", "1", minimum, maximum, symbol=symbol)
    return field(metadata={"spec": spec})


#: (unit written, unit of the model) -> (factor, offset added after dividing); value / factor + offset
_CONVERSIONS: dict[tuple[str, str], tuple[float, float]] = {
    ("degC", "K"): (1.0, CELSIUS_ZERO_K),
    ("km/h", "m/s"): (KM_H_PER_M_S, 0.0),
}


def accepted_units(unit: str) -> tuple[str, ...]:
    """Units in which a quantity with the model unit ``unit`` may be written, the model unit first."""
    return (unit, *(written for written, model in _CONVERSIONS if model == unit))


def to_model_unit(value: float, written_unit: str, unit: str) -> float:
    """Convert to the unit of the model; a value in that unit is unchanged to the last bit."""
    if written_unit == unit:
        return value
    divisor, offset = _CONVERSIONS[written_unit, unit]
    return value / divisor + offset


def declared(owner: type[Any], name: str, default: Any = MISSING, **bounds: float) -> Any:
    """Declare a field by the declaration of another class; a default of None makes it optional."""
    (entry,) = (entry for entry in fields(owner) if entry.name == name)
    spec: ParameterSpec = replace(entry.metadata["spec"], optional=default is None, **bounds)
    if default is MISSING:
        default = entry.default
    elif default is not None:
        spec = replace(spec, default=default)
    return field(default=default, metadata={"spec": spec})


def parameter_specs(description: type[Any]) -> tuple[ParameterSpec, ...]:
    """Return the parameters that a dataclass and its bases declare."""
    return tuple(
        replace(entry.metadata["spec"], name=entry.name)
        for entry in fields(description)
        if "spec" in entry.metadata
    )


Group = TypeVar("Group", bound="Settings")


@dataclass(frozen=True)
class Settings:
    """Base of dataclasses of parameters: each value is checked (`ParameterError`), brought to its type."""

    def __post_init__(self) -> None:
        for spec in parameter_specs(type(self)):
            value = checked_value(spec, getattr(self, spec.name))
            object.__setattr__(self, spec.name, value)

    @classmethod
    def of(cls: type[Group], composed: Settings) -> Group:  # noqa: PYI019  Self needs Python 3.11
        """Return the settings of this group out of a composition of groups."""
        return cls(**{spec.name: getattr(composed, spec.name) for spec in parameter_specs(cls)})


def given_settings(group: type[Group], given: Mapping[str, Any]) -> Group:
    """Return the settings of a group as far as they are among others; the rest are defaults."""
    names = [spec.name for spec in parameter_specs(group)]
    return group(**{name: given[name] for name in names if name in given})


def checked_value(spec: ParameterSpec, given: Any) -> Any:
    """Return a given value in the type of the parameter; a whole number is welcome for a float."""
    if given is None and spec.optional:
        return None
    value: Any = plain(given) if isinstance(given, Enum) else given
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if spec.kind is float:
            value = without_round_off(spec, _as_float(value))
        if not _is_inside(spec, value):
            raise _error(spec, given)
    if type(value) is not spec.kind:
        raise _error(spec, given)
    is_file = spec.suffixes and is_path(str(value), spec.suffixes)
    if spec.choices and value not in spec.choices and not is_file:
        raise _error(spec, given)
    return type(spec.default)(value) if isinstance(spec.default, Enum) else value


def plain(value: Value) -> Scalar:
    """Return a value as files and messages hold it: a text for an `Enum`."""
    return str(value.value) if isinstance(value, Enum) else value


def without_round_off(spec: ParameterSpec, number: float) -> float:
    """Return a number; beyond an end of the range by the round-off of a conversion, that end."""
    end = min(max(number, spec.minimum), spec.maximum)
    return end if math.isclose(number, end, rel_tol=_ROUND_OFF) else number


def _is_inside(spec: ParameterSpec, number: float) -> bool:
    # NaN fails the first comparison as well; infinity is refused even without a bound.
    return spec.minimum <= number <= spec.maximum and abs(number) < math.inf


def _as_float(number: float) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf


def _error(spec: ParameterSpec, given: object) -> ParameterError:
    kinds = {bool: "bool", int: "integer", float: "float", str: "text"}
    kind = kinds.get(type(given), type(given).__name__)
    if spec.kind is str and isinstance(given, str):
        near = nearest(given, spec.choices)
        hint = f"did you mean {near!r}? " if near else ""
        return ParameterError(f"{spec.name} is {shown(given)}; {hint}allowed: {spec.allowed}")
    return ParameterError(f"{spec.name} is {shown(given)} ({kind}); allowed: {spec.allowed}")
