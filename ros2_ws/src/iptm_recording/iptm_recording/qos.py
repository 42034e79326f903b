"""Quality of service as bags store it, and what a subscriber or a replay makes of it.

Free of rclpy: the nodes translate to and from rclpy's profiles in ``qos_profiles.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from iptm_core.errors import BagError

# rosbag2 writes an unlimited duration as the largest 64-bit count of nanoseconds.
INFINITE_NS = 9223372036 * 10**9 + 854775807
DEFAULT_DEPTH = 10

# Values that rosbag2 wrote as integers before version 9 of the metadata (enumerations of rmw).
_HISTORY = ("system_default", "keep_last", "keep_all", "unknown")
_RELIABILITY = ("system_default", "reliable", "best_effort", "unknown", "best_available")
_DURABILITY = ("system_default", "transient_local", "volatile", "unknown", "best_available")
_LIVELINESS = (
    "system_default",
    "automatic",
    "manual_by_node",
    "manual_by_topic",
    "unknown",
    "best_available",
)


@dataclass(frozen=True)
class RecordedQos:
    """Quality of service that one publisher offered, with the names rosbag2 uses.

    Durations are nanoseconds; ``INFINITE_NS`` stands for no limit.
    """

    history: str = "keep_last"
    depth: int = DEFAULT_DEPTH
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline_ns: int = INFINITE_NS
    lifespan_ns: int = INFINITE_NS
    liveliness: str = "automatic"
    lease_ns: int = INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry of ``offered_qos_profiles`` as metadata version 9 wants it."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _duration_mapping(self.deadline_ns),
            "lifespan": _duration_mapping(self.lifespan_ns),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": _duration_mapping(self.lease_ns),
            "avoid_ros_namespace_conventions": self.avoid_ros_namespace_conventions,
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> RecordedQos:
        """Read one entry of ``offered_qos_profiles``, of any metadata version.

        Raises:
            BagError: the entry is not a profile.
        """
        try:
            return cls(
                history=_policy(mapping["history"], _HISTORY),
                depth=int(mapping["depth"]),
                reliability=_policy(mapping["reliability"], _RELIABILITY),
                durability=_policy(mapping["durability"], _DURABILITY),
                deadline_ns=_duration_ns(mapping["deadline"]),
                lifespan_ns=_duration_ns(mapping["lifespan"]),
                liveliness=_policy(mapping["liveliness"], _LIVELINESS),
                lease_ns=_duration_ns(mapping["liveliness_lease_duration"]),
                avoid_ros_namespace_conventions=bool(mapping["avoid_ros_namespace_conventions"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BagError(f"quality of service {mapping!r} is not a profile: {error!r}") from None


def dump_profiles(profiles: Sequence[RecordedQos]) -> str:
    """Return profiles as the YAML text that an MCAP channel carries."""
    text: str = yaml.safe_dump([p.to_mapping() for p in profiles], sort_keys=False)
    return text


def parse_profiles(source: str | Sequence[Mapping[str, Any]] | None) -> tuple[RecordedQos, ...]:
    """Read profiles from YAML text (older bags, MCAP channels) or from a parsed list.

    Raises:
        BagError: the text is no YAML or holds no list of profiles.
    """
    if not source:
        return ()
    if isinstance(source, str):
        try:
            source = yaml.safe_load(source)
        except yaml.YAMLError as error:
            raise BagError(f"offered_qos_profiles is not YAML: {error}") from None
    if not source:
        return ()
    if not isinstance(source, list):
        raise BagError(f"offered_qos_profiles is {type(source).__name__}, must be a list")
    return tuple(RecordedQos.from_mapping(entry) for entry in source)


def request_for(offered: Iterable[RecordedQos], depth: int) -> RecordedQos:
    """Choose the strictest request that every offer satisfies.

    A subscriber that asks for more than one of several publishers offers is never matched with it,
    so reliability and durability are asked for only where all offer them.

    Args:
        offered: what the publishers of a topic offer; none known yet means reliable, volatile.
        depth: messages to queue.
    """
    known = list(offered)
    reliable = all(qos.reliability != "best_effort" for qos in known)
    latched = bool(known) and all(qos.durability == "transient_local" for qos in known)
    return RecordedQos(
        depth=depth,
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
    )


def offer_for(recorded: Sequence[RecordedQos]) -> RecordedQos:
    """Choose the quality of service with which a recorded topic is published again.

    Of several recorded publishers the strongest reliability and durability are taken: an offer may
    exceed what a subscriber asks for, never fall short. Deadlines and leases are not repeated, as
    a replay at another rate could not keep them. An unknown history (the middleware does not
    announce it) becomes keep-last with the default depth.
    """
    reliable = not recorded or any(qos.reliability != "best_effort" for qos in recorded)
    latched = any(qos.durability == "transient_local" for qos in recorded)
    keep_all = any(qos.history == "keep_all" for qos in recorded)
    known_depth = max((qos.depth for qos in recorded if qos.history == "keep_last"), default=0)
    return RecordedQos(
        history="keep_all" if keep_all else "keep_last",
        depth=known_depth or DEFAULT_DEPTH,
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
    )


def _policy(value: str | int, names: tuple[str, ...]) -> str:
    if isinstance(value, int):
        return names[value] if 0 <= value < len(names) else "unknown"
    name = value.lower()
    return name if name in names else "unknown"


def _duration_ns(mapping: Mapping[str, int]) -> int:
    return int(mapping["sec"]) * 10**9 + int(mapping["nsec"])


def _duration_mapping(duration_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(duration_ns, 10**9)
    return {"sec": seconds, "nsec": nanoseconds}
