"""The layouts for other viewers name existing topics and fields, and none is missing."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import yaml
from sensor_msgs.msg import JointState

import iptm_view
from iptm_ros.topics import TOPICS, Topic, TopicSpec
from iptm_view.visual_topics import VISUAL_TOPICS

FOLDER = Path(iptm_view.__file__).parent / "layouts"
NUMBERS = {"float", "double"}


SPECS = {f"/{spec.name.lstrip('/')}": spec for spec in TOPICS.values()}
NAMED_VALUES = {
    (name, field)
    for name, spec in SPECS.items()
    if spec.message_type is JointState and spec.unit == "see fields"
    if spec.topic is not Topic.ENGAGEMENT  # only a car has it
    for field in spec.fields
    if not re.match(r"(position|speed|acceleration|.*_temperature)_", field)
    or name != "/plant/state"
}
"""Values of the topics that publish several numbers under names, by topic and name; of the plant's state
those that have no topic of their own."""


def assert_is_number(topic: str, field: str, index: int | None) -> None:
    """Check a field path against the message class of the topic."""
    spec: TopicSpec = SPECS[topic]
    message: Any = spec.message_type()
    *parents, last = field.split(".")
    for parent in parents:
        message = getattr(message, parent)
    kind = message.get_fields_and_field_types()[last]
    if index is None:
        assert kind in NUMBERS, (topic, field, kind)
    else:
        assert kind == "sequence<double>", (topic, field, kind)
        assert index < len(spec.fields), (topic, field, index)


def panels_of(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        assert 0 < tree["splitPercentage"] < 100
        for half in ("first", "second"):
            yield from panels_of(tree[half])


def test_foxglove() -> None:
    layout = json.loads((FOLDER / "foxglove.json").read_text(encoding="utf-8"))
    assert sorted(panels_of(layout["layout"])) == sorted(layout["configById"])
    named, values = set(), set()
    for key, panel in layout["configById"].items():
        # Lichtblick reads another key for the title than Foxglove.
        assert panel["foxglovePanelTitle"] == panel["lichtblickPanelTitle"] != ""
        for path in panel.get("paths", []):
            match = re.fullmatch(r"(/[\w/]+)\.([\w.]+?)(?:\[(\d+)\])?", path["value"])
            assert match is not None, path["value"]
            topic, field, index = match.groups()
            assert_is_number(topic, field, None if index is None else int(index))
            if index is not None:
                assert path["label"] == list(SPECS[topic].fields)[int(index)]
                values.add((topic, path["label"]))
            named.add(topic)
        named |= {panel[name] for name in ("topicPath", "topicToRender") if name in panel}
        assert key.split("!")[0] in {"Plot", "RawMessages", "DiagnosticSummary", "3D"}
    scene = layout["configById"]["3D!scene"]
    assert set(scene["topics"]) == {f"/{spec.name}" for spec in VISUAL_TOPICS.values()}
    assert values == NAMED_VALUES
    assert SPECS.keys() - named == {
        "/clock",
        "/v2x/slope",
        "/v2x/datagrams",
        "/v2x/leader_samples",
        "/v2x/road_ahead",
        "/sensor/tracks",
        "/sensor/road_friction",
        "/vehicle/arrival_cost",
        "/vehicle/engagement",
    }


def test_plotjuggler() -> None:
    root = ET.parse(FOLDER / "plotjuggler.xml").getroot()  # noqa: S314 - committed
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) == len(set(curves)) > 20
    values = set()
    for name in curves:
        topic = next(topic for topic in SPECS if name.startswith(f"{topic}/"))
        rest = name.removeprefix(f"{topic}/").split("/")
        if SPECS[topic].fields:
            value, field = rest
            assert_is_number(topic, field, list(SPECS[topic].fields).index(value))
            values.add((topic, value))
        else:
            assert_is_number(topic, ".".join(rest), None)
    assert values == NAMED_VALUES
    for splitter in root.iter("DockSplitter"):
        children = len(list(splitter))
        assert int(splitter.attrib["count"]) == len(splitter.attrib["sizes"].split(";")) == children


def test_rviz() -> None:
    manager = yaml.safe_load((FOLDER / "rviz.rviz").read_text(encoding="utf-8"))
    manager = manager["Visualization Manager"]
    displays = {entry["Topic"]["Value"]: entry for entry in manager["Displays"] if "Topic" in entry}
    by_name = {f"/{spec.name}": spec for spec in VISUAL_TOPICS.values()}
    assert set(displays) == set(by_name)
    for name, entry in displays.items():
        assert entry["Class"].split("/")[1] == by_name[name].type_name.split("/")[-1]
        is_latched = entry["Topic"]["Durability Policy"] == "Transient Local"
        assert is_latched == by_name[name].latched
        # Without transforms, only what is given in the fixed frame can be shown.
        assert manager["Global Options"]["Fixed Frame"] == by_name[name].frame
    (frames,) = (entry["Frames"] for entry in manager["Displays"] if "Frames" in entry)
    assert frames.pop("All Enabled") is False
    assert set(frames) == {"odom", "base_link", "leader", "battery_pack"}
    assert manager["Views"]["Current"]["Target Frame"] == "base_link"
