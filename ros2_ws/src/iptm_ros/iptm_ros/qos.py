"""Quality of service of the suite's topics: what publishers offer and subscribers request."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

STREAM_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""State, previews and commands: reliable, volatile, and deep, as foreign messages must not displace due ones
in a subscription, and a listener may be a moment late.
"""

KEPT_STREAM_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""A stream that late subscribers receive from its beginning, as far as the history is kept."""

LATCHED_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Static data: reliable, keep last 1, transient-local (a late subscriber still gets it)."""

RAW_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=5000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""What comes in bursts and must not be lost: reliable, keep last 5000, volatile."""

SENSOR_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""Requested of sensors of any origin: best effort, which reliable publishers meet as well, keep last 100."""


def describe_qos(profile: QoSProfile) -> str:
    """Return a profile in words, for tables and error texts, e.g. `reliable, keep last 100`."""
    reliability = profile.reliability.name.lower().replace("_", " ")
    durability = profile.durability.name.lower().replace("_", "-")
    text = f"{reliability}, keep last {profile.depth}"
    return text if durability == "volatile" else f"{text}, {durability}"
