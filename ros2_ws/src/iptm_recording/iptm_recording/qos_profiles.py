"""Translates between rclpy's QoS profiles and the ones stored in bags."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from iptm_recording.qos import RecordedQos


def to_profile(qos: RecordedQos) -> QoSProfile:
    """Return the profile with which to publish or subscribe (history, reliability, durability)."""
    return QoSProfile(
        history=HistoryPolicy[qos.history.upper()],
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
    )


def from_profile(profile: QoSProfile) -> RecordedQos:
    """Return what a publisher of the graph offers, as a bag stores it."""
    return RecordedQos(
        history=HistoryPolicy(profile.history).name.lower(),
        depth=profile.depth,
        reliability=ReliabilityPolicy(profile.reliability).name.lower(),
        durability=DurabilityPolicy(profile.durability).name.lower(),
        deadline_ns=_nanoseconds(profile.deadline),
        lifespan_ns=_nanoseconds(profile.lifespan),
        liveliness=LivelinessPolicy(profile.liveliness).name.lower(),
        lease_ns=_nanoseconds(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _nanoseconds(duration: Duration) -> int:
    nanoseconds: int = duration.nanoseconds
    return nanoseconds
