"""Node parameters: a dataclass of `iptm_core.declaration.parameter` fields, declared on a ROS node.

    parameters = declare_parameters(node, BridgeNodeParameters)

The descriptors carry description, unit and range, so `ros2 param describe` shows them. Parameters are
read-only, as a run is described by what it was started with, except those that a node declares changeable
and reports. A whole number is accepted for a float (`latency_s:=1`), which plain ROS refuses.

The friction of the road is a parameter to begin with; published values follow.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from std_msgs.msg import Float64

from iptm_core.braking import MOST_FRICTION
from iptm_core.declaration import ParameterSpec, Value, checked_value, parameter_specs, plain
from iptm_core.errors import MessageError, ParameterError
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

D = TypeVar("D")


def declare_parameters(node: Node, description: type[D], changeable: Collection[str] = ()) -> D:
    """Declare the parameters of a dataclass on a node and return them, checked, as an instance.

    Raises:
        ParameterError: an override has the wrong type, is not finite or out of range.
    """
    values: dict[str, Any] = {
        spec.name: _declare_parameter(node, spec, read_only=spec.name not in changeable)
        for spec in parameter_specs(description)
    }
    return description(**values)


def _declare_parameter(node: Node, spec: ParameterSpec, *, read_only: bool) -> Value:
    # Looked at first without a type: ROS would refuse whole numbers for floats, and its own errors
    # neither name the range nor stop NaN.
    probe = ParameterDescriptor(dynamic_typing=True)
    given = node.declare_parameter(spec.name, plain(spec.default), probe).value
    node.undeclare_parameter(spec.name)
    try:
        value: Value = checked_value(spec, given)
    except ParameterError as error:
        raise ParameterError(f"parameter {error}") from None
    node.declare_parameter(
        spec.name, plain(value), _descriptor(spec, read_only=read_only), ignore_override=True
    )
    return value


def _descriptor(spec: ParameterSpec, *, read_only: bool) -> ParameterDescriptor:
    unit = f" [{spec.unit}]" if spec.unit else ""
    descriptor = ParameterDescriptor(
        description=spec.description + unit,
        additional_constraints=spec.allowed,
        read_only=read_only,
    )
    # ROS has ranges for scalars only, closed at both ends; float limits stand in for open ends.
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


VALID_S = 60.0
"""Wall time for which a value counts that is not repeated."""


class FrictionInput:
    """Listens to `sensor/road_friction`.

    Args:
        node: that listens.
        default: coefficient of friction while nothing is published; 0: not known.
    """

    def __init__(self, node: SuiteNode, default: float) -> None:
        self._node, self._default = node, default
        self._heard = 0.0
        self._heard_s = -math.inf
        node.listen(Topic.ROAD_FRICTION, self._on_friction)

    @property
    def coefficient(self) -> float:
        """The present value, 0 if unknown."""
        is_valid = self._node.awake.now_s() - self._heard_s <= VALID_S
        return self._heard if is_valid else self._default

    def _on_friction(self, message: Float64) -> None:
        if not 0.0 <= message.data <= MOST_FRICTION:
            raise MessageError(
                f"{Topic.ROAD_FRICTION.value} is {message.data}; allowed: 0 to {MOST_FRICTION:g}"
            )
        self._heard, self._heard_s = message.data, self._node.awake.now_s()
