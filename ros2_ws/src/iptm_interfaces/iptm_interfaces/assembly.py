"""From messages back to the run: one row per tick, joined by header stamps.

Used by whoever has the messages: a bag, or a listener beside the run. Times of reception say when a message
was heard, stamps say what instant it describes; only the latter join.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import MessageError
from iptm_core.trajectory import Trajectory
from iptm_interfaces.codecs import (
    decode_decision_record,
    decode_leader,
    decode_observation,
    ns_from_time,
    s_from_ns,
)
from iptm_interfaces.stamp_gate import LEAST_REACH_NS
from iptm_interfaces.topics import TICK_TOPICS, Topic

T = TypeVar("T")
ByStamp = Mapping[int, Any]
"""Messages of one topic by their stamps in nanoseconds."""


@dataclass(frozen=True, eq=False)
class AssembledRun:
    """A run put together from messages.

    Attributes:
        trajectory: one row per tick of which every message is there.
        incomplete: topics that are missing, by the stamp (ns) of each tick between the first and the
            last complete one.
    """

    trajectory: Trajectory
    incomplete: Mapping[int, tuple[Topic, ...]]


def split_trips(stamped: Iterable[tuple[int, T]]) -> list[dict[int, T]]:
    """Return what belongs to each trip by its stamps (ns), in order of the stamps; one trip at least.

    A stamp of 0 begins a trip. Of two messages with one stamp the later one counts.

    Args:
        stamped: stamp and message, in order of arrival.
    """
    trips: list[dict[int, T]] = [{}]
    for stamp_ns, message in stamped:
        if stamp_ns == 0 and any(trips[-1]):
            trips.append({})
        elif (
            len(trips) > 1
            and len(trips[-1]) == 1
            and stamp_ns > LEAST_REACH_NS
            and 0 <= stamp_ns - max(trips[-2]) <= LEAST_REACH_NS
        ):
            trips.pop()  # what began the last one was a stray stamp
        trips[-1][stamp_ns] = message
    return [dict(sorted(trip.items())) for trip in trips]


def by_stamp(messages: Iterable[Any]) -> dict[int, Any]:
    """Return the messages with a header of the last trip by their stamps (ns), in order of the stamps."""
    return split_trips((ns_from_time(message.header.stamp), message) for message in messages)[-1]


def assemble_run(messages: Mapping[Topic, ByStamp]) -> AssembledRun:
    """Put the trajectory of a run together.

    Ticks at the very start and end of which a message is missing are left out.

    Args:
        messages: those of `TICK_TOPICS`, by topic and stamp.

    Raises:
        MessageError: no tick is complete, or a message breaks its promise.
        StateError: the rows make no trajectory.
    """
    found = {topic: messages[topic] for topic in TICK_TOPICS}
    stamps = sorted(set().union(*found.values()))
    missing = {
        stamp: tuple(topic for topic, known in found.items() if stamp not in known)
        for stamp in stamps
    }
    complete = [stamp for stamp in stamps if not missing[stamp]]
    if not complete:
        counts = ", ".join(f"{topic.value} {len(known)}" for topic, known in found.items())
        raise MessageError(f"no tick is complete; messages per topic: {counts}")
    ticks = ({topic: known[stamp] for topic, known in found.items()} for stamp in complete)
    return AssembledRun(
        trajectory=Trajectory.from_ticks(
            (decode_observation(tick), decode_leader(tick[Topic.LEADER])) for tick in ticks
        ),
        incomplete={
            stamp: topics
            for stamp, topics in missing.items()
            if topics and complete[0] < stamp < complete[-1]
        },
    )


def assemble_decisions(messages: ByStamp) -> DecisionSeries:
    """Put the decisions of a run together from the messages of ``controller/solve``.

    Raises:
        MessageError: a message breaks its promise.
    """
    return DecisionSeries.from_records(
        [s_from_ns(stamp_ns) for stamp_ns in messages],
        [decode_decision_record(message) for message in messages.values()],
    )
