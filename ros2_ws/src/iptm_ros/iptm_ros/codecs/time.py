"""Stamps: trip time in seconds <-> integer nanoseconds <-> builtin_interfaces messages.

Integer nanoseconds are the key by which messages of one tick are matched. A multiple of 1 ms
survives the round trip float -> nanoseconds -> float unchanged, because both directions round to
the nearest representable value; this holds for trips of up to 26 days (2^51 ns).
"""

from __future__ import annotations

import math

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S
from iptm_ros.message_types import Time

_MAX_STAMP_NS = 2**31 * NS_PER_S - 1


def is_stamp(stamp_ns: int) -> bool:
    """Return whether a message can carry a stamp, so that it can be answered with the same."""
    return 0 <= stamp_ns <= _MAX_STAMP_NS


def ns_from_s(time_s: float) -> int:
    """Return seconds as integer nanoseconds, rounded to the nearest."""
    if not math.isfinite(time_s):
        raise MessageError(f"time is {time_s} s; allowed: a finite number")
    return round(time_s * 1e9)


def s_from_ns(time_ns: int) -> float:
    """Return integer nanoseconds as seconds."""
    return time_ns / NS_PER_S


def parts_of_stamp(stamp_ns: int) -> tuple[int, int]:
    """Return seconds and nanoseconds of a stamp; `MessageError` where no message can carry it."""
    if not is_stamp(stamp_ns):
        raise MessageError(f"stamp is {stamp_ns} ns; allowed: 0 to {_MAX_STAMP_NS}")
    return divmod(stamp_ns, NS_PER_S)


def time_from_ns(stamp_ns: int) -> Time:
    """Return a stamp message, see `parts_of_stamp`."""
    seconds, nanoseconds = parts_of_stamp(stamp_ns)
    return Time(sec=seconds, nanosec=nanoseconds)


def ns_from_time(message: Time) -> int:
    """Return a stamp message as integer nanoseconds, the key for matching.

    Returned as sent, even if it is not a trip time; see `is_stamp`.
    """
    return message.sec * NS_PER_S + message.nanosec


def time_from_s(time_s: float) -> Time:
    """Return a stamp message for a trip time in seconds (see `ns_from_s`, `time_from_ns`)."""
    return time_from_ns(ns_from_s(time_s))
