"""Signal phases and timing (SPATEM of TS 103 301; SAE J2735 in the profile of ISO/TS 19091).

What is read: for every signal group of an intersection its phases, the present one first, and when each ends.
Speed advice, queue lengths, prioritisation and regional parts are not. Times are minutes of the year and
tenths of seconds of the hour, both in UTC (DE_MinuteOfTheYear, DE_DSecond, DE_TimeMark).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from iptm_core.declaration import TextEnum
from iptm_its.pycrate_codec import decode_fields, encode_fields
from iptm_v2x_bridge.messages.packets import (
    ITS_EPOCH_UNIX_S,
    LEAP_SECONDS_SINCE_2004,
    MessageKind,
)
from iptm_v2x_bridge.rejections import Rejection

_OVER_AN_HOUR, _UNKNOWN = 36_000, 36_001
_NO_MINUTE, _LONGEST_MINUTE_MS = 527_040, 60_999
"""A leap second makes a minute longer."""
_STATUS_BITS = 16
_NOT_WORKING = (2, 7, 8, 9, 12, 13)
"""Bits of the status: failure flash, standby, failure mode, off, no valid MAP, no valid SPAT."""


IntersectionId = tuple[int, int]
"""Identity of an intersection: the authority that gave it, 0 if not sent, and its number."""


def intersection_id(fields: dict[str, Any]) -> IntersectionId:
    """Return the identity in a message."""
    return fields.get("region", 0), fields["id"]


def id_fields(intersection: IntersectionId) -> dict[str, int]:
    """Return an identity as a message holds it."""
    region, number = intersection
    return {"id": number} | ({"region": region} if region else {})


class SignalState(TextEnum):
    """What a signal shows (SAE J2735, DE_MovementPhaseState)."""

    UNAVAILABLE = "unavailable"
    DARK = "dark"
    STOP_THEN_PROCEED = "stop-Then-Proceed"
    """Flashing red."""
    RED = "stop-And-Remain"
    RED_YELLOW = "pre-Movement"
    GREEN_YIELD = "permissive-Movement-Allowed"
    """Green, others may have the right of way."""
    GREEN = "protected-Movement-Allowed"
    YELLOW_YIELD = "permissive-clearance"
    YELLOW = "protected-clearance"
    FLASHING_YELLOW = "caution-Conflicting-Traffic"

    @property
    def is_open(self) -> bool | None:
        """Whether the line may be passed; None if the signal state is unknown. Yellow counts as closed."""
        if self in {SignalState.GREEN, SignalState.GREEN_YIELD}:
            return True
        closed = (SignalState.RED, SignalState.RED_YELLOW, SignalState.YELLOW)
        return False if self in {*closed, SignalState.YELLOW_YIELD} else None


@dataclass(frozen=True)
class Phase:
    """One phase of a signal group.

    Times are s of TimestampIts, on the wire s of the hour of UTC in steps of 0.1 s. None stands for a time
    that is not sent, infinity for one more than an hour ahead.

    Attributes:
        state: what the signal shows.
        starts_s: when the phase begins or began.
        min_end_s: its earliest end.
        max_end_s: its latest end.
        likely_end_s: its likely end.
    """

    state: SignalState
    starts_s: float | None = None
    min_end_s: float | None = None
    max_end_s: float | None = None
    likely_end_s: float | None = None

    @property
    def expected_end_s(self) -> float | None:
        """The likely end, else the earliest one."""
        return self.min_end_s if self.likely_end_s is None else self.likely_end_s


@dataclass(frozen=True)
class IntersectionPhases:
    """Phases of one intersection.

    Attributes:
        intersection: which one.
        revision: of the map to which the signal groups belong, 0 to 127.
        sent_ms: time of the message, TimestampIts.
        groups: the phases of each signal group, the present one first.
        is_working: False in failure, standby, switched off, or without valid data.
    """

    intersection: IntersectionId
    revision: int
    sent_ms: int
    groups: dict[int, tuple[Phase, ...]]
    is_working: bool = True


def decode_spatem(payload: bytes, now_ms: int) -> tuple[IntersectionPhases, ...] | Rejection:
    """Read a bare message, whose header has been looked at; `now_ms` is the TimestampIts of its reception."""
    read = decode_fields(MessageKind.SPATEM, payload)
    if isinstance(read, Rejection):
        return read
    _, fields = read
    minute = fields.get("timeStamp")
    found = [_intersection(state, minute, now_ms) for state in fields["intersections"]]
    known = tuple(entry for entry in found if entry is not None)
    # Without its time of generation a phase cannot be used; phases of other intersections can.
    return known or Rejection.INCOMPLETE


def _intersection(
    fields: dict[str, Any], minute: int | None, now_ms: int
) -> IntersectionPhases | None:
    minute = fields.get("moy", minute)
    milliseconds = fields.get("timeStamp")
    if minute in {None, _NO_MINUTE} or milliseconds is None or milliseconds > _LONGEST_MINUTE_MS:
        return None
    sent_ms = resolve_minute_ms(int(minute or 0), milliseconds, now_ms)
    bits, length = fields["status"]
    return IntersectionPhases(
        intersection=intersection_id(fields["id"]),
        revision=fields["revision"],
        sent_ms=sent_ms,
        groups={
            movement["signalGroup"]: tuple(
                _phase(event, sent_ms / 1000.0, is_present=not later)
                for later, event in enumerate(movement["state-time-speed"])
            )
            for movement in fields["states"]
        },
        is_working=not any(bits >> (length - 1 - bit) & 1 for bit in _NOT_WORKING),
    )


def _phase(event: dict[str, Any], sent_s: float, *, is_present: bool) -> Phase:
    timing = event.get("timing", {})
    starts_s, *ends_s = (
        _instant(timing.get(name), sent_s)
        for name in ("startTime", "minEndTime", "maxEndTime", "likelyTime")
    )
    if is_present:  # it ends after its message
        ends_s = [None if end_s is None else max(end_s, sent_s) for end_s in ends_s]
    return Phase(SignalState(event["eventState"]), starts_s, *ends_s)


def _instant(mark: int | None, sent_s: float) -> float | None:
    if mark is None or mark == _UNKNOWN:
        return None
    return math.inf if mark == _OVER_AN_HOUR else resolve_second_s(mark / 10.0, sent_s)


def _mark(instant_s: float) -> int:
    if math.isinf(instant_s):
        return _OVER_AN_HOUR
    return round(second_of_hour(instant_s) * 10.0) % _OVER_AN_HOUR


def encode_spatem(station_id: int, intersections: Iterable[IntersectionPhases]) -> bytes:
    """Return a message of a station as bits.

    Raises:
        MessageError: a value is outside the range of the standard.
    """
    states = []
    for entry in intersections:
        minute, milliseconds = minute_of_year(entry.sent_ms)
        state = {
            "id": id_fields(entry.intersection),
            "revision": entry.revision,
            "status": (0 if entry.is_working else 1 << _STATUS_BITS - 1 - 9, _STATUS_BITS),
            "moy": minute,
            "timeStamp": milliseconds,
            "states": [
                {"signalGroup": group, "state-time-speed": [_event(phase) for phase in phases]}
                for group, phases in entry.groups.items()
            ],
        }
        states.append(state)
    return encode_fields(MessageKind.SPATEM, station_id, {"intersections": states})


def _event(phase: Phase) -> dict[str, Any]:
    times = {
        "startTime": phase.starts_s,
        "maxEndTime": phase.max_end_s,
        "likelyTime": phase.likely_end_s,
    }
    timing = {name: _mark(second) for name, second in times.items() if second is not None}
    earliest = _UNKNOWN if phase.min_end_s is None else _mark(phase.min_end_s)
    return {"eventState": phase.state.value, "timing": {"minEndTime": earliest, **timing}}


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
