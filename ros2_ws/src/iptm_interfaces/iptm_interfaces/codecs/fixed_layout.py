"""Encoders of messages of which only the stamp and some numbers change.

Building and serialising such a message object takes Python much longer than its few numbers justify, about
a dozen times per tick. The layout of the bytes is constant, so they are built once and only the numbers are
written afterwards. An encoder provides both from one definition of the numbers: the message object, and its
bytes for `Publisher.publish`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import update_wrapper
from typing import Any, Generic, ParamSpec

from iptm_interfaces.codecs.cdr import put_stamp, serialized
from iptm_interfaces.codecs.time import time_from_ns
from iptm_interfaces.topics import frame_in

P = ParamSpec("P")

Numbers = tuple[int, Sequence[float]]
"""Stamp in integer nanoseconds, and the numbers in the order of the fields."""

_NUMBER_BYTES = 8


class FixedLayout:
    """A message with a header, given by an example, and the float64 numbers in it that change."""

    def __init__(self, build: Callable[[], Any], fields: Sequence[str]) -> None:
        """Set up.

        Args:
            build: returns a new message whose texts and lists have their final lengths.
            fields: places of the numbers: `twist.twist.linear.x`, or `position[2]`.
        """
        self._build = build
        self._places = [_place(field) for field in fields]
        self._forms: dict[str, tuple[bytes, struct.Struct | None, tuple[int, ...]]] = {}

    def message(self, stamp_ns: int, numbers: Sequence[float]) -> Any:
        """Return a message with these numbers.

        Raises:
            MessageError: no message can carry the stamp.
        """
        message = self._build()
        message.header.stamp = time_from_ns(stamp_ns)
        for (parents, name, index), number in zip(self._places, numbers, strict=True):
            target = message
            for parent in parents:
                target = getattr(target, parent)
            if index is None:
                setattr(target, name, float(number))
            else:
                getattr(target, name)[index] = float(number)
        return message

    def data(self, stamp_ns: int, numbers: Sequence[float], prefix: str) -> bytes:
        """Return the bytes of the message with the frames of a vehicle.

        Args:
            stamp_ns: stamp in integer nanoseconds.
            numbers: in the order of the fields.
            prefix: of the frames.

        Raises:
            MessageError: no message can carry the stamp.
        """
        form = self._forms.get(prefix)
        if form is None:
            form = self._forms[prefix] = self._form(prefix)
        start, adjacent, offsets = form
        data = bytearray(start)
        put_stamp(data, stamp_ns)
        if adjacent is not None:
            adjacent.pack_into(data, offsets[0], *numbers)
        else:
            for offset, number in zip(offsets, numbers, strict=True):
                struct.pack_into("<d", data, offset, number)
        return bytes(data)

    def _form(self, prefix: str) -> tuple[bytes, struct.Struct | None, tuple[int, ...]]:
        """Find out where the numbers lie: a value of its own in each place, looked for in the bytes."""
        count = len(self._places)
        marks = [1.0e300 * (1.0 + index / (count + 1.0)) for index in range(count)]
        message = self.message(0, marks)
        message.header.frame_id = frame_in(prefix, message.header.frame_id)
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = frame_in(prefix, message.child_frame_id)
        data = serialized(message)
        offsets = tuple(data.index(struct.pack("<d", mark)) for mark in marks)
        neighbours = tuple(offsets[0] + _NUMBER_BYTES * index for index in range(count))
        return data, struct.Struct(f"<{count}d") if offsets == neighbours else None, offsets


class Encoder(Generic[P]):
    """Encodes what a function reduces to numbers, as a message or as its bytes."""

    def __init__(self, layout: FixedLayout, numbers: Callable[P, Numbers]) -> None:
        self._layout = layout
        self._numbers = numbers
        update_wrapper(self, numbers)

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> Any:
        """Return the message, its frames those of the topic table."""
        return self._layout.message(*self._numbers(*arguments, **named))

    def data(self, prefix: str, *arguments: P.args, **named: P.kwargs) -> bytes:
        """Return the bytes of the message, its frames those of a vehicle."""
        return self._layout.data(*self._numbers(*arguments, **named), prefix)


def encoder(build: Callable[[], Any], *fields: str) -> Callable[[Callable[P, Numbers]], Encoder[P]]:
    """Return a decorator that makes an encoder of a function; see `FixedLayout` for the arguments."""
    return lambda numbers: Encoder(FixedLayout(build, fields), numbers)


def _place(field: str) -> tuple[list[str], str, int | None]:
    *parents, last = field.split(".")
    name, _, index = last.partition("[")
    return parents, name, int(index.rstrip("]")) if index else None
