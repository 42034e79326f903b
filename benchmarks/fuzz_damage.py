"""Damaged messages: valid ones of every topic of the suite, and what a seed makes of them.

Every message begins as one that a healthy suite sends. Its stamp may become any other, numbers become
impossible, bytes are changed, cut off or made up.
"""

from __future__ import annotations

import random
import struct
from collections import Counter
from collections.abc import Callable, Sequence

from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from benchmarks.start_up import scripted_messages
from iptm_core.state import Command
from iptm_core.trip_time import NS_PER_S
from iptm_interfaces.codecs import encode_command
from iptm_interfaces.topics import Topic

_STAMP_AT, _BODY_AT = 4, 12  # behind the four bytes of the encoding
_STAMPED = frozenset(Topic) - {Topic.SLOPE}
_NUMBERS = (float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e308, -1e308, 5e-324, 1e6)


class Damage:
    """Draws damaged messages from a seed."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)  # noqa: S311
        messages = scripted_messages()
        messages[Topic.CLOCK] = Clock()
        messages[Topic.COMMAND] = encode_command(0, Command(0.1, 100.0))
        self._valid = {topic: bytes(serialize_message(m)) for topic, m in messages.items()}
        self.kinds: Counter[str] = Counter()
        self._ways: Sequence[Callable[[Topic, bytearray, int], bytes]] = (
            self._restamped, self._restamped, self._impossible, self._flipped, self._cut,
            self._blown_up, self._made_up, self._large,
        )  # fmt: skip

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Topics of which there are messages."""
        return tuple(self._valid)

    def message(self, topic: Topic, now_ns: int) -> bytes:
        """Return the bytes of a damaged message.

        Args:
            topic: one of `topics`.
            now_ns: present trip time; some of the messages carry it.
        """
        way = self._chance.choice(self._ways)
        self.kinds[way.__name__.strip("_")] += 1
        data = bytearray(self._valid[topic])
        if topic in _STAMPED and self._chance.random() < 0.5:
            struct.pack_into("<iI", data, _STAMP_AT, *divmod(max(0, now_ns), NS_PER_S))
        return way(topic, data, now_ns)

    def _restamped(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        chance = self._chance
        seconds = now_ns // NS_PER_S
        stamp = chance.choice(
            (
                (seconds, 0),
                (0, 0),
                (max(0, seconds + chance.randrange(-40, 40)), 0),
                (seconds, chance.getrandbits(32)),
                (-chance.getrandbits(31) - 1, 0),
                (2**31 - 1, chance.getrandbits(32)),
                (chance.getrandbits(31), chance.getrandbits(30)),
            )
        )
        if topic in _STAMPED:
            struct.pack_into("<iI", data, _STAMP_AT, *stamp)
        return bytes(data)

    def _impossible(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        del topic, now_ns
        if len(data) >= _BODY_AT + 8:
            # Numbers lie on multiples of eight behind the encoding.
            place = 4 + 8 * self._chance.randrange(1, (len(data) - 4) // 8)
            struct.pack_into("<d", data, place, self._chance.choice(_NUMBERS))
        return bytes(data)

    def _flipped(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        del topic, now_ns
        for _ in range(self._chance.randrange(1, 9)):
            data[self._chance.randrange(len(data))] = self._chance.getrandbits(8)
        return bytes(data)

    def _cut(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        del topic, now_ns
        return bytes(data[: self._chance.randrange(len(data))])

    def _blown_up(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        """Write a size that the message does not have, wherever one may be."""
        del topic, now_ns
        if len(data) >= _BODY_AT + 4:
            place = 4 * self._chance.randrange(1, len(data) // 4)
            size = self._chance.choice((2**31 - 1, 2**32 - 1, 2**20, 65536, 300, 1))
            struct.pack_into("<I", data, place, size)
        return bytes(data)

    def _made_up(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        del topic, data, now_ns
        return self._chance.randbytes(self._chance.choice((0, 1, 3, 4, 12, 40, 400)))

    def _large(self, topic: Topic, data: bytearray, now_ns: int) -> bytes:
        """Append what no field asks for; one in a hundred is larger than any node takes."""
        del topic, now_ns
        rest = 2**17 if self._chance.random() < 0.01 else 200
        return bytes(data) + bytes(rest)
