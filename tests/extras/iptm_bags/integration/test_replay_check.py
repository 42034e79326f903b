"""A fresh node gets what a bag recorded: it answers as it did, unless something has changed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import Float64

from iptm_bags.replay_check import check_node
from iptm_bags.replay_inputs import OUTPUTS, read_recorded
from iptm_core.decision_record import DrivingMode
from iptm_core.errors import BagError, ScenarioError
from iptm_ros.codecs.cdr import serialized
from iptm_ros.codecs.numbers import LAYOUTS
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.topics import TOPICS, Topic

BAG = Path(__file__).resolve().parents[4] / "bags" / "example_us06_120s"
CHANGES = {"controller": "body.mass_kg=1700", "plant": "aging.pre_exponential_factor=0.0033"}


@pytest.fixture(autouse=True)
def own_domain(ros_environment: dict[str, str]) -> None:
    """Nothing here talks outside a domain of its own."""


@pytest.mark.parametrize("node", OUTPUTS)
def test_the_example_bag_is_answered_as_recorded(node: str) -> None:
    comparison = check_node(BAG, node)
    names = {f"/{TOPICS[topic].name.lstrip('/')}" for topic in OUTPUTS[node]}
    assert {outcome.topic.split(" ")[0] for outcome in comparison} == names
    for outcome in comparison:
        assert outcome.agrees, outcome.divergence_text() or outcome
        assert outcome.counts[0] == outcome.counts[1] >= 1
    assert max(outcome.counts[0] for outcome in comparison) == 121


@pytest.mark.parametrize("node", CHANGES)
def test_a_changed_physical_constant_is_found(launcher: Any, node: str) -> None:
    change = f"overrides={CHANGES[node]}"
    process = launcher.start_module("iptm", "check", node, BAG, "--set", change)
    assert process.wait(240.0) == 1, process.stderr
    assert "first differs at " in process.stdout
    assert f"{node} does not answer as recorded" in process.stdout


def test_what_cannot_be_checked_is_refused(tmp_path: Path) -> None:
    with BagReader(BAG) as reader:
        data = reader.custom_data
        topics, messages = reader.topics, list(reader.raw_messages())

    def changed(name: str, before: str, after: str) -> Path:
        custom = {**data, "parameters": data["parameters"].replace(before, after)}
        with BagWriter(tmp_path / name, custom_data=custom) as writer:
            keys = {
                topic: writer.add_topic(topic, record.type_name) for topic, record in topics.items()
            }
            for message in messages:
                writer.write(keys[message.topic], message.data, message.log_time_ns)
        return tmp_path / name

    with pytest.raises(BagError, match=r"mode of .* is real_time; allowed: lock_step"):
        read_recorded(changed("wall", "mode: lock_step", "mode: real_time"), "plant")
    with pytest.raises(BagError, match="parameters of v2x_bridge"):
        read_recorded(changed("mute", "v2x_bridge:", "other:"), "v2x_bridge")
    with pytest.raises(ScenarioError, match="horizon"):
        check_node(BAG, "controller", changes={"horizon": "0x1"})


@pytest.mark.parametrize(
    ("topic", "data", "nodes"),
    [
        # Recorded answers do not allow for an icy road. Who drives shows where a car does not do as asked.
        (Topic.ROAD_FRICTION, serialized(Float64(data=0.1)), ("controller",)),
        (
            Topic.ENGAGEMENT,
            LAYOUTS[Topic.ENGAGEMENT].data(1, [DrivingMode.READY.number, *[0.0] * 6], ""),
            ("controller",),
        ),
    ],
)
def test_what_has_no_stamp_of_a_tick_is_fed_from_when_it_was_heard(
    tmp_path: Path, topic: Topic, data: bytes, nodes: Sequence[str]
) -> None:
    heard_ns, spec = 60 * 10**9, TOPICS[topic]
    with (
        BagReader(BAG) as reader,
        BagWriter(tmp_path / "bag", custom_data=reader.custom_data) as writer,
    ):
        keys = {name: writer.add_topic(name, of.type_name) for name, of in reader.topics.items()}
        added = writer.add_topic(f"/{spec.name}", spec.type_name)
        is_written = False
        for message in reader.raw_messages():
            if message.log_time_ns >= heard_ns and not is_written:
                is_written = True
                writer.write(added, data, message.log_time_ns)
            writer.write(keys[message.topic], message.data, message.log_time_ns)
    for node in nodes:
        steps = read_recorded(tmp_path / "bag", node).steps
        sent = {stamp: inputs.get(topic) for stamp, inputs in steps.items()}
        assert sent == {stamp: data if stamp >= heard_ns else None for stamp in steps}
    answers = check_node(tmp_path / "bag", "controller")
    # Either "at 60 s" or, of messages without a stamp, "message 61".
    places = [each.first_place.split()[:2] for each in answers if not each.agrees]
    assert bool(places) is (topic is Topic.ROAD_FRICTION)
    assert all(int(number) >= 60 for _, number in places)
