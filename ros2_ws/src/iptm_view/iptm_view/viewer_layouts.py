"""Layouts for other viewers, made from the topic table: Foxglove and Lichtblick, PlotJuggler, RViz.

`scripts/update_docs` writes them into the folder `layouts`. Every number that the suite publishes as a curve
is in them, by topic and field, so a new topic or field shows up without anyone drawing it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any
from xml.etree import ElementTree as ET

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import BatteryState, JointState, Temperature
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory

from iptm_interfaces.topics import (
    HOST_FRAME,
    LEADER_FRAME,
    MAP_FRAME,
    PACK_FRAME,
    ROAD_FRAME,
    TOPICS,
    frame_in,
)
from iptm_interfaces.visual_topics import DESCRIPTION_TOPIC, VISUAL_TOPICS

_COLORS = ("#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9", "#737b84")
_RVIZ_COLORS = ("115; 123; 132", "0; 114; 178", "213; 94; 0")
_WINDOW_S = 120
_COLUMNS = 3

# Which fields of a message are curves, with the title of their plot and the unit.
_CURVES: dict[type[Any], tuple[tuple[str, str, str], ...]] = {
    Odometry: (
        ("twist.twist.linear.x", "Speed", "m/s"),
        ("pose.pose.position.x", "Distance along the road", "m"),
    ),
    AccelStamped: (("accel.linear.x", "Acceleration", "m/s^2"),),
    Temperature: (("temperature", "Temperatures", "degC"),),
    BatteryState: (("voltage", "Pack voltage", "V"), ("current", "Pack current", "A")),
}


@dataclass(frozen=True)
class Curve:
    """One number of a topic over time.

    Attributes:
        topic: full name.
        field: dotted path of the field in the message.
        name: for the legend.
        index: place in the field where that is an array, None where it is a number.
    """

    topic: str
    field: str
    name: str
    index: int | None = None


@dataclass(frozen=True)
class Plot:
    """Curves of one unit over a common time axis."""

    title: str
    curves: tuple[Curve, ...]


def plots(namespace: str = "/") -> tuple[Plot, ...]:
    """Return the plots of a vehicle.

    Args:
        namespace: of the vehicle.
    """
    found: dict[str, list[Curve]] = {}
    for spec in TOPICS.values():
        topic = _full_name(spec.name, namespace)
        for field, title, unit in _CURVES.get(spec.message_type, ()):
            found.setdefault(f"{title} ({unit})", []).append(Curve(topic, field, topic))
        if spec.message_type is Float64:
            title = "Acceleration" if spec.unit == "m/s^2" else "Commanded power"
            found.setdefault(f"{title} ({spec.unit})", []).append(Curve(topic, "data", topic))
        if spec.message_type is JointState:
            for index, (name, unit) in enumerate(spec.fields.items()):
                curve = Curve(topic, "position", name, index)
                found.setdefault(f"{spec.name} ({unit})", []).append(curve)
    return tuple(Plot(title, tuple(curves)) for title, curves in found.items())


def foxglove_layout(namespace: str = "/") -> str:
    """Return a layout for Foxglove and Lichtblick, in the form that both load.

    Args:
        namespace: of the vehicle.
    """
    panels: dict[str, dict[str, Any]] = {}
    for plot in plots(namespace):
        paths = [
            {
                "value": f"{curve.topic}.{curve.field}"
                + ("" if curve.index is None else f"[{curve.index}]"),
                "label": curve.name,
                "color": color,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for curve, color in zip(plot.curves, cycle(_COLORS), strict=False)
        ]
        panels[f"Plot!{_slug(plot.title)}"] = {
            **_titled(plot.title),
            "paths": paths,
            "xAxisVal": "timestamp",
            "followingViewWidth": _WINDOW_S,
            "showLegend": True,
            "legendDisplay": "top",
        }
    for spec in TOPICS.values():
        topic = _full_name(spec.name, namespace)
        if spec.message_type is JointTrajectory:
            panels[f"RawMessages!{_slug(topic)}"] = {**_titled(topic), "topicPath": topic}
        if spec.message_type is DiagnosticArray:
            panels["DiagnosticSummary!nodes"] = {
                **_titled("Diagnostics"),
                "topicToRender": topic,
                "minLevel": 0,
            }
    panels["3D!scene"] = {
        **_titled("Road, plan and both cars"),
        "followMode": "follow-pose",
        "followTf": frame_in(namespace, HOST_FRAME),
        "cameraState": {"distance": 60, "perspective": True, "phi": 60, "thetaOffset": 90},
        "topics": {
            _full_name(spec.name, namespace): {"visible": True} for spec in VISUAL_TOPICS.values()
        },
    }
    document = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split(list(panels), "row"),
    }
    return json.dumps(document, indent=1) + "\n"


def plotjuggler_layout(namespace: str = "/") -> str:
    """Return a layout for PlotJuggler 3.

    Args:
        namespace: of the vehicle.
    """
    root = ET.Element("root")
    tabs = ET.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    tab = ET.SubElement(tabs, "Tab", tab_name="iptm", containers="1")
    container = ET.SubElement(tab, "Container")
    groups = _columns(plots(namespace), _COLUMNS)
    outer = _splitter(container, "-", len(groups))
    for group in groups:
        column = _splitter(outer, "|", len(group))
        for plot in group:
            area = ET.SubElement(column, "DockArea", name=plot.title)
            drawn = ET.SubElement(area, "plot", mode="TimeSeries", style="Lines")
            for curve, color in zip(plot.curves, cycle(_COLORS), strict=False):
                ET.SubElement(drawn, "curve", name=plotjuggler_name(curve), color=color)
    ET.SubElement(tabs, "currentTabIndex", index="0")
    ET.SubElement(root, "use_relative_time_offset", enabled="0")
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def plotjuggler_name(curve: Curve) -> str:
    """Return the name of a curve in PlotJuggler, which calls named values by their names."""
    if curve.index is not None:
        return f"{curve.topic}/{curve.name}/{curve.field}"
    return f"{curve.topic}/{curve.field.replace('.', '/')}"


def rviz_config(namespace: str = "/") -> str:
    """Return a configuration for RViz: the scene of `scripts/visualize`, the camera behind the host.

    Args:
        namespace: of the vehicle.
    """
    displays: list[dict[str, Any]] = [
        {"Class": "rviz_default_plugins/Grid", "Name": "10 m", "Enabled": True, "Cell Size": 10}
        | {"Plane Cell Count": 200}
    ]
    for spec, color in zip(VISUAL_TOPICS.values(), cycle(_RVIZ_COLORS), strict=False):
        is_path = spec.message_type is Path
        shown = {"Color": color, "Line Style": "Billboards", "Line Width": 0.4} if is_path else {}
        displays.append(
            {
                "Class": f"rviz_default_plugins/{'Path' if is_path else 'MarkerArray'}",
                "Name": spec.name,
                "Enabled": True,
                **shown,
                "Topic": _rviz_topic(_full_name(spec.name, namespace), is_latched=spec.latched),
            }
        )
    # Both need transforms, so a visualizer where tf2_msgs is installed.
    frames = [
        frame_in(namespace, name) for name in (ROAD_FRAME, HOST_FRAME, LEADER_FRAME, PACK_FRAME)
    ]
    displays.append(
        {"Class": "rviz_default_plugins/TF", "Name": "frames", "Enabled": True, "Marker Scale": 4}
        | {"Frames": {"All Enabled": False, **{name: {"Value": True} for name in frames}}}
    )
    description = _full_name(DESCRIPTION_TOPIC, namespace)
    displays.append(
        {"Class": "rviz_default_plugins/RobotModel", "Name": "car", "Enabled": False}
        | {"Description Source": "Topic"}
        | {"Description Topic": _rviz_topic(description, is_latched=True)}
    )
    document = {
        "Panels": [{"Class": "rviz_common/Displays", "Name": "Displays"}],
        "Visualization Manager": {
            "Class": "",
            "Displays": displays,
            "Global Options": {"Fixed Frame": MAP_FRAME, "Frame Rate": 30},
            "Tools": [{"Class": "rviz_default_plugins/MoveCamera"}],
            "Views": {
                "Current": {
                    "Class": "rviz_default_plugins/TopDownOrtho",
                    "Name": "from above",
                    "Scale": 5,
                    # Moves with the host where there are transforms.
                    "Target Frame": frame_in(namespace, HOST_FRAME),
                }
            },
        },
    }
    text: str = yaml.safe_dump(document, sort_keys=False)
    return text


def _rviz_topic(name: str, *, is_latched: bool) -> dict[str, Any]:
    return {
        "Value": name,
        "Depth": 1 if is_latched else 10,
        "History Policy": "Keep Last",
        "Reliability Policy": "Reliable",
        "Durability Policy": "Transient Local" if is_latched else "Volatile",
    }


LAYOUTS = {
    "foxglove.json": foxglove_layout,
    "plotjuggler.xml": plotjuggler_layout,
    "rviz.rviz": rviz_config,
}
"""What makes each file of the folder `layouts`."""


def _full_name(name: str, namespace: str) -> str:
    prefix = namespace.strip("/")
    if name.startswith("/"):
        return name
    return f"/{prefix}/{name}" if prefix else f"/{name}"


def _titled(title: str) -> dict[str, str]:
    # Each of the two viewers reads a key of its own.
    return {"foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _slug(text: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in text).strip("_").lower()


def _split(panels: Sequence[str], direction: str) -> Any:
    """Return panels as a tree of halves, of which a layout consists."""
    if len(panels) == 1:
        return panels[0]
    middle = (len(panels) + 1) // 2
    other = "column" if direction == "row" else "row"
    return {
        "direction": direction,
        "first": _split(panels[:middle], other),
        "second": _split(panels[middle:], other),
        "splitPercentage": round(100.0 * middle / len(panels)),
    }


def _columns(found: Iterable[Plot], count: int) -> list[list[Plot]]:
    all_plots = list(found)
    return [all_plots[k::count] for k in range(min(count, len(all_plots)))]


def _splitter(parent: ET.Element, orientation: str, count: int) -> ET.Element:
    sizes = ";".join([f"{1.0 / count:.6f}"] * count)
    return ET.SubElement(
        parent, "DockSplitter", orientation=orientation, sizes=sizes, count=str(count)
    )
