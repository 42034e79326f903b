"""Named values: a stamped vector of named float64 numbers in a `sensor_msgs/JointState`.

`position[]` carries the numbers whatever their unit; the names carry the units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import ParamSpec

from iptm_interfaces.codecs._checks import reject
from iptm_interfaces.codecs.fixed_layout import Encoder, FixedLayout, Numbers
from iptm_interfaces.message_types import (
    Header,
    JointState,
)
from iptm_interfaces.topics import FIELD_ALIASES, TOPICS, Topic

P = ParamSpec("P")

_NAMES: dict[Topic, list[str]] = {
    topic: list(spec.fields) for topic, spec in TOPICS.items() if spec.message_type is JointState
}


def _layout(topic: Topic) -> FixedLayout:
    names, frame = _NAMES[topic], TOPICS[topic].frame

    def build() -> JointState:
        header = Header(frame_id=frame)
        return JointState(header=header, name=names, position=[0.0] * len(names))

    return FixedLayout(build, [f"position[{index}]" for index in range(len(names))])


_LAYOUTS = {topic: _layout(topic) for topic in _NAMES}


def named_values(topic: Topic) -> Callable[[Callable[P, Numbers]], Encoder[P]]:
    """Return a decorator that makes an encoder of a function that returns the stamp and the values."""
    return partial(Encoder, _LAYOUTS[topic])


def decode_named_values(
    topic: Topic, message: JointState, optional: frozenset[str] = frozenset()
) -> tuple[float, ...]:
    """Return the numbers of a named-values message in the order of the topic table.

    The sender may use another order, former names and more names; unknown names are ignored.

    Args:
        topic: a topic of type `sensor_msgs/JointState`.
        message: the message received.
        optional: names whose value may be NaN or infinite (unknown) or missing: older senders and
            bags lack some of them.

    Raises:
        MessageError: names and values differ in number, a name is missing or a value not finite.
    """
    expected = _NAMES[topic]
    names: list[str] = message.name
    positions = message.position
    if len(positions) != len(names):
        reject(topic, f"{len(names)} names but {len(positions)} values")
    values: tuple[float, ...]
    if names == expected:
        values = tuple(positions)
    else:
        present = (FIELD_ALIASES.get(name, name) for name in names)
        by_name = dict(zip(present, positions, strict=True))
        missing = [name for name in expected if name not in by_name and name not in optional]
        if missing:
            reject(topic, f"missing {', '.join(missing)}; got {', '.join(names) or 'no names'}")
        values = tuple(by_name.get(name, math.nan) for name in expected)
    for name, value in zip(expected, values, strict=True):
        if not math.isfinite(value) and name not in optional:
            reject(topic, f"{name} is {value}; allowed: a finite number")
    return values
