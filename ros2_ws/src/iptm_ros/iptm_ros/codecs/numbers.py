"""Messages of which only the stamp and some numbers change: encoded and decoded by tables of the numbers.

Building and serialising such a message object takes Python much longer than its few numbers justify, about a
dozen times per tick. The layout of the bytes is constant, so they are built once and only the numbers are
written afterwards. They are read from bytes, too: to build a `nav_msgs/Odometry` of which two numbers count
takes 50 us, to read them 1 us; for a drive of ten hours, rclpy's deserialiser adds 3 s to `iptm info`. Bytes
of another form (names in another order, further values, another byte order) are left to the decoder of their
type.

Named values are the `position[]` of a `sensor_msgs/JointState`; their names carry the units.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, update_wrapper
from operator import attrgetter
from typing import Any, Generic, ParamSpec, final

from iptm_core.state import NS_PER_S, SPEED_AT_REST_M_S
from iptm_ros.codecs.cdr import (
    ENCAPSULATION,
    FRAME_AT,
    aligned,
    ns_from_time,
    put_stamp,
    reject,
    serialized,
    time_from_ns,
)
from iptm_ros.message_types import AccelStamped, Header, JointState, Odometry, Temperature
from iptm_ros.topics import TOPICS, Topic, frame_in

_LENGTH = struct.Struct("<I")
_STAMP_AND_LENGTH = struct.Struct("<iII")
_FROM_POSE_TO_SPEED = 8 * (7 + 36)
_MOTION_BYTES = _FROM_POSE_TO_SPEED + 8 * (6 + 36)
_NO_VELOCITY_NO_EFFORT = bytes(8)
P = ParamSpec("P")

StampedNumbers = tuple[int, Sequence[float]]
"""Stamp in integer nanoseconds, and the numbers in the order of the table."""
LARGEST = sys.float_info.max
_FINITE = "a finite number"


@final
class Numbers:
    """What counts of a message, in its place.

    Attributes:
        stamp_ns: of its header.
        packed: the numbers, float64 each, in the order of the topic table.
    """

    __slots__ = ("packed", "stamp_ns")

    def __init__(self, stamp_ns: int, packed: bytes) -> None:
        self.stamp_ns = stamp_ns
        self.packed = packed

    @property
    def values(self) -> Sequence[float]:
        """The numbers."""
        return struct.unpack(f"<{len(self.packed) // 8}d", self.packed)


def stamp_of(message: Any) -> int:
    """Return the stamp of a message with a header, or of its numbers, in integer nanoseconds."""
    return message.stamp_ns if type(message) is Numbers else ns_from_time(message.header.stamp)


def numbers_of(topic: Topic, data: bytes) -> Numbers | None:
    """Return the numbers of a message; None where its bytes have another form than the suite's."""
    kind = TOPICS[topic].message_type
    if len(data) < FRAME_AT or data[:4] != ENCAPSULATION:
        return None
    seconds, nanoseconds, frame_bytes = _STAMP_AND_LENGTH.unpack_from(data, 4)
    frame_end = FRAME_AT + frame_bytes
    stamp_ns = seconds * NS_PER_S + nanoseconds
    if kind is JointState and topic is not Topic.ROAD_AHEAD:  # its number of values varies
        at = _values_at(topic, frame_bytes)
        end = at + 8 * len(TOPICS[topic].fields)
        if data[end:] == _NO_VELOCITY_NO_EFFORT and _has_names(topic, data[FRAME_AT - 4 : at]):
            return Numbers(stamp_ns, data[at:end])
    elif kind is Odometry:
        child_at = aligned(frame_end, 4)
        if child_at + 4 > len(data):
            return None
        child_end = child_at + 4 + _LENGTH.unpack_from(data, child_at)[0]
        at = aligned(child_end, 8)
        speed_at = at + _FROM_POSE_TO_SPEED
        if len(data) == at + _MOTION_BYTES:
            return Numbers(stamp_ns, data[at : at + 8] + data[speed_at : speed_at + 8])
    return None


@lru_cache(maxsize=64)
def _values_at(topic: Topic, frame_bytes: int) -> int:
    """Return where the values of a `sensor_msgs/JointState` start."""
    at = aligned(FRAME_AT + frame_bytes, 4) + 4
    for name in TOPICS[topic].fields:
        at = aligned(at, 4) + 4 + len(name) + 1
    return aligned(aligned(at, 4) + 4, 8)


@lru_cache(maxsize=256)
def _has_names(topic: Topic, start: bytes) -> bool:
    """Return whether the bytes between stamp and values hold the names of a topic, and their number twice.

    Bytes that align the next entry may be anything.
    """
    names, shift = TOPICS[topic].fields, FRAME_AT - 4
    (length,) = _LENGTH.unpack_from(start)
    at = aligned(FRAME_AT + length, 4) - shift
    parts = [_LENGTH.pack(len(names))]
    parts += [_LENGTH.pack(len(name) + 1) + name.encode() + b"\0" for name in names]
    for part in (*parts, parts[0]):
        if not start.startswith(part, at):
            return False
        at = aligned(at + len(part) + shift, 4) - shift
    return True


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
            is_unknown = number.may_be_unknown and not math.isfinite(value)
            if not (least <= value <= most or is_unknown):
                reject(topic, f"{number.name} is {value}; allowed: {number.allowed}")
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


def _motion(topic: Topic) -> NumberMessage:
    frame, _, body = TOPICS[topic].frame.partition(" -> ")
    return NumberMessage(
        lambda: Odometry(header=Header(frame_id=frame), child_frame_id=body),
        Number("position", "pose.pose.position.x"),
        Number("speed", "twist.twist.linear.x", *_RANGES["speed_m_s"]),
    )


def _of_one_number(topic: Topic, kind: type[Any], place: str) -> NumberMessage:
    frame = TOPICS[topic].frame
    return NumberMessage(lambda: kind(header=Header(frame_id=frame)), Number(place, place))


LAYOUTS: Mapping[Topic, NumberMessage] = {
    Topic.PLANT_ODOMETRY: _motion(Topic.PLANT_ODOMETRY),
    Topic.LEADER: _motion(Topic.LEADER),
    Topic.PLANT_ACCELERATION: _of_one_number(
        Topic.PLANT_ACCELERATION, AccelStamped, "accel.linear.x"
    ),
    **{
        topic: _of_one_number(topic, Temperature, "temperature")
        for topic, spec in TOPICS.items()
        if spec.message_type is Temperature
    },
    **{
        topic: _named_values(topic)
        for topic, spec in TOPICS.items()
        if spec.message_type is JointState and topic is not Topic.ROAD_AHEAD
    },
}
"""The messages that are a stamp and some numbers, by topic."""
