"""Topics for 3-D viewers, published on request.

They are not part of a run: no node waits for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nav_msgs.msg import Path
from visualization_msgs.msg import MarkerArray

from iptm_ros.topics import MAP_FRAME, Topic, TopicSpec

PUBLISHER = "visualizer"
DESCRIPTION_TOPIC = "robot_description"
"""URDF of the car as a `std_msgs/String`, latched: where viewers look for it."""
_RATE = "while someone listens, up to rate_hz"

# fmt: off
_SPECS = (
    TopicSpec(
        Topic.VISUAL_ROAD, Path, PUBLISHER, MAP_FRAME, "m",
        "the road ahead of the start, its height from the slope; 0, 0, 0 is where the ego vehicle starts",
        latched=True, rate="with every new v2x/slope",
    ),
    TopicSpec(
        Topic.VISUAL_PLAN, Path, PUBLISHER, MAP_FRAME, "m",
        "the plan as poses along the road; each has the time at which the ego vehicle shall be there",
        rate=_RATE,
    ),
    TopicSpec(
        Topic.VISUAL_LEADER_PREVIEW, Path, PUBLISHER, MAP_FRAME, "m",
        "the predicted motion of the leader's rear bumper", rate=_RATE,
    ),
    TopicSpec(
        Topic.VISUAL_LEADER_BOUND, Path, PUBLISHER, MAP_FRAME, "m",
        "the same motion less its bounds: where the leader is at least; no poses where it is known",
        rate=_RATE,
    ),
    TopicSpec(
        Topic.VISUAL_SCENE, MarkerArray, PUBLISHER, MAP_FRAME, "m",
        "both cars, bars across the road where the gap would be s_min (red) and s_max (blue), and speed, "
        "gap and temperature in words",
        rate=_RATE,
    ),
)
# fmt: on

VISUAL_TOPICS: Mapping[Topic, TopicSpec] = MappingProxyType({spec.topic: spec for spec in _SPECS})
"""Specification of every topic of the visualizer by its key."""
