"""Python's garbage collector, kept from stopping a trip.

A full collection walks every object of the process: 20 to 80 ms with the libraries of a study loaded, in one
tick. Nearly all that a trip leaves behind is freed by counting references; the rest can wait for its end.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_NEVER = 2**30


@contextmanager
def no_full_collections() -> Iterator[None]:
    """Collect young objects only while the context is open; full collections come after it, when due."""
    young, middle, old = gc.get_threshold()
    gc.set_threshold(young, middle, _NEVER)
    try:
        yield
    finally:
        gc.set_threshold(young, middle, old)
