"""Stations on the test road for the tests of the receiver, and what they send."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.messages.cam_codec import encode_cam

ROAD = RoadLine.test_road()
NS_PER_MS = 1_000_000


def station(
    identity: int, time_ms: int, rear_m: float, speed_m_s: float, left_m: float = 0.0, **more: Any
) -> CamMessage:
    """Return what a car of 4.5 m says that drives along the test road, so much to the left of its middle."""
    latitude, longitude, heading = (float(value) for value in ROAD.locate(rear_m + 4.5))
    one_east, _ = east_north_m(latitude, longitude + 1e-5, (latitude, longitude))
    message = CamMessage(
        station_id=identity,
        delta_time_ms=time_ms % 65_536,
        latitude_deg=latitude,
        longitude_deg=longitude - left_m * 1e-5 / float(one_east),
        heading_deg=heading,
        speed_m_s=speed_m_s,
        acceleration_m_s2=0.0,
        length_m=4.5,
        position_bound_m=0.0,
    )
    return replace(message, **more)


def datagram(*arguments: Any, **more: Any) -> bytes:
    """Return the bare datagram of `station`."""
    return encode_cam(station(*arguments, **more))
