"""Checks shared by the decoders: each raises MessageError with the topic, the value and the rule."""

from __future__ import annotations

import math
from typing import NoReturn

import numpy as np

from iptm_core.errors import MessageError
from iptm_core.state import FloatArray
from iptm_interfaces.topics import Topic


def reject(topic: Topic, reason: str) -> NoReturn:
    """Raise the error of a message that breaks the promise of its topic."""
    raise MessageError(f"{topic.value}: {reason}")


def finite(topic: Topic, name: str, value: float) -> float:
    """Return the value if it is finite."""
    if not math.isfinite(value):
        reject(topic, f"{name} is {value}; allowed: a finite number")
    return value


def not_negative(topic: Topic, name: str, value: float) -> float:
    """Return the value if it is finite and at least zero."""
    if not 0.0 <= value < math.inf:
        reject(topic, f"{name} is {value}; allowed: a finite number, at least 0")
    return value


def all_finite(topic: Topic, name: str, values: FloatArray) -> None:
    """Check that an array is finite everywhere; names the first entry that is not."""
    good = np.isfinite(values)
    if not good.all():
        index = int(good.argmin())
        reject(topic, f"{name}[{index}] is {values[index]}; allowed: finite numbers")


def increasing(topic: Topic, name: str, values: FloatArray) -> None:
    """Check that an array increases strictly."""
    good = values[1:] > values[:-1]
    if not good.all():
        index = int(good.argmin())
        reject(
            topic,
            f"{name} do not increase: {values[index]} is followed by {values[index + 1]}",
        )
