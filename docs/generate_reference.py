"""Writes docs/reference/*.md and the parameter files of the nodes from the code.

Run it through ``scripts/update_docs``; a test fails when the committed pages are out of date.
"""

from __future__ import annotations

import argparse
import struct
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from library_reference import library_page
from sensor_msgs.msg import JointState

import iptm_bringup
from iptm_bringup.composition import parameter_file_text
from iptm_bringup.scenario import BRIDGE, CONTROLLER, PLANT
from iptm_controller.node_parameters import CHANGEABLE, ControllerNodeParameters
from iptm_controller.production import ProductionSettings
from iptm_controller.solvers.interface import STATUS_TEXT
from iptm_controller.strategy import DEFAULT_STRATEGY, STRATEGIES
from iptm_core.declaration import parameter_specs, plain
from iptm_core.markdown import markdown_table
from iptm_core.metrics import FIGURES
from iptm_core.parameters import available_parameter_sets, describe_parameters, load_parameters
from iptm_core.state import Command
from iptm_faults.fault import Fault
from iptm_faults.kinds import KINDS
from iptm_interfaces.codecs import encode_command
from iptm_interfaces.services import MEANINGS
from iptm_interfaces.topics import (
    HOST_FRAME,
    LEADER_FRAME,
    MAP_FRAME,
    PACK_FRAME,
    ROAD_FRAME,
    TOPICS,
    TopicSpec,
    describe_qos,
)
from iptm_interfaces.visual_topics import PUBLISHER, VISUAL_TOPICS
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters, SenderNodeParameters
from iptm_view.visualizer_parameters import VisualizerParameters

DOCS = Path(__file__).resolve().parent
CONFIG = Path(iptm_bringup.__file__).parent / "config" / "nodes"
COST_TO_GO = "../explanation/optimal-control.md#the-cost-to-go-what-a-kelvin-is-worth"
EXAMPLE_NS = 12_500_000_000
PRODUCTION = """\
adaptive cruise control and a thermostat with hysteresis. The acceleration is k1 (gap - standstill gap - T
v) + k2 (lead vehicle's speed - v), the lower one of the gains for following and those for closing a large
gap, and at most 0.4/s times the difference to the largest speed; limits of acceleration and jerk are those
of the car. Gains: V. Milanés, S. E. Shladover, Transportation Research Part C 48 (2014) 285-300, and L.
Xiao, M. Wang, B. van Arem, Transportation Research Record 2623 (2017) 1-9, also the defaults of the model
ACC in SUMO; the time gap T lies in the range of ISO 15622:2018. Where the lead vehicle brakes harder than
the limits of comfort allow, the collision guard and the safety monitor brake, as emergency braking does in
cars. Makers publish no thresholds of their thermostats: those below are chosen, in the middle of the
paper's limits of 25 and 40 degC."""
NOTICE = "<!-- Made by scripts/update_docs from the code; do not edit. -->\n\n"


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
    tables = [_table(heads, rows), _table(("topic", "field", "unit"), fields) if fields else ""]
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
        + _table(("bytes", "content", "hexadecimal"), layout_rows(message))
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


def _table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    return markdown_table(heads, rows) + "\n"


def services_page() -> str:
    """Every service and what it does."""
    return (
        f"# Services\n\n{NOTICE}All are `std_srvs/srv/Trigger`, with private names: `~/pause` of the "
        "node `/car_1/plant` is `/car_1/plant/pause`. The table has the names of nodes that keep their "
        "default names; these are unchanged. The answer says in a sentence what was done, or why it was "
        "not. "
        "How to use them: [pause, step and reset](../how-to/README.md#pause-step-and-repeat-a-trip).\n\n"
        + _table(
            ("service", "what it does"),
            ((f"`{service.value}`", meaning) for service, meaning in MEANINGS.items()),
        )
    )


def _chain(*frames: str) -> str:
    return "`" + " -> ".join(frames) + "`"


def parameters_page() -> str:
    """Every model parameter of every shipped set with its unit, range and source."""
    parts = [f"# Model parameters\n\n{NOTICE}"]
    for name in available_parameter_sets():
        parts.append(f"## `{name}`\n\n")
        rows = (
            (
                f"`{row.key}`",
                row.symbol,
                f"{row.value:.10g}",
                row.unit,
                f"{row.minimum:g} to {row.maximum:g}",
                f"{row.source}: {row.note}" if row.note else row.source,
            )
            for row in describe_parameters(load_parameters(name))
        )
        parts += [_table(("key", "symbol", "value", "unit", "range", "source"), rows), "\n"]
    return "".join(parts)


NODES = {
    PLANT: (
        PlantNodeParameters,
        "Simulated vehicle, battery and cooling; the master of time.",
    ),
    BRIDGE: (
        BridgeNodeParameters,
        "The leader and the prediction of its motion, with everything that goes wrong on the radio link.",
    ),
    CONTROLLER: (
        ControllerNodeParameters,
        "Multi-horizon model predictive control of acceleration and compressor power.",
    ),
}


CHANGEABLE_NOTE = (
    f"May be [set while driving](../how-to/README.md#change-strategy-weights-or-horizon-while-driving): "
    f"{', '.join(f'`{name}`' for name in CHANGEABLE)}.\n\n"
)


def nodes_page() -> str:
    """Parameters of the three nodes, of the sender of messages and of the visualizer."""
    parts = [f"# Node parameters\n\n{NOTICE}"]
    others = {"v2x_sender": (SenderNodeParameters, ""), PUBLISHER: (VisualizerParameters, "")}
    for node, (parameters, _) in (NODES | others).items():
        note = CHANGEABLE_NOTE if node == CONTROLLER else ""
        rows = (
            (
                f"`{spec.name}`",
                f"`{plain(spec.default)}`",
                spec.unit or "-",
                spec.allowed,
                spec.description,
            )
            for spec in parameter_specs(parameters)
        )
        table = _table(("parameter", "default", "unit", "allowed", "meaning"), rows)
        parts.append(f"## `{node}`\n\n{note}{table}\n")
    return "".join(parts)


