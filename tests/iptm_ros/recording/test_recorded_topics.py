"""Which topics are recorded, with which QoS."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    ReliabilityPolicy,
)
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosReliability, QosTime

from iptm_core.errors import BagError
from iptm_ros.recording.rclpy_types import message_class, to_profile
from iptm_ros.recording.recorded_topics import (
    DEFAULT_QOS,
    TopicRecord,
    TopicSelection,
    dump_profiles,
    load_qos_overrides,
    offer_for,
    overridden,
    parse_profiles,
    request_for,
)

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
    profile = to_profile(overridden(DEFAULT_QOS, "/chatter", overrides))
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
    assert overridden(DEFAULT_QOS, "/other", overrides) == other
    assert overridden(DEFAULT_QOS, "/third", overrides) == DEFAULT_QOS


def test_an_unlimited_time_as_bags_have_it(tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text("/a: {deadline: {sec: 9223372036, nsec: 854775807}}")
    overrides = load_qos_overrides(tmp_path / "qos.yaml")
    assert overridden(DEFAULT_QOS, "/a", overrides) == DEFAULT_QOS


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


BEST_EFFORT = DEFAULT_QOS._replace(reliability=QosReliability.BEST_EFFORT)
LATCHED = DEFAULT_QOS._replace(durability=QosDurability.TRANSIENT_LOCAL, depth=1)
NAMES = ["/plant/odometry", "/plant/powers", "/car_1/plant/powers", "/clock"]


@pytest.mark.parametrize(
    ("include", "exclude", "expected"),
    [
        ((), (), NAMES),
        (("/plant/*",), (), NAMES[:2]),
        (("plant/powers",), (), NAMES[1:3]),
        (("plant/*",), ("/plant/odometry",), NAMES[1:3]),
        ((), ("*",), []),
        (("clock",), (), ["/clock"]),
        (("/Plant/*",), (), []),
    ],
)
def test_patterns(include: tuple[str, ...], exclude: tuple[str, ...], expected: list[str]) -> None:
    selection = TopicSelection(include, exclude)
    assert [name for name in NAMES if selection.takes(name)] == expected


def test_typing_errors_are_found() -> None:
    assert TopicSelection(("/clok", "/clock"), ("plant/p*",)).unused(NAMES) == ["/clok"]


def test_profiles_survive_the_text_of_a_channel() -> None:
    profiles = (DEFAULT_QOS, LATCHED, BEST_EFFORT._replace(deadline=QosTime(1, 500_000_000)))
    assert parse_profiles(dump_profiles(profiles)) == profiles
    (entry, *_) = yaml.safe_load(dump_profiles(profiles))
    assert (entry["history"], entry["durability"]) == ("keep_last", "volatile")
    assert entry["lifespan"] == {"sec": 9223372036, "nsec": 854775807}


def test_numbers_of_older_bags_are_understood() -> None:
    (entry,) = yaml.safe_load(dump_profiles([DEFAULT_QOS]))
    entry.update(history=3, reliability=2, durability=1)
    (qos,) = parse_profiles(yaml.safe_dump([entry]))
    assert qos.history is QosHistory.UNKNOWN
    assert qos.reliability is QosReliability.BEST_EFFORT
    assert qos.durability is QosDurability.TRANSIENT_LOCAL


@pytest.mark.parametrize("text", ["", "[]"])
def test_no_profiles(text: str) -> None:
    assert parse_profiles(text) == ()


@pytest.mark.parametrize("text", ["{", "text", "- history: keep_last", "- 3", "3"])
def test_malformed_profiles(text: str) -> None:
    with pytest.raises(BagError, match="offered_qos_profiles"):
        parse_profiles(text)


def test_request_is_satisfied_by_every_publisher() -> None:
    assert request_for([], 5) == DEFAULT_QOS._replace(depth=5)
    mixed = request_for([DEFAULT_QOS, BEST_EFFORT], 5)
    assert mixed.reliability is QosReliability.BEST_EFFORT
    assert request_for([LATCHED], 5).durability is QosDurability.TRANSIENT_LOCAL
    assert request_for([LATCHED, DEFAULT_QOS], 5).durability is QosDurability.VOLATILE


@pytest.mark.parametrize(
    ("recorded", "offer"),
    [
        ((), DEFAULT_QOS),
        ((DEFAULT_QOS, BEST_EFFORT), DEFAULT_QOS),
        ((BEST_EFFORT,), BEST_EFFORT),
        ((LATCHED,), LATCHED),
        ((DEFAULT_QOS._replace(history=QosHistory.UNKNOWN, depth=0),), DEFAULT_QOS),
    ],
)
def test_offer_satisfies_every_former_subscriber(recorded: tuple[Qos, ...], offer: Qos) -> None:
    assert offer_for(TopicRecord("/a", "std_msgs/msg/Float64", "", recorded, 1)) == offer


@pytest.mark.parametrize("name", ["Odometry", "nav_msgs/srv/GetMap", "no_msgs/msg/X", "a/msg/b/c"])
def test_class_of_an_unknown_type(name: str) -> None:
    with pytest.raises(BagError, match="message type"):
        message_class(name)


def test_the_type_of_a_bag_is_not_imported_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of somebody else holds a bag, and a package with the name of its type."""
    package = tmp_path / "evil" / "msg"
    package.mkdir(parents=True)
    ran = tmp_path / "ran"
    for folder in (package.parent, package):
        text = f"open({str(ran)!r}, 'w')\nclass X: pass\n"
        (folder / "__init__.py").write_text(text, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BagError, match="evil/msg/X: no installed package"):
        message_class("evil/msg/X")
    assert not ran.exists()
