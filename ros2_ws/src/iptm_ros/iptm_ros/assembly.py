"""From messages back to the run: one row per tick, joined by header stamps.

Serves a bag as well as a node that listens to a run. Messages are joined by their header stamps; times of
reception are not used.

If several messages of a topic have the same stamp: a restarted plant begins a new trip, and the last trip
counts. Stamps of another node that go back while those of the plant do not (its clock jumped) begin no trip.
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
from iptm_ros.stamp_matcher import LEAST_REACH_NS
from iptm_ros.topics import OBSERVATION_TOPICS, TICK_TOPICS, Topic

M = TypeVar("M")

ByStamp = Mapping[int, Any]
"""Messages of one topic by their stamps in nanoseconds."""

Arrivals = Sequence[tuple[int, M]]
"""Messages of one topic with their stamps in nanoseconds, in the order of arrival."""


@dataclass(frozen=True, eq=False)
class AssembledRun:
    """A run put together from messages.

    Attributes:
        trajectory: one row per tick of which every message of the plant is there, with or without a leader;
            NaN stands for what was never published.
        incomplete: topics of the plant that are missing, by the stamp (ns) of each tick between the first and
            the last complete one.
    """

    trajectory: Trajectory
    incomplete: Mapping[int, tuple[Topic, ...]]


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
    if Topic.PLANT_ODOMETRY in found:
        trips = len(found[Topic.PLANT_ODOMETRY])
        for of_topic in found.values():
            while len(of_topic) > trips:
                later = of_topic.pop()
                of_topic[-1] = dict(sorted((of_topic[-1] | later).items()))
    last = min(map(len, found.values()), default=1) - 1
    return {topic: of_topic[last] for topic, of_topic in found.items()}


def assemble_run(messages: Mapping[Topic, ByStamp]) -> AssembledRun:
    """Put the trajectory of a run together.

    Ticks at the very start and end of which a message of the plant is missing are left out. Rows without a
    leader have NaN in its columns. A topic without messages counts as not published.

    Args:
        messages: those of `TICK_TOPICS` as far as they were published, at least the plant's odometry, by
            topic and stamp; those of `Topic.PLANT_SAFETY` if there are any.

    Raises:
        MessageError: no tick is complete, or a message breaks its promise.
        StateError: the rows make no trajectory.
    """
    found = {topic: messages[topic] for topic in OBSERVATION_TOPICS if messages.get(topic)}
    leaders = messages.get(Topic.LEADER, {})
    stamps = sorted(set().union(*found.values()))
    missing = {
        stamp: tuple(topic for topic, known in found.items() if stamp not in known)
        for stamp in stamps
    }
    complete = [stamp for stamp in stamps if not missing[stamp]]
    if not complete or Topic.PLANT_ODOMETRY not in found:
        counts = ", ".join(f"{topic.value} {len(messages.get(topic, ()))}" for topic in TICK_TOPICS)
        raise MessageError(f"no tick is complete; messages per topic: {counts}")
    safety = messages.get(Topic.PLANT_SAFETY, {})
    plant = (
        {topic: known[stamp] for topic, known in found.items()}
        | ({Topic.PLANT_SAFETY: safety[stamp]} if stamp in safety else {})
        for stamp in complete
    )
    leader = (decode_leader(leaders[stamp]) if stamp in leaders else None for stamp in complete)
    return AssembledRun(
        trajectory=Trajectory.from_ticks(zip(map(decode_observation, plant), leader, strict=True)),
        incomplete={
            stamp: topics
            for stamp, topics in missing.items()
            if topics and complete[0] < stamp < complete[-1]
        },
    )


def unpublished(trajectory: Trajectory) -> list[str]:
    """Return a sentence for each topic of which a trajectory has nothing."""
    rows = len(trajectory)
    return [
        f"{topic.value} was not published: figures that need it are missing"
        for topic, column in _COLUMNS.items()
        if trajectory.unknown.get(column) == rows
    ]


_COLUMNS = {
    Topic.PLANT_ACCELERATION: "acceleration_m_s2",
    Topic.PLANT_CELL_1_TEMPERATURE: "cell_1_temperature_k",
    Topic.PLANT_CELL_N_TEMPERATURE: "cell_n_temperature_k",
    Topic.PLANT_COOLANT_INLET_TEMPERATURE: "coolant_inlet_temperature_k",
    Topic.PLANT_COOLANT_OUTLET_TEMPERATURE: "coolant_outlet_temperature_k",
    Topic.PLANT_POWERS: "battery_power_w",
    Topic.PLANT_CAPACITY_LOSS: "cell_1_capacity_loss",
    Topic.LEADER: "leader_position_m",
}
"""A column of a trajectory by the topic that it comes from, for all but the odometry."""


def assemble_decisions(messages: ByStamp) -> DecisionSeries:
    """Put the decisions of a run together from the messages of ``controller/solve``."""
    return DecisionSeries.from_records(
        [s_from_ns(stamp_ns) for stamp_ns in messages],
        [decode_decision_record(message) for message in messages.values()],
    )