def node_file(node: str) -> str:
    """The parameter file of a node: every default, with its meaning."""
    parameters, about = NODES[node]
    specs = parameter_specs(parameters)
    header = (
        f"# {about}\n# Made by scripts/update_docs from the code. These are the defaults; "
        "`ros2 param describe` and `--help`\n# of the node show the permitted ranges.\n"
    )
    return header + parameter_file_text(
        node,
        {spec.name: plain(spec.default) for spec in specs},
        {spec.name: spec.description + (f" [{spec.unit}]" if spec.unit else "") for spec in specs},
    )


def strategies_page() -> str:
    """The strategies and the solver outcomes."""
    heads = (
        "strategy",
        "Q of J1, 1/(m/s)^2",
        "R of J2, 1/K^2",
        "lambda_P of J3, 1/J",
        "lambda_Q of J4",
        "cost to go",
    )
    rows = (
        (
            f"`{s.name}`",
            f"{s.speed_weight:g}",
            f"{s.temperature_weight:g}",
            f"{s.energy_weight_1_j:g}",
            f"{s.aging_weight:g}",
            "yes" if s.cost_to_go else "no",
        )
        for s in STRATEGIES.values()
        if not s.is_rule_based
    )
    laws = (
        (f"`{spec.name}`", str(spec.default), spec.unit or "1", spec.description)
        for spec in parameter_specs(ProductionSettings)
    )
    outcomes = ((status.value, status.name, text) for status, text in STATUS_TEXT.items())
    return (
        f"# Strategies and outcomes\n\n{NOTICE}Weights of the cost terms; zero leaves a term out. The "
        f"default is `{DEFAULT_STRATEGY}`. Its [cost to go]({COST_TO_GO}) "
        "prices the cell temperatures at the end of the horizon and has no weight.\n\n"
        + _table(heads, rows)
        + "\n## What cars have today\n\n`production` optimises nothing and uses no preview, to compare with: "
        f"{PRODUCTION}\n\n"
        + _table(("parameter", "value", "unit", "meaning"), laws)
        + "\n## Outcomes of a solve\n\n"
        + _table(("code", "status", "meaning"), outcomes)
    )


def figures_page() -> str:
    """Every figure of a run that tables, pictures, files and the report show."""
    rows = (
        (f"`{key}`", figure.label, figure.symbol or "-", figure.unit or "1")
        for key, figure in FIGURES.items()
    )
    return (
        f"# Figures of a run\n\n{NOTICE}The same figures stand on the terminal, in `results.json`, in "
        "`scripts/bag_info`, in the CSV files of the studies and in the report.\n\n"
        + _table(("key", "figure", "symbol", "unit"), rows)
    )


def faults_page() -> str:
    """Every kind of fault, and the keys of one."""
    allowed = {"kind": "one of those below", "size": "see the kind"}
    defaults = {"size": "that of the kind", "target": "see the kind"}
    keys = (
        (
            f"`{spec.name}`",
            defaults.get(spec.name) or f"`{plain(spec.default)}`",
            spec.unit or "-",
            allowed.get(spec.name, spec.allowed).replace("one of , ", "one of "),
            spec.description,
        )
        for spec in parameter_specs(Fault)
    )
    kinds = []
    for kind, spec in KINDS.items():
        size = bounds = "-"
        if spec.has_size:
            size = f"{spec.size:g} {spec.unit}"
            bounds = f"{spec.smallest:g} to {spec.largest:g}"
        where = "yes" if spec.headless else "no"
        kinds.append((f"`{kind}`", spec.place.value, spec.meaning, size, bounds, where))
    return (
        f"# Faults\n\n{NOTICE}Keys of one fault in the list `faults` of a scenario; how to use it: "
        "[inject faults](../how-to/README.md#inject-faults).\n\n"
        + _table(("key", "default", "unit", "allowed", "meaning"), keys)
        + "\n## Kinds\n\nIn `traffic` the leader that counts behaves otherwise, in `vehicle` the ego "
        "vehicle; all others change only what the nodes receive, or the nodes themselves.\n\n"
        + _table(("kind", "where", "what it does", "size", "allowed", "without ROS"), kinds)
    )


PAGES = {
    DOCS / "reference" / "faults.md": faults_page,
    DOCS / "reference" / "figures.md": figures_page,
    DOCS / "reference" / "library.md": partial(library_page, NOTICE),
    DOCS / "reference" / "services.md": services_page,
    DOCS / "reference" / "topics.md": topics_page,
    DOCS / "reference" / "parameters.md": parameters_page,
    DOCS / "reference" / "nodes.md": nodes_page,
    DOCS / "reference" / "strategies.md": strategies_page,
    **{CONFIG / f"{node}.yaml": partial(node_file, node) for node in NODES},
}


def main() -> int:
    """Write the pages, or with ``--check`` compare them with what is committed."""
    parser = argparse.ArgumentParser(description="Write docs/reference from the code.")
    parser.add_argument("--check", action="store_true", help="write nothing, fail when out of date")
    check = parser.parse_args().check
    stale = []
    for path, page in PAGES.items():
        text = page()
        if check:
            if not path.exists() or path.read_text(encoding="utf-8") != text:
                stale.append(path.name)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
    if stale:
        print(f"out of date: {', '.join(stale)}; run scripts/update_docs", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
