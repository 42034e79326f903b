"""Turns a bag back into the run that it recorded: its trajectory and its decisions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import BagError, IptmError, MissingTopicError
from iptm_core.trajectory import Trajectory
from iptm_ros.assembly import assemble_decisions, assemble_run, last_trip, split_trips
from iptm_ros.codecs import numbers_of, s_from_ns, stamp_of
from iptm_ros.recording.bag_reader import BagReader, opened
from iptm_ros.recording.run_information import stored_losses, stored_pauses
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.topics import TICK_TOPICS, TOPICS, Topic

_MOST_IN_FULL = 3


@dataclass(frozen=True)
class SettingsChange:
    """One change.

    Attributes:
        since_s: first tick that was decided with the new settings.
        what: names, new and former values.
        is_of_last_trip: not of a trip before the one that counts.
    """

    since_s: float
    what: str
    is_of_last_trip: bool = True

    def __str__(self) -> str:
        """Return the change in words."""
        return f"from {self.since_s:g} s on {self.what}"


def changes_in_words(changes: Sequence[SettingsChange]) -> list[str]:
    """Return what the figures of the last trip have to be read with, a few sentences at most."""
    earlier = [change for change in changes if not change.is_of_last_trip]
    during = [change for change in changes if change.is_of_last_trip]
    texts = []
    if earlier:
        texts.append(f"changed in an earlier trip: {_shortened([each.what for each in earlier])}")
    if during:
        texts.append(f"changed while driving: {_shortened([str(each) for each in during])}")
    return texts


def _shortened(entries: Sequence[str]) -> str:
    if len(entries) <= _MOST_IN_FULL:
        return "; ".join(entries)
    return f"{len(entries)} times, first {entries[0]}; last {entries[-1]}"


def read_settings_changes(
    bag: Path | BagReader, namespace: str | None = None
) -> list[SettingsChange]:
    """Return the changes inside a bag, in order; settings from before the bag are not listed.

    Args:
        bag: folder, file, or open.
        namespace: of the vehicle; None takes all there are.
    """
    from iptm_ros.diagnostics import (  # noqa: PLC0415  readers of trajectories do without ROS
        CHANGED_SETTINGS,
        SETTINGS_SINCE,
        status_values,
    )

    name = TOPICS[Topic.DIAGNOSTICS].name
    prefix = None if namespace is None else f"/{namespace.strip('/')}/".replace("//", "/")
    found: list[tuple[int, float, str]] = []
    since: dict[str, str] = {}
    with opened(bag) as reader:
        if name not in reader.topics:
            return []
        for item in reader.messages([name]):
            for status in item.message.status:
                values = status_values(status)
                now = values.get(SETTINGS_SINCE)
                if now is None or (prefix and status.name.rpartition("/")[0] + "/" != prefix):
                    continue
                before = since.get(status.name, now)
                since[status.name] = now
                if now != before and CHANGED_SETTINGS in values and _is_number(now):
                    found.append((item.log_time_ns, float(now), values[CHANGED_SETTINGS]))
        last_trip_ns = _last_trip_ns(reader, namespace) if found else 0
    return [SettingsChange(since_s, what, at_ns >= last_trip_ns) for at_ns, since_s, what in found]


def refuse_changed_settings(path: Path, namespace: str | None = None) -> None:
    """Refuse a bag inside which settings were changed; for arguments see `read_settings_changes`."""
    changes = read_settings_changes(path, namespace)
    if changes:
        raise BagError(
            f"settings of {path} were changed while it drove ({changes[0]}); allowed: settings that stay,"
            " as the ones of the start are taken for all ticks"
        )


def _last_trip_ns(reader: BagReader, namespace: str | None) -> int:
    try:
        return trip_starts_ns(reader, namespace)[-1]
    except BagError:  # diagnostics without a plant, or of several vehicles
        return 0


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_NONE_LOST = "the recorder counted no lost message"


def trip_starts_ns(reader: BagReader, namespace: str | None = None) -> list[int]:
    """Return the log times at which the trips in a bag start, one entry at least."""
    name = topic_name(reader, Topic.PLANT_STATE, namespace)
    raw = ((read_stamp_ns(each.data), each.log_time_ns) for each in reader.raw_messages([name]))
    trips = split_trips((stamp, at_ns) for stamp, at_ns in raw if stamp is not None)
    return [min(trip.values(), default=0) for trip in trips]


def read_trajectory(bag: Path | BagReader, namespace: str | None = None) -> Trajectory:
    """Read the run of a bag; of several trips the last one, see `iptm_ros.assembly`.

    Rows without a leader are marked, see `leader_remark`. Unpublished quantities are NaN throughout.

    Raises:
        BagError: the bag cannot be read, lacks the plant's state, has it of another type or not at every tick
            inside the run, the recording was paused there, or a message breaks its promise.
    """
    with opened(bag) as reader, _named_after(reader.path):
        path = reader.path
        run = assemble_run(_messages(reader, TICK_TOPICS[:1], namespace, TICK_TOPICS[1:]))
        pauses = stored_pauses(reader.run_information())
        losses = stored_losses(reader.run_information())
    first_s, last_s = run.trajectory.time_s[0], run.trajectory.time_s[-1]
    for after_s, until_s in pauses:
        if first_s <= after_s < until_s < last_s:
            raise BagError(
                f"{path} was paused after {after_s:g} s until {until_s:g} s:"
                " it holds parts of a run, each topic of which can be read"
            )
    for stamp_ns in run.incomplete:
        counted = sum(losses.values())
        raise BagError(
            f"{path} lacks {Topic.PLANT_STATE.value} at {s_from_ns(stamp_ns):g} s: "
            + (f"the recorder counted {counted} lost messages" if counted else _NONE_LOST)
        )
    return run.trajectory


def leader_remark(trajectory: Trajectory, losses: Mapping[str, int] | None = None) -> str:
    """Return at which ticks the leader is missing, and why; "" if it is always or never there.

    Args:
        trajectory: the run.
        losses: messages lost by the recorder, by topic; None without a recording.
    """
    missing_s = trajectory.time_s[~trajectory.has_leader]
    if missing_s.size in (0, len(trajectory)):
        return ""
    name = TOPICS[Topic.LEADER].name
    lost = sum(count for topic, count in (losses or {}).items() if topic.endswith(f"/{name}"))
    reason = f"the recorder counted {lost} lost messages of it" if lost else _NONE_LOST
    return (
        f"{name} is missing at {missing_s.size} ticks from {missing_s[0]:g} s to {missing_s[-1]:g} s"
        f"{'' if losses is None else f' ({reason})'}; gaps come from the other ticks"
    )


def read_decisions(bag: Path | BagReader, namespace: str | None = None) -> DecisionSeries:
    """Read how the controller came to its decisions."""
    with opened(bag) as reader, _named_after(reader.path):
        return assemble_decisions(_messages(reader, (Topic.SOLVE,), namespace)[Topic.SOLVE])


def vehicles(reader: BagReader) -> list[str]:
    """Return the namespaces of the vehicles in a bag, sorted; "/" stands for a suite without one."""
    spec = TOPICS[Topic.PLANT_STATE]
    return sorted(
        name.removesuffix(spec.name).rstrip("/") or "/"
        for name, topic in reader.topics.items()
        if name.endswith(f"/{spec.name}") and topic.type_name == spec.type_name
    )


def topic_name(reader: BagReader, topic: Topic, namespace: str | None) -> str:
    """Return the full name of a topic of the suite in a bag, after checking its type."""
    spec = TOPICS[topic]
    name = spec.name
    if namespace is not None and not name.startswith("/"):
        prefix = namespace.strip("/")
        name = f"/{prefix}/{name}" if prefix else f"/{name}"
        if topic is Topic.CLOCK and name not in reader.topics:
            name = f"/{spec.name}"  # the clock of a suite that shares one, and of old bags
    return reader.resolve(name, spec.type_name).name


def _messages(
    reader: BagReader,
    topics: Iterable[Topic],
    namespace: str | None,
    optional: Iterable[Topic] = (),
) -> dict[Topic, dict[int, Any]]:
    """Return the messages of stamped topics that count, by topic and stamp (ns); some may be missing."""
    if reader.message_count == 0:
        raise BagError(f"{reader.path} holds no messages")
    known = vehicles(reader)
    if namespace is None and len(known) > 1:
        raise BagError(
            f"{reader.path} holds {len(known)} vehicles; name one: --namespace {' or '.join(known)}"
        )
    keys = {topic_name(reader, topic, namespace): topic for topic in topics}
    for topic in optional:
        with suppress(MissingTopicError):
            keys[topic_name(reader, topic, namespace)] = topic
    found: dict[Topic, list[tuple[int, Any]]] = {topic: [] for topic in keys.values()}
    for raw in reader.raw_messages(list(keys)):
        topic = keys[raw.topic]
        message = numbers_of(topic, raw.data) or reader.decode(raw)
        found[topic].append((stamp_of(message), message))
    return last_trip({topic: messages for topic, messages in found.items() if messages})


@contextmanager
def _named_after(path: Path) -> Iterator[None]:
    """Give errors in the content the name of the bag."""
    try:
        yield
    except BagError:
        raise
    except IptmError as error:
        raise BagError(f"{path}: {error}") from None
