"""Names, types, QoS and units of topics."""

from __future__ import annotations

import re

import pytest
from sensor_msgs.msg import JointState

from iptm_ros.publishers import LATCHED_QOS, STREAM_QOS, describe_qos
from iptm_ros.topics import (
    TOPICS,
    Topic,
    frame_in,
    topic_of,
)

PACKAGES = "rosgraph|nav|geometry|sensor|std|trajectory|diagnostic|visualization"
ROOTS = "plant|v2x|controller|sensor|vehicle"


def test_a_topic_is_relative_of_a_standard_type_and_described() -> None:
    for spec in TOPICS.values():
        if spec.topic not in (Topic.DIAGNOSTICS, Topic.CLOCK):
            assert re.fullmatch(rf"({ROOTS})/[a-z0-9_]+", spec.name)
        assert re.fullmatch(rf"({PACKAGES})_msgs/msg/[A-Z]\w+", spec.type_name)
        assert all((spec.unit, spec.frame, spec.meaning, spec.rate, spec.publisher)), spec.name
        assert spec.fields or spec.message_type is not JointState


def test_profiles() -> None:
    """A hundred ticks fit into the queue of a listener that has stopped."""
    assert describe_qos(STREAM_QOS) == "reliable, keep last 100"
    assert describe_qos(LATCHED_QOS) == "reliable, keep last 1, transient-local"


@pytest.mark.parametrize(
    ("vehicle", "name"), [("/", "/clock"), ("/car_1", "/car_1/clock"), ("car_1/", "/car_1/clock")]
)
def test_topic_of_a_vehicle(vehicle: str, name: str) -> None:
    assert topic_of(vehicle, Topic.CLOCK) == name


@pytest.mark.parametrize(
    ("namespace", "frame", "expected"),
    [
        ("/", "odom", "odom"),
        ("", "odom", "odom"),
        ("/car_1", "odom", "car_1/odom"),
        ("fleet/car_1", "base_link", "fleet/car_1/base_link"),
        ("/car_1", "car_1/odom", "car_1/odom"),
        ("/car_1", "map", "map"),
        ("/car_1", "", ""),
    ],
)
def test_frames_carry_the_vehicle(namespace: str, frame: str, expected: str) -> None:
    assert frame_in(namespace, frame) == expected
