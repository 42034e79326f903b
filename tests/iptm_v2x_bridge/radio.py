"""Stations on the test road for the tests of the receiver, and what they send."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewSettings
from iptm_core.state import LeaderPreview
from iptm_v2x_bridge.bridge import CycleSource, preview_times_s
from iptm_v2x_bridge.messages.cam import CamMessage, encode_cam
from iptm_v2x_bridge.sender import car_on_road

ROAD = RoadLine.test_road()
NS = 10**9


def predicted(
    source: CycleSource, time_ns: int, length_s: float = 60.0, step_s: float = 1.0
) -> LeaderPreview:
    """Return what a source predicts at an instant."""
    settings = PreviewSettings(preview_length_s=length_s, preview_step_s=step_s)
    return source.predict(preview_times_s(settings, time_ns))


def station(
    identity: int, time_ms: int, rear_m: float, speed_m_s: float, left_m: float = 0.0, **more: Any
) -> CamMessage:
    """Return what a car of 4.5 m says that drives along the test road, so much to the left of its middle."""
    message = car_on_road(ROAD, identity, time_ms, rear_m, speed_m_s, left_m=left_m)
    return replace(message, **{"width_m": None, "position_bound_m": 0.0, **more})


def datagram(*arguments: Any, **more: Any) -> bytes:
    """Return the bare datagram of `station`."""
    return encode_cam(station(*arguments, **more))
