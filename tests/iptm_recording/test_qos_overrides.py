from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, ReliabilityPolicy
from rosbags.interfaces import QosReliability

from iptm_core.errors import BagError
from iptm_recording.qos_overrides import load_qos_overrides
from iptm_recording.rclpy_types import to_profile
from iptm_recording.recorded_topics import DEFAULT_QOS

FILE = """
/chatter:
  history: keep_all
  depth: 7
  reliability: best_effort
  durability: transient_local
  liveliness: manual_by_topic
  liveliness_lease_duration: {sec: 2, nsec: 500000000}
  deadline: {sec: 0, nsec: 250000000}
  lifespan: {sec: 30, nsec: 0}
  avoid_ros_namespace_conventions: true
/other:
  reliability: best_effort
"""


def test_a_file_as_rosbag2_takes_it(tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text(FILE)
    overrides = load_qos_overrides(tmp_path / "qos.yaml")
    profile = to_profile(overrides.applied("/chatter", DEFAULT_QOS))
    assert profile.history is HistoryPolicy.KEEP_ALL
    assert profile.depth == 7
    assert profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC
    assert profile.liveliness_lease_duration == Duration(seconds=2.5)
    assert profile.deadline == Duration(seconds=0.25)
    assert profile.lifespan == Duration(seconds=30)
    assert profile.avoid_ros_namespace_conventions


def test_what_is_not_named_stays(tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text(FILE)
    overrides = load_qos_overrides(tmp_path / "qos.yaml")
    other = DEFAULT_QOS._replace(reliability=QosReliability.BEST_EFFORT)
    assert overrides.applied("/other", DEFAULT_QOS) == other
    assert overrides.applied("/third", DEFAULT_QOS) == DEFAULT_QOS


def test_an_unlimited_time_as_bags_have_it(tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text("/a: {deadline: {sec: 9223372036, nsec: 854775807}}")
    overrides = load_qos_overrides(tmp_path / "qos.yaml")
    assert overrides.applied("/a", DEFAULT_QOS) == DEFAULT_QOS


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- 1", "allowed: a mapping of topics"),
        ("chatter: {}", "topic is 'chatter'; allowed: a full name"),
        ("/a: reliable", "/a is 'reliable'; allowed: a mapping"),
        ("/a: {reliabilty: reliable}", "reliability"),
        ("/a: {reliability: RELIABLY}", "'RELIABLY'; allowed: reliable, best_effort"),
        ("/a: {history: unknown}", "'unknown'; allowed: keep_last"),
        ("/a: {depth: -1}", "depth is -1; allowed"),
        ("/a: {depth: true}", "depth is True; allowed"),
        ("/a: {deadline: 1.5}", "deadline is 1.5; allowed: {sec"),
        ("/a: {deadline: {sec: 1, nsec: 1000000000}}", "nsec is 1000000000"),
        ("/a: {lifespan: {sec: 9223372036, nsec: 854775808}}", "from 0 to 854775807"),
        ("/a: {avoid_ros_namespace_conventions: 1}", "allowed: true, false"),
        ("{", "not valid YAML"),
    ],
)
def test_mistakes(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text(text)
    with pytest.raises(BagError) as caught:
        load_qos_overrides(tmp_path / "qos.yaml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
