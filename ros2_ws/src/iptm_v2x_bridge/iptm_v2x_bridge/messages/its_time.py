"""TimestampIts: milliseconds since 2004-01-01T00:00:00 TAI, and its encodings in messages.

Vehicles send its low 16 bits. Signals send minutes of the year and tenths of seconds of the hour, both in UTC
(SAE J2735, DE_MinuteOfTheYear, DE_DSecond, DE_TimeMark).
"""

from __future__ import annotations

from datetime import datetime, timezone

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


HOUR_MS, MINUTE_MS = 3_600_000, 60_000
LONGEST_PAST_MS = 300_000
"""Start, before the present, of the search window for resolving a time-of-hour stamp."""


def utc_ms(timestamp_ms: int) -> int:
    """Return Unix time (UTC, ms) of an instant of TimestampIts."""
    return timestamp_ms + (ITS_EPOCH_UNIX_S - LEAP_SECONDS_SINCE_2004) * 1000


def _year_ms(year: int) -> int:
    return round(datetime(year, 1, 1, tzinfo=timezone.utc).timestamp()) * 1000


def minute_of_year(timestamp_ms: int) -> tuple[int, int]:
    """Return the minute of the year (UTC) of an instant and the milliseconds into it."""
    now_ms = utc_ms(timestamp_ms)
    year = datetime.fromtimestamp(now_ms / 1000.0, tz=timezone.utc).year
    return divmod(now_ms - _year_ms(year), MINUTE_MS)


def resolve_minute_ms(minute: int, milliseconds: int, now_ms: int) -> int:
    """Return the TimestampIts nearest to the present that lies in a minute of a year."""
    now_utc_ms = utc_ms(now_ms)
    year = datetime.fromtimestamp(now_utc_ms / 1000.0, tz=timezone.utc).year
    inside_ms = minute * MINUTE_MS + milliseconds
    found = [_year_ms(candidate) + inside_ms for candidate in (year - 1, year, year + 1)]
    return now_ms + min((ms - now_utc_ms for ms in found), key=abs)


def second_of_hour(timestamp_s: float) -> float:
    """Return how far an instant (s of TimestampIts) lies in its hour of UTC, in s."""
    return (timestamp_s + utc_ms(0) / 1000.0) % (HOUR_MS / 1000.0)


def resolve_second_s(second: float, reference_s: float) -> float:
    """Return the instant (s of TimestampIts) of a time-of-hour stamp (UTC).

    Args:
        second: into the hour, 0 to 3600.
        reference_s: time of the message; the instant lies `LONGEST_PAST_MS` before it or later, by less than
            an hour.
    """
    earliest_s = reference_s - LONGEST_PAST_MS / 1000.0
    return earliest_s + (second - second_of_hour(earliest_s)) % (HOUR_MS / 1000.0)
