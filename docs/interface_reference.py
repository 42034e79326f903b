"""The pages of the reference on topics and services, and what all pages share."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from sensor_msgs.msg import JointState

from iptm_core.markdown import markdown_table
from iptm_core.state import Command
from iptm_interfaces.codecs import encode_command
from iptm_interfaces.qos import describe_qos
from iptm_interfaces.services import MEANINGS
from iptm_interfaces.topics import (
    HOST_FRAME,
    LEADER_FRAME,
    MAP_FRAME,
    PACK_FRAME,
    ROAD_FRAME,
    TOPICS,
    TopicSpec,
)
from iptm_interfaces.visual_topics import VISUAL_TOPICS

NOTICE = "<!-- Made by scripts/update_docs from the code; do not edit. -->\n\n"
EXAMPLE_NS = 12_500_000_000


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table that ends with a line break."""
    return markdown_table(heads, rows) + "\n"


def topics_page() -> str:
    """Every topic with type, QoS, unit and sign."""
    return (
        f"# Topics\n\n{NOTICE}Names are relative, so that a namespace moves the whole suite with its "
        "clock; only `/diagnostics` is global. Frames have it as prefix, `car_1/odom`, or `frame_prefix`. "
        "All types are standard ones.\n\n"
        + _topic_tables(TOPICS.values())
        + _named_values_text()
        + "\n## For 3-D viewers\n\nPublished by `scripts/visualize` only "
        "([how to](../how-to/special-runs.md#show-the-plan-in-rviz-or-foxglove)), which also publishes "
        "`robot_description` (`std_msgs/String`, latched) and, where `tf2_msgs` is installed, "
        f"`/tf` with {_chain(MAP_FRAME, ROAD_FRAME, HOST_FRAME)} and {_chain(ROAD_FRAME, LEADER_FRAME)}, "
        f"`/tf_static` with {_chain(HOST_FRAME, PACK_FRAME)}.\n\n"
        + _topic_tables(VISUAL_TOPICS.values())
    )


def _topic_tables(specs: Iterable[TopicSpec]) -> str:
    """One row per topic, and one table of the named fields of all, if there are any."""
    specs = list(specs)
    heads = ("topic", "type", "QoS", "unit", "frame", "meaning and sign", "rate", "publisher")
    rows = (
        (
            f"`{s.name}`",
            f"`{s.type_name.replace('/msg/', '/')}`",
            describe_qos(s.offered_qos),
            s.unit.replace("see fields", "[by field](#named-values)"),
            s.frame,
            s.meaning,
            s.rate,
            s.publisher,
        )
        for s in specs
    )
    fields = [(f"`{s.name}`", f"`{name}`", unit) for s in specs for name, unit in s.fields.items()]
    tables = [table(heads, rows), table(("topic", "field", "unit"), fields) if fields else ""]
    return "\n".join(filter(None, tables))


def _named_values_text() -> str:
    """The encoding of named values, with one message down to its bytes."""
    command = Command(acceleration_m_s2=0.5, compressor_power_w=1200.0)
    message = encode_command(EXAMPLE_NS, command)
    data = encode_command.data("", EXAMPLE_NS, command)
    stamp = message.header.stamp
    return (
        "\n## Named values\n\n"
        "Topics of type `sensor_msgs/JointState` carry a vector of named numbers, none of which belongs to a "
        "joint:\n\n"
        "- `header.stamp`: trip time of the tick; a command has the stamp of the state it answers. "
        "`header.frame_id` is not read.\n"
        "- `name[i]`: the field of the table above. `position[i]`: its value, whatever the quantity (a power "
        "in W, too), as a float64 in the unit of the table.\n"
        "- `velocity` and `effort`: empty, not read.\n\n"
        "Publishers send the fields in the order of the table. Readers match them by name: any order is "
        "accepted, unknown names are ignored, and a message that lacks a field, or has one that is not "
        "finite, is refused and reported on `/diagnostics`. In `controller/solve`, NaN stands for a figure "
        "that does not exist.\n\n"
        "In `controller/plan` and `v2x/leader_preview` (`trajectory_msgs/JointTrajectory`) the names are "
        "`joint_names`, and `points[k].positions` are in their order; the preview has the leader's speed in "
        "`points[k].velocities`.\n\n"
        "A `controller/command` at 12.5 s, 0.5 m/s² and 1200 W, in YAML:\n\n"
        f"```yaml\nheader: {{stamp: {{sec: {stamp.sec}, nanosec: {stamp.nanosec}}}, "
        f"frame_id: {message.header.frame_id}}}\nname: [{', '.join(message.name)}]\n"
        f"position: {list(message.position)}\nvelocity: []\neffort: []\n```\n\n"
        f"and in CDR, as in a bag and on the wire, {len(data)} bytes (little-endian; numbers are aligned to "
        "their size, counted from byte 4; padding may have any value):\n\n"
        + table(("bytes", "content", "hexadecimal"), layout_rows(message))
    )


def layout_rows(message: JointState) -> list[tuple[str, str, str]]:
    """Return the fields of a serialised message in order: offsets, content, bytes.

    Args:
        message: with named values only.
    """
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
        rows.append((f"{at} to {at + len(data) - 1}", content, f"`{data.hex(' ')}`"))
        at += len(data)
    return rows


def services_page() -> str:
    """Every service and what it does."""
    return (
        f"# Services\n\n{NOTICE}All are `std_srvs/srv/Trigger`, with private names: `~/pause` of the "
        "node `/car_1/plant` is `/car_1/plant/pause`. The table has the names of nodes that keep their "
        "default names; these are unchanged. The answer is a sentence on what was done, or why it was "
        "not. "
        "How to use them: [pause, step and reset](../how-to/README.md#pause-step-and-repeat-a-trip).\n\n"
        + table(
            ("service", "what it does"),
            ((f"`{service.value}`", meaning) for service, meaning in MEANINGS.items()),
        )
    )


def _chain(*frames: str) -> str:
    return "`" + " -> ".join(frames) + "`"
