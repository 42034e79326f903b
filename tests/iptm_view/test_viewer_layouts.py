"""The layouts for other viewers name only what is there, and all of it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml

import iptm_view
from iptm_interfaces.topics import TOPICS, TopicSpec, topic_of
from iptm_interfaces.visual_topics import VISUAL_TOPICS
from iptm_view.viewer_layouts import LAYOUTS, foxglove_layout, plotjuggler_layout, rviz_config

FOLDER = Path(iptm_view.__file__).parent / "layouts"
NUMBERS = {"float", "double"}


def spec_of(name: str, namespace: str) -> TopicSpec | None:
    return next((spec for spec in TOPICS.values() if topic_of(namespace, spec.topic) == name), None)


def assert_is_number(topic: str, field: str, index: int | None, namespace: str = "/") -> None:
    """Check a field path against the message class of the topic itself, not against the maker's table."""
    spec = spec_of(topic, namespace)
    assert spec is not None, f"no topic {topic}"
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


@pytest.mark.parametrize("namespace", ["/", "/car_1"])
def test_foxglove(namespace: str) -> None:
    layout = json.loads(foxglove_layout(namespace))
    assert sorted(panels_of(layout["layout"])) == sorted(layout["configById"])
    named = set()
    for key, panel in layout["configById"].items():
        # Lichtblick reads another key for the title than Foxglove.
        assert panel["foxglovePanelTitle"] == panel["lichtblickPanelTitle"] != ""
        for path in panel.get("paths", []):
            match = re.fullmatch(r"(/[\w/]+)\.([\w.]+?)(?:\[(\d+)\])?", path["value"])
            assert match is not None, path["value"]
            topic, field, index = match.groups()
            assert_is_number(topic, field, None if index is None else int(index), namespace)
            spec = spec_of(topic, namespace)
            if index is not None and spec is not None:
                assert path["label"] == list(spec.fields)[int(index)]
            named.add(topic)
        for name in ("topicPath", "topicToRender"):
            if name in panel:
                named.add(panel[name])
        assert key.split("!")[0] in {"Plot", "RawMessages", "DiagnosticSummary", "3D"}
    scene = layout["configById"]["3D!scene"]
    prefix = namespace.rstrip("/")
    assert set(scene["topics"]) == {f"{prefix}/{spec.name}" for spec in VISUAL_TOPICS.values()}
    unnamed = {spec.topic for spec in TOPICS.values()} - {
        spec_of(topic, namespace).topic for topic in named
    }
    assert {topic.name for topic in unnamed} == {"CLOCK", "SLOPE", "DATAGRAMS"}


def test_plotjuggler() -> None:
    root = ET.fromstring(plotjuggler_layout())  # noqa: S314 - made a line before
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) == len(set(curves)) > 20
    for name in curves:
        spec = next(
            spec for spec in TOPICS.values() if name.startswith(f"/{spec.name.lstrip('/')}/")
        )
        rest = name.removeprefix(f"/{spec.name}/").split("/")
        if spec.fields:
            value, field = rest
            assert_is_number(f"/{spec.name}", field, list(spec.fields).index(value))
        else:
            assert_is_number(f"/{spec.name}", ".".join(rest), None)
    for splitter in root.iter("DockSplitter"):
        children = len(list(splitter))
        assert int(splitter.attrib["count"]) == len(splitter.attrib["sizes"].split(";")) == children


def test_rviz() -> None:
    manager = yaml.safe_load(rviz_config("/car_1"))["Visualization Manager"]
    displays = {entry["Topic"]["Value"]: entry for entry in manager["Displays"] if "Topic" in entry}
    by_name = {f"/car_1/{spec.name}": spec for spec in VISUAL_TOPICS.values()}
    assert set(displays) == set(by_name)
    for name, entry in displays.items():
        assert entry["Class"].split("/")[1] == by_name[name].type_name.split("/")[-1]
        is_latched = entry["Topic"]["Durability Policy"] == "Transient Local"
        assert is_latched == by_name[name].latched
        # Without transforms, only what is given in the fixed frame can be shown.
        assert manager["Global Options"]["Fixed Frame"] == by_name[name].frame
    (frames,) = (entry["Frames"] for entry in manager["Displays"] if "Frames" in entry)
    assert frames.pop("All Enabled") is False
    assert set(frames) == {
        f"car_1/{name}" for name in ("odom", "base_link", "leader", "battery_pack")
    }
    assert manager["Views"]["Current"]["Target Frame"] == "car_1/base_link"


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_committed_files_are_those_of_the_table(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == LAYOUTS[name]()
