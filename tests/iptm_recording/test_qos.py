from __future__ import annotations

import pytest
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from iptm_core.errors import BagError
from iptm_interfaces.qos import LATCHED_QOS, STREAM_QOS
from iptm_recording.qos import (
    INFINITE_NS,
    RecordedQos,
    dump_profiles,
    offer_for,
    parse_profiles,
    request_for,
)
from iptm_recording.qos_profiles import from_profile, to_profile

RELIABLE = RecordedQos()
BEST_EFFORT = RecordedQos(reliability="best_effort")
LATCHED = RecordedQos(durability="transient_local", depth=1)


def test_profiles_survive_the_text_of_a_channel() -> None:
    profiles = (RELIABLE, BEST_EFFORT, RecordedQos(depth=3, deadline_ns=1_500_000_000))
    assert parse_profiles(dump_profiles(profiles)) == profiles


def test_durations_are_written_as_rosbag2_does() -> None:
    mapping = RELIABLE.to_mapping()
    assert mapping["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert mapping["history"] == "keep_last"
    assert RecordedQos.from_mapping(mapping).lease_ns == INFINITE_NS == 2**63 - 1


def test_numbers_of_older_bags_are_understood() -> None:
    mapping = {**RELIABLE.to_mapping(), "history": 3, "reliability": 2, "durability": 1}
    qos = RecordedQos.from_mapping(mapping)
    assert (qos.history, qos.reliability, qos.durability) == (
        "unknown",
        "best_effort",
        "transient_local",
    )


@pytest.mark.parametrize("source", ["", None, [], "[]"])
def test_no_profiles(source: str | None) -> None:
    assert parse_profiles(source) == ()


@pytest.mark.parametrize("source", ["{", "text", "- history: keep_last", "- 3"])
def test_malformed_profiles(source: str) -> None:
    with pytest.raises(BagError):
        parse_profiles(source)


def test_request_is_satisfied_by_every_publisher() -> None:
    assert request_for([], 5) == RecordedQos(depth=5)
    assert request_for([RELIABLE, BEST_EFFORT], 5).reliability == "best_effort"
    assert request_for([LATCHED], 5).durability == "transient_local"
    assert request_for([LATCHED, RELIABLE], 5).durability == "volatile"


def test_offer_satisfies_every_former_subscriber() -> None:
    assert offer_for([]).reliability == "reliable"
    assert offer_for([RELIABLE, BEST_EFFORT]).reliability == "reliable"
    assert offer_for([BEST_EFFORT]).reliability == "best_effort"
    assert offer_for([LATCHED]) == LATCHED
    unknown = RecordedQos(history="unknown", depth=0)
    assert offer_for([unknown]).depth > 0


@pytest.mark.parametrize("profile", [STREAM_QOS, LATCHED_QOS])
def test_suite_profiles_survive_the_way_to_a_bag_and_back(profile: QoSProfile) -> None:
    back = to_profile(
        RecordedQos.from_mapping(yaml.safe_load(dump_profiles([from_profile(profile)]))[0])
    )
    assert back.depth == profile.depth
    assert back.reliability == profile.reliability == ReliabilityPolicy.RELIABLE
    assert back.durability == profile.durability
    assert profile.durability in (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
