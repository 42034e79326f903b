"""Overrides of quality of service by topic, in a YAML file as `ros2 bag` takes it.

    /plant/odometry:
      reliability: best_effort
      depth: 5
      deadline: {sec: 1, nsec: 0}

What is not named stays as it would be without the file. Free of ROS.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Final

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from iptm_core.errors import BagError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.state import NS_PER_S
from iptm_core.user_input import check_known, shown
from iptm_recording.recorded_topics import UNLIMITED

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


@dataclass(frozen=True)
class QosOverrides:
    """Policies requested by the user, by topic.

    Attributes:
        by_topic: fields of `Qos` by full name of the topic.
    """

    by_topic: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def applied(self, topic: str, qos: Qos) -> Qos:
        """Return a profile with what is wanted for a topic."""
        return qos._replace(**self.by_topic.get(topic, {}))


def load_qos_overrides(path: Path) -> QosOverrides:
    """Read a file of overrides.

    Raises:
        BagError: it cannot be read, or names something that there is not.
    """
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
    return QosOverrides(by_topic)


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
