"""Topics of a bag, their selection, and their quality of service.

Free of rclpy: the nodes translate to and from rclpy's QoS profiles in `rclpy_types`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache

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
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.user_input import shown

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
    """Return the profiles in the YAML text of an MCAP channel, of any metadata version.

    Raises:
        BagError: the text is not YAML or does not hold a list of profiles.
    """
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
