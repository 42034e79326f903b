"""TimestampIts: milliseconds since 2004-01-01T00:00:00 TAI, whose low 16 bits a message carries."""

from __future__ import annotations

DELTA_MODULUS_MS = 65_536
ITS_EPOCH_UNIX_S = 1_072_915_200
"""2004-01-01T00:00:00 UTC in Unix time."""
LEAP_SECONDS_SINCE_2004 = 5
"""TAI gained on UTC since then: 2005, 2008, 2012, 2015, 2016; none later."""


def its_timestamp_ms(unix_time_ns: int) -> int:
    """Return the TimestampIts of an instant of Unix time (UTC)."""
    seconds = ITS_EPOCH_UNIX_S - LEAP_SECONDS_SINCE_2004
    return (unix_time_ns - seconds * 10**9) // 10**6


def delta_time_ms(timestamp_ms: int) -> int:
    """Return what a message carries of its time of generation."""
    return timestamp_ms % DELTA_MODULUS_MS


def resolve_delta_ms(delta_ms: int, now_ms: int, tolerance_ms: int) -> int:
    """Return the time of generation that a message means.

    Args:
        delta_ms: time of generation modulo 65,536 ms.
        now_ms: TimestampIts of the receiver's clock.
        tolerance_ms: how far ahead of it a sender's clock may be.

    Returns:
        The last instant with this remainder that is not later than now and the tolerance.
    """
    latest = now_ms + tolerance_ms
    return latest - (latest - delta_ms) % DELTA_MODULUS_MS
