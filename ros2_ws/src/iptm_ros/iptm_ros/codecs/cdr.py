"""Serialised messages (CDR, the encoding of DDS), and tables of numbers that encode and decode them.

Building and serialising a message object of which only the stamp and some numbers change takes Python much
longer than its few numbers justify, about a dozen times per tick. The layout of the bytes is constant, so
they are built once and only the numbers are written afterwards. An encoder provides both from one definition
of the numbers: the message object, and its bytes for `Publisher.publish`. Every decoder raises a
`MessageError` with the topic, the value and the rule where a message breaks its promise.

Named values are the `position[]` of a `sensor_msgs/JointState`; their names carry the units.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import update_wrapper
from operator import attrgetter
from typing import Any, Generic, NoReturn, ParamSpec

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S, SPEED_AT_REST_M_S
from iptm_ros.codecs.numbers import Numbers
from iptm_ros.codecs.time import time_from_ns
from iptm_ros.message_types import AccelStamped, Header, JointState, Odometry, Temperature
from iptm_ros.topics import (
    EGO_FRAME,
    LEADER_FRAME,
    PACK_FRAME,
    ROAD_FRAME,
    TOPICS,
    Topic,
    frame_in,
)

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # the first field of a clock and of every header, after the encapsulation


def serialized(message: Any) -> bytes:
    """Return the bytes of a message, none more.

    `rclpy.serialization.serialize_message` returns a buffer whose length is an upper estimate: after empty
    float64 arrays it ends with uninitialised memory, which strict readers refuse. The message is the shortest
    prefix that can be deserialised. That takes a moment per surplus byte, which callers with a fixed layout
    spend once.
    """
    from rclpy.serialization import serialize_message  # noqa: PLC0415  readers of bags do without ROS

    data = bytes(serialize_message(message))
    end = len(data)
    while _is_whole(data[: end - 1], type(message)):
        end -= 1
    return data[:end]


def stamp_ns_of(data: bytes) -> int:
    """Return the stamp of a clock or of a message that starts with a header, from its bytes.

    Raises:
        MessageError: the bytes end before.
    """
    least = _STAMP_AT + _STAMP.size
    if len(data) < least:
        raise MessageError(f"message has {len(data)} bytes; allowed: at least {least}")
    seconds, nanoseconds = _STAMP.unpack_from(data, _STAMP_AT)
    return int(seconds) * NS_PER_S + int(nanoseconds)


def put_stamp(data: bytearray, stamp_ns: int) -> None:
    """Write the stamp of a message that starts with a header into its bytes."""
    stamp = time_from_ns(stamp_ns)
    _STAMP.pack_into(data, _STAMP_AT, stamp.sec, stamp.nanosec)


def _is_whole(data: bytes, message_type: type[Any]) -> bool:
    """Return whether bytes hold all fields of a message."""
    from rclpy.serialization import deserialize_message  # noqa: PLC0415  as above

    try:
        deserialize_message(data, message_type)
    except Exception:  # noqa: BLE001  the binding raises error types of its own
        return False
    return True


P = ParamSpec("P")

StampedNumbers = tuple[int, Sequence[float]]
"""Stamp in integer nanoseconds, and the numbers in the order of the table."""
LARGEST = sys.float_info.max
_FINITE = "a finite number"


def reject(topic: Topic, reason: str) -> NoReturn:
    """Raise the error of a message that breaks the promise of its topic."""
    raise MessageError(f"{topic.value}: {reason}")


@dataclass(frozen=True)
class Number:
    """One float64 of a message.

    Attributes:
        name: in refusals, and of a named value in the message.
        place: field of the message, such as `twist.twist.linear.x`; empty for a named value.
        least: smallest value.
        most: largest value.
        allowed: both in words.
        may_be_unknown: it may be NaN or infinite.
        may_be_missing: it may be missing among named values.
    """

    name: str
    place: str = ""
    least: float = -LARGEST
    most: float = LARGEST
    allowed: str = _FINITE
    may_be_unknown: bool = False
    may_be_missing: bool = False

    def refuse(self, topic: Topic, value: float) -> None:
        """Refuse a value outside of the range, unless it is unknown and may be."""
        is_finite = math.isfinite(value)
        if is_finite or not self.may_be_unknown:
            reject(topic, f"{self.name} is {value}; allowed: {self.allowed}")


class NumberMessage:
    """A message with a header, given by an example, and the numbers in it that change.

    Args:
        build: returns a new message whose texts and lists have their final lengths.
        numbers: in the order in which they are encoded and decoded.
    """

    def __init__(self, build: Callable[[], Any], *numbers: Number) -> None:
        self.numbers = numbers
        self._build = build
        self._names = [number.name for number in numbers]
        self._limits = [(number.least, number.most, number) for number in numbers]
        self._readers = [attrgetter(number.place) for number in numbers if number.place]
        self._forms: dict[str, tuple[bytes, struct.Struct | None, tuple[int, ...]]] = {}

    def message(self, stamp_ns: int, values: Sequence[float]) -> Any:
        """Return a message with these numbers; `MessageError` for a stamp that no message can carry."""
        message = self._build()
        message.header.stamp = time_from_ns(stamp_ns)
        if not self._readers:
            message.position = [float(value) for value in values]
            return message
        for number, value in zip(self.numbers, values, strict=True):
            parent, _, name = number.place.rpartition(".")
            setattr(attrgetter(parent)(message) if parent else message, name, float(value))
        return message

    def data(self, stamp_ns: int, values: Sequence[float], prefix: str) -> bytes:
        """Return the bytes of the message, its frames with the prefix of a vehicle."""
        form = self._forms.get(prefix)
        if form is None:
            form = self._forms[prefix] = self._form(prefix)
        start, adjacent, offsets = form
        data = bytearray(start)
        put_stamp(data, stamp_ns)
        if adjacent is not None:
            adjacent.pack_into(data, offsets[0], *values)
        else:
            for offset, value in zip(offsets, values, strict=True):
                struct.pack_into("<d", data, offset, value)
        return bytes(data)

    def _form(self, prefix: str) -> tuple[bytes, struct.Struct | None, tuple[int, ...]]:
        """Find out where the numbers lie: a value of its own in each place, looked for in the bytes."""
        count = len(self.numbers)
        marks = [1.0e300 * (1.0 + index / (count + 1.0)) for index in range(count)]
        message = self.message(0, marks)
        message.header.frame_id = frame_in(prefix, message.header.frame_id)
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = frame_in(prefix, message.child_frame_id)
        data = serialized(message)
        offsets = tuple(data.index(struct.pack("<d", mark)) for mark in marks)
        neighbours = tuple(offsets[0] + 8 * index for index in range(count))
        return data, struct.Struct(f"<{count}d") if offsets == neighbours else None, offsets

    def read(self, topic: Topic, message: Any) -> list[float]:
        """Return the numbers of a message.

        Named values may come in another order and with others, which are ignored.

        Raises:
            MessageError: a number is missing or out of its range; names and values differ in number.
        """
        if type(message) is Numbers:
            values = list(message.values)
        else:
            values = [read(message) for read in self._readers] or self._named(topic, message)
        for value, (least, most, number) in zip(values, self._limits, strict=True):
            if not least <= value <= most:
                number.refuse(topic, value)
        return values

    def _named(self, topic: Topic, message: JointState) -> list[float]:
        names, values = message.name, message.position
        if len(values) != len(names):
            reject(topic, f"{len(names)} names but {len(values)} values")
        if names == self._names:
            return list(values)
        by_name = dict(zip(names, values, strict=True))
        missing = [
            number.name
            for number in self.numbers
            if number.name not in by_name and not number.may_be_missing
        ]
        if missing:
            reject(topic, f"missing {', '.join(missing)}; got {', '.join(names) or 'no names'}")
        return [by_name.get(name, math.nan) for name in self._names]


class Encoder(Generic[P]):
    """Encodes what a function reduces to numbers, as a message or as its bytes."""

    def __init__(self, layout: NumberMessage, numbers: Callable[P, StampedNumbers]) -> None:
        self._layout = layout
        self._numbers = numbers
        update_wrapper(self, numbers)

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> Any:
        """Return the message, with the frames of the topic table."""
        return self._layout.message(*self._numbers(*arguments, **named))

    def data(self, prefix: str, *arguments: P.args, **named: P.kwargs) -> bytes:
        """Return the bytes of the message, with the frames of a vehicle."""
        return self._layout.data(*self._numbers(*arguments, **named), prefix)


def encoder(topic: Topic) -> Callable[[Callable[P, StampedNumbers]], Encoder[P]]:
    """Return a decorator that makes an encoder of a function that returns stamp and numbers of a topic."""
    return lambda numbers: Encoder(LAYOUTS[topic], numbers)


def read_numbers(topic: Topic, message: Any) -> list[float]:
    """Return the numbers of a message in the order of the table, see `NumberMessage.read`."""
    return LAYOUTS[topic].read(topic, message)


_RANGES: Mapping[str, tuple[float, float, str]] = {
    "speed_m_s": (SPEED_AT_REST_M_S, LARGEST, f"at least {SPEED_AT_REST_M_S:g} m/s"),
    "service_braking_s": (0.0, LARGEST, f"{_FINITE}, at least 0"),
    "brake_share": (0.0, 1.0, "0 to 1"),
    "command_source": (0.0, 2.0, "0, 1 or 2"),
}
"""Least and most of values of the plant's state, and both in words; others are any finite numbers."""
_OF_THE_PACK = tuple(TOPICS[Topic.PLANT_STATE].fields)[3:8]
"""Values of the plant's state that are published but not judged here: the controller does without sensors."""
_MAY_BE_UNKNOWN: Mapping[Topic, Sequence[str]] = {
    Topic.PLANT_STATE: tuple(TOPICS[Topic.PLANT_STATE].fields)[3:],
    Topic.ENGAGEMENT: tuple(TOPICS[Topic.ENGAGEMENT].fields)[1:],
    Topic.SOLVE: (
        "solve_time_s",
        "gap_slack_m",
        "speed_slack_m_s",
        "temperature_slack_k",
        "objective",
        "preview_age_s",
        "cell_1_marginal_cost_1_k",
        "cell_n_marginal_cost_1_k",
        "aging_rate_1_s",
        "aging_sensitivity_1_k",
        "temperature_decay_time_s",
        "trusted_preview_s",
        "command_delay_s",
        "brake_share",
        "solve_wall_time_s",
    ),
}


