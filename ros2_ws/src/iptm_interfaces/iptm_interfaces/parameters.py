"""Node parameters as a frozen dataclass: declared with unit and range, checked with one clear line.

    @dataclass(frozen=True)
    class BridgeParameters:
        latency_s: float = parameter(0.0, "age of a prediction on arrival", "s", 0.0, 60.0)

    parameters = declare_parameters(node, BridgeParameters)

The descriptors carry description, unit and range, so `ros2 param describe` shows them. Parameters are
read-only: a run is described by what it was started with. A whole number is accepted for a float
(`latency_s:=1`), which plain ROS refuses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from iptm_core.errors import ParameterError

Value = (
    bool
    | int
    | float
    | str
    | tuple[bool, ...]
    | tuple[int, ...]
    | tuple[float, ...]
    | tuple[str, ...]
)
D = TypeVar("D")


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter of a node.

    Attributes:
        name: parameter name, dots allowed.
        default: value without override; its type is the type of the parameter. A tuple is an array
            and must not be empty, because ROS cannot tell the type of an empty one.
        description: what it does, in a few words.
        unit: unit of the value, empty for none.
        minimum: smallest permitted number, also for every entry of an array.
        maximum: largest permitted number.
        choices: permitted texts, empty for any.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """Return what is permitted, in words."""
        kind = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}[
            type(_sample(self.default))
        ]
        if self.choices:
            kind = "one of " + ", ".join(self.choices)
        bounds = {
            (True, True): f" from {self.minimum:g} to {self.maximum:g}",
            (True, False): f", at least {self.minimum:g}",
            (False, True): f", at most {self.maximum:g}",
            (False, False): "",
        }[math.isfinite(self.minimum), math.isfinite(self.maximum)]
        text = kind + bounds + (f" {self.unit}" if self.unit and bounds else "")
        return f"a list, each {text}" if isinstance(self.default, tuple) else text


def parameter(
    default: Value,
    description: str,
    unit: str = "",
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a dataclass field as a node parameter; see `ParameterSpec`."""
    metadata = {
        "description": description,
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "choices": choices,
    }
    return field(default=default, metadata=metadata)


def parameter_specs(description: type[Any], prefix: str = "") -> tuple[ParameterSpec, ...]:
    """Return the parameters that a dataclass of `parameter` fields describes.

    Args:
        description: the dataclass.
        prefix: put in front of every name, e.g. `limiter.`.
    """
    specs = []
    for entry in fields(description):
        default: Any = entry.default
        specs.append(ParameterSpec(prefix + entry.name, default, **entry.metadata))
    return tuple(specs)


def declare_parameters(node: Node, description: type[D], prefix: str = "") -> D:
    """Declare the parameters of a dataclass on a node and return them, checked, as an instance.

    Raises:
        ParameterError: an override has the wrong type, is not finite or out of range.
    """
    specs = parameter_specs(description, prefix)
    values = [declare_parameter(node, spec) for spec in specs]
    names = [entry.name for entry in fields(description)]  # type: ignore[arg-type]
    return description(**dict(zip(names, values, strict=True)))


def declare_parameter(node: Node, spec: ParameterSpec) -> Value:
    """Declare one parameter on a node and return its checked value.

    Raises:
        ParameterError: the override has the wrong type, is not finite or out of range.
    """
    # Looked at first without a type: ROS would refuse whole numbers for floats, and its own errors
    # neither name the range nor stop NaN.
    probe = ParameterDescriptor(dynamic_typing=True)
    given = node.declare_parameter(spec.name, _ros_value(spec.default), probe).value
    node.undeclare_parameter(spec.name)
    value = checked_value(spec, given)
    node.declare_parameter(spec.name, _ros_value(value), _descriptor(spec), ignore_override=True)
    return value


def checked_value(spec: ParameterSpec, given: object) -> Value:
    """Return a given value in the type of the parameter.

    Raises:
        ParameterError: wrong type, not finite or out of range.
    """
    if not isinstance(spec.default, tuple):
        return _checked_scalar(spec, given, type(spec.default), given)
    if isinstance(given, (str, bytes)) or not isinstance(given, Sequence) or not given:
        raise _error(spec, given)
    kind = type(spec.default[0])
    return tuple(_checked_scalar(spec, entry, kind, given) for entry in given)


def _checked_scalar(spec: ParameterSpec, entry: object, kind: type, given: object) -> Any:
    if kind is float and type(entry) is int:
        entry = float(entry)
    if type(entry) is not kind:
        raise _error(spec, given)
    if isinstance(entry, (int, float)) and not isinstance(entry, bool):
        # NaN fails this comparison as well; infinity is refused even without a bound.
        inside = spec.minimum <= entry <= spec.maximum and math.isfinite(entry)
        if not inside:
            raise _error(spec, given)
    if spec.choices and entry not in spec.choices:
        raise _error(spec, given)
    return entry


def _error(spec: ParameterSpec, given: object) -> ParameterError:
    kinds = {bool: "bool", int: "integer", float: "float", str: "text"}
    kind = kinds.get(type(given), type(given).__name__)
    return ParameterError(f"parameter {spec.name} is {given!r} ({kind}); allowed: {spec.allowed}")


def _sample(default: Value) -> bool | int | float | str:
    return default[0] if isinstance(default, tuple) else default


def _ros_value(value: Value) -> object:
    return list(value) if isinstance(value, tuple) else value


def _descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    unit = f" [{spec.unit}]" if spec.unit else ""
    descriptor = ParameterDescriptor(
        description=spec.description + unit,
        additional_constraints=spec.allowed,
        read_only=True,
    )
    # ROS knows ranges of scalars only, and none that is open at one end; float limits stand in.
    largest = {float: 1.7e308, int: 2**63 - 1}.get(type(spec.default))
    if largest is None or not (math.isfinite(spec.minimum) or math.isfinite(spec.maximum)):
        return descriptor
    low = max(spec.minimum, -largest)
    high = min(spec.maximum, largest)
    if isinstance(spec.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
        ]
    else:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=0)]
    return descriptor


def parameter_table_markdown(specs: tuple[ParameterSpec, ...]) -> str:
    """Return a table of parameters for the documentation."""
    lines = ["| parameter | default | unit | allowed | meaning |", "|---|---|---|---|---|"]
    lines += [
        f"| `{s.name}` | `{_ros_value(s.default)}` | {s.unit or '-'} | {s.allowed} "
        f"| {s.description} |"
        for s in specs
    ]
    return "\n".join(lines) + "\n"


def overrides_for(instance: object, prefix: str = "") -> Mapping[str, object]:
    """Return a dataclass of parameters as the mapping that a parameter file holds."""
    return {
        prefix + entry.name: _ros_value(getattr(instance, entry.name))
        for entry in fields(instance)  # type: ignore[arg-type]
    }
