"""Quality of service of the suite: two profiles, nothing else.

State and commands are a reliable stream; data that never changes is latched for late joiners.
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

STREAM_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""State, previews and commands: reliable, keep last 10, volatile."""

LATCHED_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Static data: reliable, keep last 1, transient-local (a late subscriber still gets it)."""


def describe_qos(profile: QoSProfile) -> str:
    """Return a profile in words, for tables and error texts, e.g. `reliable, keep last 10`."""
    reliability = profile.reliability.name.lower().replace("_", " ")
    durability = profile.durability.name.lower().replace("_", "-")
    text = f"{reliability}, keep last {profile.depth}"
    return text if durability == "volatile" else f"{text}, {durability}"
