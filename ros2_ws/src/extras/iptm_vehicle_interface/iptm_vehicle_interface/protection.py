"""Counter and checksum of a message as data: the kinds that published DBC files and their readers describe.

Every checksum here covers all bytes of the frame but its own, and fills whole bytes. What makers differ in is
the kind, the start and final values, and whether the identifier or a byte by counter takes part:

| kind | examples |
|---|---|
| sum of bytes and identifier | Tesla, Toyota (start 8: the length), the bench car (inverted) |
| exclusive or of the bytes | Volkswagen PQ |
| CRC of 8 bits | Rivian (0x1D), SAE J1850 (0x1D, 0xFF, 0xFF), Volkswagen MQB (0x2F, a byte by counter) |
| CRC of 16 bits | Hyundai CAN FD (0x1021, with the identifier) |
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from iptm_core.declaration import TextEnum

MOST_JUMPS = 5
"""A counter that jumps adds one, a sound one takes one away; from here on the message does not count."""


class ChecksumKind(TextEnum):
    """How bytes become a checksum."""

    SUM = "sum"
    XOR = "xor"
    CRC = "crc"


class FrameFault(TextEnum):
    """Why a frame does not count."""

    LENGTH = "shorter than the DBC states"
    CHECKSUM = "wrong checksum"
    COUNTER = "repeated counter"
    JUMPS = "counter jumps: many frames are lost, or there is a second sender"


@dataclass(frozen=True)
class Checksum:
    """A checksum; see the module.

    Attributes:
        place: first byte in the frame.
        size: number of bytes, 1 or 2.
        is_little_endian: order of two bytes in the frame.
        kind: see `ChecksumKind`.
        polynomial: of a CRC, without its highest bit.
        start: value before the first byte.
        final: exclusive or of the result.
        has_identifier: whether two bytes of the identifier, the low one first (all four in a sum), follow.
        by_counter: byte that follows, for each value of the counter; empty for none.
    """

    place: int
    size: int
    is_little_endian: bool
    kind: ChecksumKind
    polynomial: int = 0
    start: int = 0
    final: int = 0
    has_identifier: bool = False
    by_counter: tuple[int, ...] = ()

    def value(self, frame_id: int, data: bytes, counter: int) -> int:
        """Return the checksum of a frame."""
        covered = bytearray(data[: self.place] + data[self.place + self.size :])
        if self.has_identifier:
            covered += frame_id.to_bytes(4, "little")[
                : None if self.kind is ChecksumKind.SUM else 2
            ]
        if self.by_counter:
            covered.append(self.by_counter[counter])
        mask = (1 << 8 * self.size) - 1
        if self.kind is ChecksumKind.SUM:
            found = self.start + sum(covered)
        elif self.kind is ChecksumKind.XOR:
            found = self.start
            for byte in covered:
                found ^= byte
        else:
            found = _crc(covered, 8 * self.size, self.polynomial, self.start)
        return (found ^ self.final) & mask

    def stated(self, data: bytes) -> int:
        """Return the checksum that a frame states."""
        order = "little" if self.is_little_endian else "big"
        return int.from_bytes(data[self.place : self.place + self.size], order)  # type: ignore[arg-type]

    def put(self, frame_id: int, data: bytes, counter: int) -> bytes:
        """Return a frame with its checksum."""
        order = "little" if self.is_little_endian else "big"
        own = self.value(frame_id, data, counter).to_bytes(self.size, order)  # type: ignore[arg-type]
        return data[: self.place] + own + data[self.place + self.size :]


@dataclass(frozen=True)
class Protection:
    """What protects a message.

    Attributes:
        counter: signal that counts its frames; empty for none.
        modulo: the counter runs from 0 to one less.
        checksum: None for none.
    """

    counter: str = ""
    modulo: int = 16
    checksum: Checksum | None = None


class CounterWatch:
    """Judges the counter of a message: repeated, or one that jumps too often.

    A lost frame makes one jump; with two senders of one message nearly every frame makes one.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._jumps = 0

    def fault(self, count: int, modulo: int) -> FrameFault | None:
        """Return what is wrong with the next counter."""
        last, self._last = self._last, count
        if last is None:
            return None
        if count == last:
            return FrameFault.COUNTER
        is_next = count == (last + 1) % modulo
        self._jumps = max(self._jumps - 1, 0) if is_next else min(self._jumps + 1, MOST_JUMPS)
        return FrameFault.JUMPS if self._jumps == MOST_JUMPS else None


def _crc(data: Iterable[int], bits: int, polynomial: int, start: int) -> int:
    table, mask, crc = _table(bits, polynomial), (1 << bits) - 1, start
    for byte in data:
        crc = (crc << 8 ^ table[crc >> bits - 8 ^ byte]) & mask
    return crc


@lru_cache(maxsize=16)
def _table(bits: int, polynomial: int) -> tuple[int, ...]:
    """Return the remainders of all bytes."""
    top, mask = 1 << bits - 1, (1 << bits) - 1
    table = []
    for byte in range(256):
        crc = byte << bits - 8
        for _ in range(8):
            crc = (crc << 1 ^ polynomial if crc & top else crc << 1) & mask
        table.append(crc)
    return tuple(table)
