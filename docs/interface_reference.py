"""The pages of the reference on topics and services."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from sensor_msgs.msg import JointState

from iptm_core.markdown import render_page
from iptm_core.state import Command
from iptm_ros import topics
from iptm_ros.codecs import encode_command
from iptm_ros.publishers import describe_qos
from iptm_ros.services import MEANINGS
from iptm_ros.topics import TOPICS, TopicSpec

TEMPLATES = Path(__file__).resolve().parent / "templates"
EXAMPLE_NS = 12_500_000_000


def topics_page() -> str:
    """Every topic with type, QoS, unit and sign, and one message down to its bytes."""
    command = Command(acceleration_m_s2=0.5, compressor_power_w=1200.0)
    message = encode_command(EXAMPLE_NS, command)
    return render_page(
        TEMPLATES,
        "topics.md.j2",
        rows=_topics(TOPICS.values()),
        fields=[
            {"topic": spec.name, "field": field, "unit": unit}
            for spec in TOPICS.values()
            for field, unit in spec.fields.items()
        ],
        message=message,
        positions=list(message.position),
        bytes=len(encode_command.data("", EXAMPLE_NS, command)),
        layout=layout_rows(message),
        frames=topics,
        visual=_topics(visual_topics()),
    )


def visual_topics() -> Iterable[TopicSpec]:
    """Return the topics of the visualizer, where its extra is installed."""
    if find_spec("iptm_view") is None:
        return ()
    found: dict[str, TopicSpec] = import_module("iptm_view.visual_topics").VISUAL_TOPICS
    return found.values()


def _topics(specs: Iterable[TopicSpec]) -> list[dict[str, object]]:
    return [
        {
            "spec": spec,
            "type": spec.type_name.replace("/msg/", "/"),
            "qos": describe_qos(spec.offered_qos),
            "unit": spec.unit.replace("see fields", "[by field](#named-values)"),
        }
        for spec in specs
    ]


def layout_rows(message: JointState) -> list[dict[str, str]]:
    """Return the fields of a serialised message of named values in order: offsets, content, bytes."""
    parts: list[tuple[str, bytes]] = [("CDR, little-endian", bytes((0, 1, 0, 0)))]

    def add(content: str, form: str, *values: object) -> None:
        size = struct.calcsize(form[-1])
        at = sum(len(part) for _, part in parts) - 4
        if at % size:
            parts.append(("padding", bytes(-at % size)))
        parts.append((content, struct.pack("<" + form, *values)))

    def add_text(what: str, text: str) -> None:
        data = text.encode() + b"\0"
        add(f"length of {what}", "I", len(data))
        parts.append((f"{what}: `{text}` and a zero byte", data))

    stamp = message.header.stamp
    add("`header.stamp.sec`", "i", stamp.sec)
    add("`header.stamp.nanosec`", "I", stamp.nanosec)
    add_text("`header.frame_id`", message.header.frame_id)
    add("number of names", "I", len(message.name))
    for index, name in enumerate(message.name):
        add_text(f"`name[{index}]`", name)
    add("number of positions", "I", len(message.position))
    for index, value in enumerate(message.position):
        add(f"`position[{index}]` = {value:g}", "d", value)
    add("number of velocities", "I", 0)
    add("number of efforts", "I", 0)
    rows, at = [], 0
    for content, data in parts:
        bounds = f"{at} to {at + len(data) - 1}"
        rows.append({"bytes": bounds, "content": content, "hexadecimal": f"`{data.hex(' ')}`"})
        at += len(data)
    return rows


def services_page() -> str:
    """Every service and what it does."""
    services = [{"service": service, "meaning": meaning} for service, meaning in MEANINGS.items()]
    return render_page(TEMPLATES, "services.md.j2", services=services)
