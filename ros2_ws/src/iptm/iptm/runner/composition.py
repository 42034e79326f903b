"""Turns a trip into the commands that start its processes; pure data, nothing is started here.

The nodes are identified by module and parameter names only, as when started by hand.
"""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from iptm.faults.fault import Fault, at_places, faulty_name, plain_faults, route_name
from iptm.faults.kinds import FaultPlace
from iptm.trip import Trip
from iptm.trip_files import trip_text
from iptm.trip_settings import NODE_SETTINGS, NODES
from iptm_core.declaration import Scalar, parameter_specs
from iptm_core.errors import ScenarioError
from iptm_core.extras import offered
from iptm_core.parameters import to_flat_dict
from iptm_core.program import SECTION_END
from iptm_ros.recording.run_information import MODEL_KEY
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT, Topic, full_name

PYTHON = (sys.executable, "-m", "iptm_core")
"""Start of the command of a program of the suite; its module and arguments follow."""
RECORDER = "recorder"
SHARED = "iptm.runner.one_process"
_Vehicle = TypeVar("_Vehicle")
INJECTOR = "fault_injector"
COMMENT_WIDTH = 100
MODULES = {
    PLANT: "iptm_plant_sim.node",
    BRIDGE: "iptm_v2x_bridge.node",
    CONTROLLER: "iptm_controller.node",
    RECORDER: "iptm_ros.recording.recorder_cli",
}
FAULTY_NODES = {FaultPlace.SOLVER: CONTROLLER, FaultPlace.VEHICLE: PLANT}
"""Nodes that variants with faults inside replace, by the place of the fault."""

_TOPIC_PLACES = (
    FaultPlace.TRAFFIC,
    FaultPlace.PREVIEW,
    FaultPlace.LEADER,
    FaultPlace.ROAD,
    FaultPlace.STATE,
    FaultPlace.CLOCK,
    FaultPlace.STAMPS,
)
"""Fault places that need the injector."""

_REMAPPED: Mapping[str, Mapping[str, str]] = {
    CONTROLLER: {
        topic.value: faulty_name(topic.value)
        for topic in (Topic.PLANT_STATE, Topic.LEADER, Topic.LEADER_PREVIEW, Topic.SLOPE)
    },
    PLANT: {Topic.LEADER_PREVIEW.value: faulty_name(Topic.LEADER_PREVIEW.value)},
    BRIDGE: {
        Topic.CLOCK.value: faulty_name(Topic.CLOCK.value),
        Topic.LEADER.value: route_name(Topic.LEADER.value),
        Topic.LEADER_SAMPLES.value: route_name(Topic.LEADER_SAMPLES.value),
        Topic.LEADER_PREVIEW.value: route_name(Topic.LEADER_PREVIEW.value),
    },
}
"""Topics of nodes that are routed through the injector if there is one, by node and name."""


def node_parameters(trip: Trip) -> dict[str, dict[str, Scalar]]:
    """Return the parameters of each node, the injector's among them if a fault acts on topics.

    The plant waits for the runner, which resumes it when all nodes hear each other.
    """
    own: dict[str, dict[str, Scalar]] = {
        PLANT: {"start_paused": True},
        BRIDGE: {"initial_gap_m": trip.parameters.gap.initial_gap_m},
        CONTROLLER: {"trip_duration_s": trip.route.duration_s},
    }
    parameters = {node: {**node_settings(trip, node), **own[node]} for node in NODES}
    faults = trip.conditions.faults
    for place, node in FAULTY_NODES.items():
        if inside := at_places(faults, place):
            parameters[node]["faults"] = json.dumps(plain_faults(inside))
    if needs_injector(faults):
        on_topics = at_places(faults, *_TOPIC_PLACES)
        text = json.dumps(plain_faults(on_topics))
        parameters[INJECTOR] = {"faults": text, "mode": trip.settings["mode"]}
    return parameters


def trip_members(trip: Trip, *, recorder: bool) -> tuple[str, ...]:
    """Return the full names of the nodes that must hear each other before the trip begins.

    Nodes of the user are not among them, as they make no reports; nodes of the vehicles ahead and behind are.
    """
    nodes = [*(node for node in NODES if node not in trip.foreign)]
    nodes += [INJECTOR] * needs_injector(trip.conditions.faults) + [RECORDER] * recorder
    others = [trip.leader.vehicle_ahead.strip("/"), trip.vehicle.vehicle_behind.strip("/")]
    return (
        *(full_name(trip.full_namespace, node) for node in nodes),
        *(full_name(f"/{other}", node) for other in others if other for node in NODES),
    )


def needs_injector(faults: Sequence[Fault]) -> bool:
    """Return whether a fault acts on topics."""
    return bool(at_places(faults, *_TOPIC_PLACES))


