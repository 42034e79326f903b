"""What happens to files on disks, in networks and by hand: the ways in which bags are damaged."""

from __future__ import annotations

import random
from collections.abc import Callable

_MOST_BYTES = 3000
_Corruption = Callable[[bytearray, random.Random], None]


def _flip_bit(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _replace_byte(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] = rng.randrange(256)


def _replace_bytes(data: bytearray, rng: random.Random) -> None:
    start, end = _range(data, rng)
    data[start:end] = rng.randbytes(end - start)


def _zero(data: bytearray, rng: random.Random) -> None:
    start, end = _range(data, rng)
    data[start:end] = bytes(end - start)


def _delete(data: bytearray, rng: random.Random) -> None:
    start, end = _range(data, rng)
    del data[start:end]


def _insert(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    data[at:at] = rng.randbytes(rng.randrange(1, _MOST_BYTES))


def _repeat(data: bytearray, rng: random.Random) -> None:
    start, end = _range(data, rng)
    data[end:end] = data[start:end]


def _truncate(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _swap(data: bytearray, rng: random.Random) -> None:
    size = rng.randrange(1, _MOST_BYTES)
    first, second = sorted(rng.sample(range(0, len(data) - size, size), 2))
    data[first : first + size], data[second : second + size] = (
        data[second : second + size],
        data[first : first + size],
    )


def _spoil_summary(data: bytearray, rng: random.Random) -> None:
    data[len(data) - 1 - rng.randrange(min(6000, len(data)))] ^= 1 + rng.randrange(255)


def _spoil_start(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(min(600, len(data)))] ^= 1 + rng.randrange(255)


def _grow_a_length(data: bytearray, rng: random.Random) -> None:
    """Change a length where a chunk, its compression or its messages state one."""
    places = [i for i in range(len(data) - 9) if data[i] in {5, 6, 7} and not data[i + 4]]
    at = rng.choice(places or range(len(data) - 9))
    data[at + 1 + rng.randrange(8)] ^= 1 << rng.randrange(8)


def _range(data: bytearray, rng: random.Random) -> tuple[int, int]:
    start = rng.randrange(len(data))
    return start, min(len(data), start + rng.randrange(1, _MOST_BYTES))


CORRUPTIONS: dict[str, _Corruption] = {
    function.__name__.lstrip("_"): function
    for function in (
        _flip_bit,
        _replace_byte,
        _replace_bytes,
        _zero,
        _delete,
        _insert,
        _repeat,
        _truncate,
        _swap,
        _spoil_summary,
        _spoil_start,
        _grow_a_length,
    )
}
"""By name; each changes the bytes in place."""
