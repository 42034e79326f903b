"""Times at which stop lines are closed, from the phases sent by their signals.

For an ego vehicle that keeps the rules a line is open only while it is certainly open: from the latest end of
the previous phase to the earliest end of the open one; unknown times count as closed. The leader's prediction
uses likely times; unknown times do not constrain it, as its bound covers them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from iptm_v2x_bridge.messages.spatem import (
    IntersectionPhases,
    Phase,
    resolve_minute_ms,
    resolve_second_s,
)
from iptm_v2x_bridge.prediction.road_rules import Span

EARLY_OPENING_S = 1.0
"""Tolerance for a signal that opens before the earliest end of its closed phase (rounding, clock error)."""


@dataclass(frozen=True)
class TimedPhases:
    """Phases received from an intersection.

    Attributes:
        sent_ms: time of the message, TimestampIts.
        revision: of the map that the signal groups belong to.
        is_working: whether its signals work.
        groups: phases of each signal group, the present one first.
    """

    sent_ms: int
    revision: int
    is_working: bool
    groups: dict[int, tuple[Phase, ...]]


def timed(message: IntersectionPhases, now_ms: int) -> TimedPhases:
    """Return phases with instants instead of places in the hour and the year."""
    sent_ms = resolve_minute_ms(message.minute, message.milliseconds, now_ms)
    sent_s = sent_ms / 1000.0

    def one(phase: Phase, earliest_s: float) -> Phase:
        ends = [
            None if second is None else max(_instant(second, sent_s), earliest_s)
            for second in (phase.min_end_s, phase.max_end_s, phase.likely_end_s)
        ]
        return Phase(phase.state, None, *ends)

    groups = {
        # The present phase ends after its message.
        group: tuple(one(phase, -math.inf if later else sent_s) for later, phase in enumerate(some))
        for group, some in message.groups.items()
    }
    return TimedPhases(sent_ms, message.revision, message.is_working, groups)


def _instant(second: float, sent_s: float) -> float:
    return second if math.isinf(second) else resolve_second_s(second, sent_s)


def surely_closed(phases: Sequence[Phase]) -> list[Span]:
    """Return when a line is not sure to be open."""
    closed: list[Span] = []
    open_until = certain = -math.inf
    for phase in phases:
        begins, ends = certain, phase.min_end_s
        if phase.state.is_open and ends is not None and ends > begins:
            closed.append((open_until, begins))
            open_until = ends
        after = phase.max_end_s
        if after is None or math.isinf(after):
            break
        certain = max(after, certain)
    closed.append((open_until, math.inf))
    return [span for span in closed if span[0] < span[1]]


def likely_closed(phases: Sequence[Phase]) -> list[Span]:
    """Return when a line is likely to be closed."""
    closed = []
    begins = -math.inf
    for phase in phases:
        ends = phase.expected_end_s
        if ends is None:
            break
        if phase.state.is_open is False and ends > begins:
            closed.append((begins, ends))
        begins = max(ends, begins)
    return closed


def joined(spans: Iterable[Span]) -> tuple[Span, ...]:
    """Return spans without overlaps, in order."""
    found: list[Span] = []
    for begins, ends in sorted(spans):
        if found and begins <= found[-1][1]:
            found[-1] = found[-1][0], max(ends, found[-1][1])
        else:
            found.append((begins, ends))
    return tuple(found)


def opens_too_early(before: TimedPhases, after: TimedPhases) -> bool:
    """Return whether a signal opens before the announced earliest end of its closed phase.

    An early closing is accepted.
    """
    sent_s = after.sent_ms / 1000.0
    for group, phases in after.groups.items():
        known = before.groups.get(group)
        if not (known and phases and phases[0].state.is_open and known[0].state.is_open is False):
            continue
        earliest = known[0].min_end_s
        if earliest is not None and sent_s < earliest - EARLY_OPENING_S:
            return True
    return False