def node_command(
    node: str, parameter_file: Path, namespace: str, faults: Sequence[Fault] = ()
) -> list[str]:
    """Return the command that starts a node of the loop."""
    ros_arguments = [*_remaps(namespace), "--params-file", str(parameter_file)]
    if needs_injector(faults):
        for name, other in _REMAPPED.get(node, {}).items():
            ros_arguments += ["-r", f"{name}:={other}"]
    return [*PYTHON, _module_of(node, faults), "--ros-args", *ros_arguments]


def _module_of(node: str, faults: Sequence[Fault]) -> str:
    """Return the module of a node; the injector and nodes with faults inside come from an extra.

    Raises:
        ScenarioError: the extra is not installed.
    """
    places = [place for place, faulty in FAULTY_NODES.items() if node == faulty]
    if node in MODULES and not at_places(faults, *places):
        return MODULES[node]
    for extra in offered("faults"):
        return str(extra.INJECTOR if node == INJECTOR else extra.NODES[node])
    raise ScenarioError("the trip has faults; allowed: none over ROS 2 without the extra of faults")


def vehicle_arguments(parameter_files: Iterable[Path], namespace: str) -> list[str]:
    """Return the arguments of all nodes of a vehicle for a process that they share."""
    files = [each for path in parameter_files for each in ("--params-file", str(path))]
    return ["--ros-args", *_remaps(namespace), *files]


def recorder_arguments(
    output: Path,
    information: Path,
    compression: str,
    namespace: str,
    *,
    repeats: bool,
    also: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """Return the arguments of the recorder of a vehicle, which may write topics that repeat others itself.

    Args:
        also: types of topics beyond the topic table, by name.
    """
    options = ["--run-information", str(information), "--compression", compression]
    options += ["--repeat"] * repeats
    for name, type_name in also.items():
        options += ["--also", name, type_name]
    return [str(output), "--in-existing-folder", *options, "--ros-args", *_remaps(namespace)]


def shared_command(module: str, arguments: Iterable[Sequence[str]]) -> list[str]:
    """Return the command of a process that the nodes of several vehicles share."""
    parts = [part for each in arguments for part in (*each, SECTION_END)]
    return [*PYTHON, module, *parts[:-1]]


def grouped(vehicles: Sequence[_Vehicle], processes: int) -> list[Sequence[_Vehicle]]:
    """Divide vehicles among processes, neighbours together and as evenly as can be."""
    ends = [len(vehicles) * number // processes for number in range(processes + 1)]
    return [vehicles[begin:end] for begin, end in pairwise(ends) if begin < end]


def _remaps(namespace: str) -> list[str]:
    return [] if namespace == "/" else ["-r", f"__ns:={namespace}"]


def parameter_file_text(
    node: str, parameters: Mapping[str, Scalar], comments: Mapping[str, str] | None = None
) -> str:
    """Return a ROS 2 parameter file for a node in any namespace.

    Texts are always quoted: ROS would take a bare ``1e3`` or ``on`` for a number or a truth value.
    """
    lines = [f"/**/{node}:", "  ros__parameters:"]
    for name, value in parameters.items():
        remark = (comments or {}).get(name, "")
        lines += textwrap.wrap(
            remark, COMMENT_WIDTH, initial_indent="    # ", subsequent_indent="    # "
        )
        lines.append(f"    {name}: {_scalar_text(value)}")
    return "\n".join(lines) + "\n"


def _scalar_text(value: Scalar) -> str:
    text = json.dumps(value)
    # Some readers of YAML take `1e-05` for a text; with a point it is a number to all of them.
    is_bare = isinstance(value, float) and "." not in text
    return text.replace("e", ".0e") if is_bare else text


def run_information(trip: Trip, parameters: Mapping[str, Mapping[str, Scalar]]) -> dict[str, Any]:
    """Return the information about the run to be stored; the recorder adds revision and versions."""
    return {
        "scenario": trip.name,
        "run": trip.title,
        "seed": trip.leader.seed,
        "parameters": {
            MODEL_KEY: to_flat_dict(trip.model.values),
            **{node: dict(given) for node, given in parameters.items()},
        },
        "trip": trip_text(trip),
        "route": f"{trip.route.name}, {trip.route.duration_s:g} s ({trip.route.source})",
    }


def node_settings(trip: Trip, node: str) -> dict[str, Scalar]:
    """Return the parameters of a node that a trip states."""
    values = trip.settings
    if node == CONTROLLER:
        values["overrides"] = trip.controller_model_overrides
    names = [spec.name for group in NODE_SETTINGS[node] for spec in parameter_specs(group)]
    return {name: values[name] for name in names}
