"""Message classes and QoS with which rclpy publishes and subscribes the topics of a bag."""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from iptm_core.errors import BagError
from iptm_core.state import NS_PER_S
from iptm_ros.recording.message_types import is_installed, known_hashes
from iptm_ros.recording.recorded_topics import UNLIMITED, TopicRecord


def message_class(type_name: str) -> type[Any]:
    """Return the Python class of a message type; a bag names any, so only installed ones are imported.

    Raises:
        BagError: no installed package defines it.
    """
    package, kind, name = (*type_name.split("/"), "", "")[:3]
    if kind != "msg":
        raise BagError(f"message type is {type_name!r}; allowed: package/msg/Type")
    if not is_installed(type_name):
        raise BagError(f"message type {type_name}: no installed package defines it")
    try:
        found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), name)
    except ImportError:
        raise BagError(f"message type {type_name}: package {package} is not installed") from None
    except AttributeError:
        raise BagError(f"message type {type_name}: package {package} has no such type") from None
    return found


def recorded_class(topic: TopicRecord) -> type[Any]:
    """Return the class with which the recorded bytes of a topic can be published."""
    kind = message_class(topic.type_name)
    hashes = known_hashes(topic.type_name)
    if topic.type_hash and hashes and topic.type_hash not in hashes:
        raise BagError(f"message type {topic.type_name} is defined otherwise here than in the bag")
    return kind


def to_profile(qos: Qos) -> QoSProfile:
    """Return the profile with which to publish or subscribe; unlimited times are left to the middleware."""
    times = {
        name: Duration(seconds=time.sec, nanoseconds=time.nsec)
        for name in ("deadline", "lifespan", "liveliness_lease_duration")
        if (time := getattr(qos, name)) != UNLIMITED
    }
    return QoSProfile(
        history=HistoryPolicy[qos.history.name],
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
        liveliness=LivelinessPolicy[qos.liveliness.name],
        avoid_ros_namespace_conventions=qos.avoid_ros_namespace_conventions,
        **times,
    )


def from_profile(profile: QoSProfile) -> Qos:
    """Return what a publisher of the graph offers, as a bag stores it."""
    return Qos(
        history=QosHistory[HistoryPolicy(profile.history).name],
        depth=profile.depth,
        reliability=QosReliability[ReliabilityPolicy(profile.reliability).name],
        durability=QosDurability[DurabilityPolicy(profile.durability).name],
        deadline=_time(profile.deadline),
        lifespan=_time(profile.lifespan),
        liveliness=QosLiveliness[LivelinessPolicy(profile.liveliness).name],
        liveliness_lease_duration=_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, NS_PER_S))