def _named_values(topic: Topic) -> NumberMessage:
    spec = TOPICS[topic]
    names, unknown = list(spec.fields), _MAY_BE_UNKNOWN.get(topic, ())
    missing = unknown if topic is not Topic.PLANT_STATE else unknown[len(_OF_THE_PACK) :]
    ranges = _RANGES if topic is Topic.PLANT_STATE else {}

    def build() -> JointState:
        header = Header(frame_id=spec.frame)
        return JointState(header=header, name=names, position=[0.0] * len(names))

    def number(name: str) -> Number:
        least, most, allowed = ranges.get(name, (-LARGEST, LARGEST, _FINITE))
        return Number(name, "", least, most, allowed, name in unknown, name in missing)

    return NumberMessage(build, *map(number, names))


def _motion(body: str) -> NumberMessage:
    at_rest = f"at least {SPEED_AT_REST_M_S:g} m/s"
    return NumberMessage(
        lambda: Odometry(header=Header(frame_id=ROAD_FRAME), child_frame_id=body),
        Number("position", "pose.pose.position.x"),
        Number("speed", "twist.twist.linear.x", SPEED_AT_REST_M_S, allowed=at_rest),
    )


_TEMPERATURE = NumberMessage(
    lambda: Temperature(header=Header(frame_id=PACK_FRAME)), Number("temperature", "temperature")
)

LAYOUTS: Mapping[Topic, NumberMessage] = {
    Topic.PLANT_ODOMETRY: _motion(EGO_FRAME),
    Topic.LEADER: _motion(LEADER_FRAME),
    Topic.PLANT_ACCELERATION: NumberMessage(
        lambda: AccelStamped(header=Header(frame_id=EGO_FRAME)),
        Number("acceleration", "accel.linear.x"),
    ),
    **{topic: _TEMPERATURE for topic, spec in TOPICS.items() if spec.message_type is Temperature},
    **{
        topic: _named_values(topic)
        for topic, spec in TOPICS.items()
        if spec.message_type is JointState and topic is not Topic.ROAD_AHEAD
    },
}
"""The messages that are a stamp and some numbers, by topic."""
