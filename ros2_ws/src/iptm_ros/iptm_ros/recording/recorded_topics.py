"""Topics of a bag, their selection, and their quality of service.

Free of rclpy: the nodes translate to and from rclpy's QoS profiles in `rclpy_types`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

from iptm_core.errors import BagError
from iptm_core.parameters.strict_yaml import parse_yaml, read_yaml
from iptm_core.state import NS_PER_S
from iptm_core.user_input import check_known, shown

QosOverrides = Mapping[str, Mapping[str, Any]]
"""Fields of `Qos` that the user asks for, by full name of the topic; the others stay as they would be."""

_KINDS: Final[Mapping[str, type[Enum]]] = {
    "history": QosHistory,
    "reliability": QosReliability,
    "durability": QosDurability,
    "liveliness": QosLiveliness,
}
_ALLOWED: Final = {
    "history": ("keep_last", "keep_all", "system_default"),
    "reliability": ("reliable", "best_effort", "system_default"),
    "durability": ("volatile", "transient_local", "system_default"),
    "liveliness": ("automatic", "manual_by_topic", "system_default"),
}
_TIMES = ("deadline", "lifespan", "liveliness_lease_duration")
_CONVENTIONS = "avoid_ros_namespace_conventions"
_DEPTH = "depth"
_MOST_DEPTH = 1_000_000


def overridden(qos: Qos, topic: str, overrides: QosOverrides) -> Qos:
    """Return a profile with what the user asks for on a topic."""
    return qos._replace(**overrides.get(topic, {}))


def load_qos_overrides(path: Path | None) -> QosOverrides:
    """Read a file of overrides as `ros2 bag` takes it; without one there are none.

    /plant/odometry:
      reliability: best_effort
      depth: 5
      deadline: {sec: 1, nsec: 0}
    """
    if path is None:
        return {}
    content = read_yaml(path, BagError)
    if not isinstance(content, dict):
        raise BagError(f"{path} is {shown(content)}; allowed: a mapping of topics to policies")
    by_topic = {}
    for topic, policies in content.items():
        if not isinstance(topic, str) or not topic.startswith("/"):
            raise BagError(
                f"{path}: topic is {shown(topic)}; allowed: a full name, with '/' in front"
            )
        where = f"{path}: {topic}"
        if not isinstance(policies, dict):
            raise BagError(f"{where} is {shown(policies)}; allowed: a mapping of policies")
        by_topic[topic] = {name: _value(where, name, value) for name, value in policies.items()}
    return by_topic


def _value(where: str, name: object, value: object) -> object:
    check_known(name, (*_KINDS, *_TIMES, _DEPTH, _CONVENTIONS), where, "policy", BagError)
    place = f"{where}: {name}"
    if name in _TIMES:
        return _time(place, value)
    if name == _DEPTH:
        return _whole(place, value, _MOST_DEPTH)
    if name == _CONVENTIONS:
        if not isinstance(value, bool):
            raise BagError(f"{place} is {shown(value)}; allowed: true, false")
        return value
    if not isinstance(value, str) or value.lower() not in _ALLOWED[str(name)]:
        raise BagError(f"{place} is {shown(value)}; allowed: {', '.join(_ALLOWED[str(name)])}")
    return _KINDS[str(name)][value.upper()]


def _time(place: str, value: object) -> QosTime:
    if not isinstance(value, dict) or set(value) != {"sec", "nsec"}:
        raise BagError(f"{place} is {shown(value)}; allowed: {{sec: ..., nsec: ...}}")
    seconds = _whole(f"{place}.sec", value["sec"], UNLIMITED.sec)
    most_ns = UNLIMITED.nsec if seconds == UNLIMITED.sec else NS_PER_S - 1
    return QosTime(seconds, _whole(f"{place}.nsec", value["nsec"], most_ns))


def _whole(place: str, value: object, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise BagError(f"{place} is {shown(value)}; allowed: a whole number from 0 to {most}")
    return value


# rosbag2 writes an unlimited duration as the largest 64-bit count of nanoseconds.
UNLIMITED = QosTime(9223372036, 854775807)
DEFAULT_QOS = Qos(
    history=QosHistory.KEEP_LAST,
    depth=10,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.VOLATILE,
    deadline=UNLIMITED,
    lifespan=UNLIMITED,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=UNLIMITED,
    avoid_ros_namespace_conventions=False,
)


@dataclass(frozen=True)
class TopicRecord:
    """One recorded topic.

    Attributes:
        name: fully qualified topic name.
        type_name: `package/msg/Type`.
        type_hash: RIHS01 hash of the type, "" when unknown.
        offered_qos: what the publishers offered.
        message_count: recorded messages.
    """

    name: str
    type_name: str
    type_hash: str
    offered_qos: tuple[Qos, ...]
    message_count: int

    @property
    def is_latched(self) -> bool:
        """True if a publisher kept its last message for subscribers that join later."""
        return any(map(is_latched, self.offered_qos))


@dataclass(frozen=True)
class TopicSelection:
    """Topics wanted and not wanted.

    Attributes:
        include: full names or patterns (`/plant/*`, where `*` also spans `/`); empty for all.
        exclude: full names or patterns that are left out in any case.
    """

    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()

    def takes(self, name: str) -> bool:
        """Return whether a topic, given by its full name, is wanted."""
        if self.excludes(name):
            return False
        return not self.include or any(_matches(name, pattern) for pattern in self.include)

    def excludes(self, name: str) -> bool:
        """Return whether a topic is left out in any case."""
        return any(_matches(name, pattern) for pattern in self.exclude)

    def unused(self, names: Iterable[str]) -> list[str]:
        """Return the patterns, wanted or not, that none of the names matches (typing errors)."""
        known = list(names)
        return [
            pattern
            for pattern in (*self.include, *self.exclude)
            if not any(_matches(name, pattern) for name in known)
        ]


def is_latched(qos: Qos) -> bool:
    """Return whether a publisher keeps its last message only, static data, for subscribers that join later.

    A depth of 0 is unknown: the middleware does not announce it. Publishers that keep more messages offer
    the beginning of a stream.
    """
    return qos.durability is QosDurability.TRANSIENT_LOCAL and qos.depth <= 1


def _matches(name: str, pattern: str) -> bool:
    """Return whether a name fits a pattern; a relative pattern matches in any namespace."""
    if pattern.startswith("/"):
        return fnmatchcase(name, pattern)
    return fnmatchcase(name, f"/{pattern}") or fnmatchcase(name, f"*/{pattern}")


def dump_profiles(profiles: Sequence[Qos]) -> str:
    """Return profiles as the YAML text that an MCAP channel carries."""
    text: str = yaml.safe_dump(dump_qos_v9(list(profiles)), sort_keys=False)
    return text


@lru_cache(maxsize=256)  # most topics of a bag have the same ones
def parse_profiles(text: str) -> tuple[Qos, ...]:
    """Return the profiles in the YAML text of an MCAP channel, of any metadata version."""
    allowed = "a YAML list of QoS profiles"
    entries = parse_yaml(text, "offered_qos_profiles", BagError)
    if entries is not None and not isinstance(entries, list):
        raise BagError(f"offered_qos_profiles is {shown(text)}; allowed: {allowed}")
    try:
        return tuple(parse_qos(entries or []))
    except (ReaderError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise BagError(
            f"offered_qos_profiles is {shown(text)} ({error!r}); allowed: {allowed}"
        ) from None


def request_for(offered: Iterable[Qos], depth: int) -> Qos:
    """Return the strictest request that every offer satisfies.

    A subscriber that asks for more than one of several publishers offers is never matched with it,
    so reliability and durability are asked for only where all offer them.

    Args:
        offered: what the publishers of a topic offer; none known yet means reliable, volatile.
        depth: messages to queue.
    """
    known = list(offered)
    reliable = all(qos.reliability is not QosReliability.BEST_EFFORT for qos in known)
    latched = all(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in known)
    return _profile(depth, reliable=reliable, latched=bool(known) and latched)


def offer_for(topic: TopicRecord) -> Qos:
    """Return the quality of service with which a recorded topic is published again.

    Of several recorded publishers the strongest reliability and durability are taken: an offer may
    exceed what a subscriber asks for, never fall short. Deadlines and leases are not repeated, as
    a replay at another rate could not keep them. An unknown history (the middleware does not
    announce it) becomes keep-last with the default depth.
    """
    recorded = topic.offered_qos
    reliable = any(qos.reliability is not QosReliability.BEST_EFFORT for qos in recorded)
    kept = any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in recorded)
    depths = [qos.depth for qos in recorded if qos.history is QosHistory.KEEP_LAST]
    offer = _profile(
        max(depths, default=0) or DEFAULT_QOS.depth,
        reliable=reliable or not recorded,
        latched=kept,
    )
    keep_all = any(qos.history is QosHistory.KEEP_ALL for qos in recorded)
    return offer._replace(history=QosHistory.KEEP_ALL) if keep_all else offer


def _profile(depth: int, *, reliable: bool, latched: bool) -> Qos:
    return DEFAULT_QOS._replace(
        depth=depth,
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
    )
