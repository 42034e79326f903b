"""Functions that other processes call in tests: every call leaves a file."""

from __future__ import annotations

import os
import signal
import time
import uuid
from collections import Counter
from pathlib import Path
from typing import Any


def note_and_square(number: Any, notes: Path, last_s: float = 0.0) -> int:
    """Return the square of a number; of a function, what it returns."""
    if callable(number):
        return int(number())
    square = number**2
    notes.mkdir(exist_ok=True)
    time.sleep(last_s)
    (notes / f"{number}_{uuid.uuid4()}").touch()
    return int(square)


def crash() -> int:
    """Kill the process."""
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def noted(notes: Path) -> Counter[int]:
    """Return how often each number was squared."""
    return Counter(int(path.name.partition("_")[0]) for path in notes.iterdir())
