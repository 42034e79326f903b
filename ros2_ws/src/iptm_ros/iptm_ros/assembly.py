"""From messages back to the run: one row per tick, joined by header stamps.

Serves a bag as well as a node that listens to a run. Messages are joined by their header stamps; times of
reception are not used.

If several messages of a topic have the same stamp: a restarted plant begins a new trip, and the last trip
counts. Stamps of another node that go back while the plant's do not (its clock jumped) begin no trip.
Within a trip the last message of a stamp counts, unless a second plant drove at the same time: then the
first one, as that one was answered.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import MessageError
from iptm_core.trajectory import Trajectory
from iptm_ros.codecs import (
    decode_decision_record,
    decode_leader,
    decode_observation,
    s_from_ns,
)
from iptm_ros.stamp_gate import LEAST_REACH_NS
from iptm_ros.topics import Topic

M = TypeVar("M")

ByStamp = Mapping[int, Any]
"""Messages of one topic by their stamps in nanoseconds."""

Arrivals = Sequence[tuple[int, M]]
"""Messages of one topic with their stamps in nanoseconds, in the order of arrival."""


@dataclass(frozen=True, eq=False)
class AssembledRun:
    """A run put together from messages.

    Attributes:
        trajectory: one row per state, with or without a leader; NaN: never published.
        incomplete: stamps (ns) between the first and the last state that have a leader, but no state.
    """

    trajectory: Trajectory
    incomplete: tuple[int, ...]


def split_trips(stamped: Iterable[tuple[int, M]]) -> list[dict[int, M]]:
    """Return the messages of a topic that count, trip by trip, by their stamps (ns) and in their order.

    Returns:
        At least one trip, empty without messages.
    """
    found: list[dict[int, M]] = [{}]
    newest_ns = [-1]  # of each trip
    last_ns = -1
    for stamp_ns, message in stamped:
        if len(found) > 1 and last_ns + LEAST_REACH_NS < newest_ns[-2] < stamp_ns:
            # The previous trip continues after one that began at the same time.
            newest_ns.pop()
            _merge_last(found)
        # A first 0 behind a later stamp was sent again by the middleware and is only late.
        elif (stamp_ns == 0 < last_ns and 0 in found[-1]) or stamp_ns < last_ns - LEAST_REACH_NS:
            found.append({})
            newest_ns.append(-1)
        found[-1][stamp_ns] = message
        newest_ns[-1] = max(newest_ns[-1], stamp_ns)
        last_ns = stamp_ns
    if len(found) > 1 and len(found[-1]) == 1:
        _merge_last(found)  # a lone first tick is not a trip
    return [dict(sorted(trip.items())) for trip in found]


def _merge_last(found: list[dict[int, M]]) -> None:
    """Add to the last trip but one what only the last one has."""
    for stamp_ns, message in found.pop().items():
        found[-1].setdefault(stamp_ns, message)


def last_trip(messages: Mapping[Topic, Arrivals[M]]) -> dict[Topic, dict[int, M]]:
    """Return the messages that count of the last trip that is there in every topic."""
    found = {topic: split_trips(stamped) for topic, stamped in messages.items()}
    if Topic.PLANT_STATE in found:
        trips = len(found[Topic.PLANT_STATE])
        for of_topic in found.values():
            while len(of_topic) > trips:
                later = of_topic.pop()
                of_topic[-1] = dict(sorted((of_topic[-1] | later).items()))
    last = min(map(len, found.values()), default=1) - 1
    return {topic: of_topic[last] for topic, of_topic in found.items()}


def assemble_run(messages: Mapping[Topic, ByStamp]) -> AssembledRun:
    """Put the trajectory of a run together.

    Rows without a leader have NaN in its columns.

    Args:
        messages: of `TICK_TOPICS`, by topic and stamp; a leader is optional.

    Raises:
        MessageError: the state is missing, or a message breaks its promise.
        StateError: the rows make no trajectory.
    """
    states, leaders = messages.get(Topic.PLANT_STATE, {}), messages.get(Topic.LEADER, {})
    stamps = sorted(states)
    if not stamps:
        raise MessageError(f"no message of {Topic.PLANT_STATE.value}; allowed: one or more")
    observed = (decode_observation(states[stamp]) for stamp in stamps)
    leader = (decode_leader(leaders[stamp]) if stamp in leaders else None for stamp in stamps)
    return AssembledRun(
        trajectory=Trajectory.from_ticks(zip(observed, leader, strict=True)),
        incomplete=tuple(
            stamp
            for stamp in sorted(leaders.keys() - states.keys())
            if stamps[0] < stamp < stamps[-1]
        ),
    )


def unpublished(trajectory: Trajectory, *, has_leader: bool = True) -> list[str]:
    """Return a sentence for each column that figures need and of which a trajectory has nothing."""
    needed = _NEEDED if has_leader else _NEEDED[1:]
    missing = [name for name in needed if trajectory.unknown.get(name) == len(trajectory)]
    return [f"{name} was not published: figures that need it are missing" for name in missing]


_NEEDED = (
    "leader_position_m",
    "battery_power_w",
    "state_of_charge",
    "coolant_inlet_temperature_k",
    "coolant_outlet_temperature_k",
)


def assemble_decisions(messages: ByStamp) -> DecisionSeries:
    """Put the decisions of a run together from the messages of ``controller/solve``."""
    return DecisionSeries.from_records(
        [s_from_ns(stamp_ns) for stamp_ns in messages],
        map(decode_decision_record, messages.values()),
    )
