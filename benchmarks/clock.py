"""Two clocks: wall time is what a vehicle feels, processor time is what can be compared on a busy machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Elapsed:
    """Time of one call.

    Attributes:
        wall_s: on the wall, other programs of the machine included.
        processor_s: on the processor by all threads of this process; equals the wall time of a
            single-threaded call on a quiet machine.
    """

    wall_s: float
    processor_s: float


def timed(call: Callable[[], T]) -> tuple[T, Elapsed]:
    """Call and time it on both clocks."""
    wall, processor = time.perf_counter(), time.process_time()
    result = call()
    return result, Elapsed(time.perf_counter() - wall, time.process_time() - processor)
