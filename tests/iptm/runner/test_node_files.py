"""Parameter files and launch files agree with the packages that they start."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml
from tests.packaging.packages import PACKAGES, setup_of

import iptm.runner
from iptm.trip_settings import HOME
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_core.declaration import checked_value, parameter_specs, plain
from iptm_core.errors import ScenarioError
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_v2x_bridge.node_answers import BridgeNodeParameters

CONFIG = Path(iptm.runner.__file__).parent / "config" / "nodes"
SOURCE = Path(iptm.runner.__file__).parents[3]
LAUNCH = SOURCE / "iptm" / "launch"
NODES: dict[str, type[Any]] = {
    "plant": PlantNodeParameters,
    "v2x_bridge": BridgeNodeParameters,
    "controller": ControllerNodeParameters,
}

needs_sources = pytest.mark.skipif(not LAUNCH.is_dir(), reason="installed without its sources")


@needs_sources
def test_the_aggregator_sorts_every_status_into_one_group() -> None:
    path = CONFIG.parent / "diagnostic_aggregator.yaml"
    parameters = yaml.safe_load(path.read_text(encoding="utf-8"))["analyzers"]["ros__parameters"]
    groups = [entry["contains"] for entry in parameters.values() if isinstance(entry, dict)]
    found = re.compile(r"DiagnosticsReporter\.of_node\(self, (?:\"([^\"]+)\"|NAME)\)")
    components = {
        match[1] or "traffic"
        for source in SOURCE.rglob("*node*.py")
        for match in found.finditer(source.read_text(encoding="utf-8"))
    }
    assert {"vehicle", "preview", "optimal control"} <= components
    for component in components:
        name = f"/car_1/any_node: {component}"
        assert [any(part in name for part in parts) for parts in groups].count(True) == 1, name


@pytest.mark.parametrize("node", NODES)
def test_parameter_files_state_every_parameter_with_its_default(node: str) -> None:
    content = yaml.safe_load((CONFIG / f"{node}.yaml").read_text(encoding="utf-8"))
    assert content.keys() == {f"/**/{node}"}
    given = content[f"/**/{node}"]["ros__parameters"]
    assert given.keys() == {spec.name for spec in parameter_specs(NODES[node])}
    assert NODES[node](**given) == NODES[node]()


class Recorded:
    """Stands for any class of `launch`: remembers what it was built with."""

    made: list[Recorded] = []  # noqa: RUF012

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments = arguments
        self.named = named
        Recorded.made.append(self)


def recorded_class(name: str) -> type[Recorded]:
    return type(name, (Recorded,), {})


@pytest.fixture
def launch_stubs(monkeypatch: pytest.MonkeyPatch) -> list[Recorded]:
    """Stand in for the packages of a full ROS 2 installation."""
    modules = {
        "launch": ["LaunchContext", "LaunchDescription"],
        "launch.actions": [
            "DeclareLaunchArgument",
            "EmitEvent",
            "GroupAction",
            "IncludeLaunchDescription",
            "OpaqueFunction",
            "RegisterEventHandler",
        ],
        "launch.event_handlers": ["OnProcessExit"],
        "launch.events": ["matches_action"],
        "launch.events.process": ["ShutdownProcess"],
        "launch.conditions": ["IfCondition"],
        "launch.launch_description_sources": ["PythonLaunchDescriptionSource"],
        "launch.substitutions": ["LaunchConfiguration", "PythonExpression"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
    }
    for name, classes in modules.items():
        module = ModuleType(name)
        for cls in classes:
            setattr(module, cls, recorded_class(cls))
        monkeypatch.setitem(sys.modules, name, module)
    package_index = ModuleType("ament_index_python.packages")
    package_index.get_package_share_directory = (  # type: ignore[attr-defined]
        lambda name: str(SOURCE / name / name / "runner")
    )
    monkeypatch.setitem(sys.modules, "ament_index_python.packages", package_index)
    Recorded.made = []
    return Recorded.made


def executables() -> set[tuple[str, str]]:
    """Return (package, executable) of every set-up script."""
    return {
        (package, line.split(" = ")[0])
        for package in PACKAGES
        for line in setup_of(package).get("entry_points", {}).get("console_scripts", [])
    }


def of_class(made: list[Recorded], name: str) -> list[Recorded]:
    return [item for item in made if type(item).__name__ == name]


class Loop:
    """A loop of the launch file, and what its event handlers do when its processes end."""

    def __init__(self, made: list[Recorded], **given: str) -> None:
        first = len(made)
        self.module = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))
        self.module["generate_launch_description"]()
        defaults = {name: default for name, (default, _) in self.module["ARGUMENTS"].items()}
        (opaque,) = of_class(made[first:], "OpaqueFunction")
        configurations = {**defaults, "record": "true", **given}
        opaque.named["function"](SimpleNamespace(launch_configurations=configurations))
        nodes = of_class(made[first:], "Node")
        self.nodes = [node for node in nodes if node.named["executable"] != "call"]
        self.handlers = {
            id(handler.named["target_action"]): handler.named["on_exit"]
            for handler in of_class(made[first:], "OnProcessExit")
        }

    def parameters(self, node: str) -> dict[str, Any]:
        """Return what the parameter file of a node holds."""
        (found,) = (each for each in self.nodes if each.named["name"] == node)
        text = Path(found.named["parameters"][0]).read_text(encoding="utf-8")
        given: dict[str, Any] = yaml.safe_load(text)[f"/**/{node}"]["ros__parameters"]
        return given

    def end(self, place: int, code: int = 0, *, is_shutdown: bool = False) -> list[Recorded]:
        """Return the processes that are ended after the end of one."""
        node = self.nodes[place]
        event = SimpleNamespace(returncode=code, process_name=f"{node.named['executable']}-1")
        actions = self.handlers[id(node)](event, SimpleNamespace(is_shutdown=is_shutdown))
        return [action.named["event"].named["process_matcher"].arguments[0] for action in actions]


@needs_sources
def test_the_launch_file_starts_what_the_packages_install(launch_stubs: list[Recorded]) -> None:
    Loop(launch_stubs)
    nodes = of_class(launch_stubs, "Node")
    started = {(node.named["package"], node.named["executable"]) for node in nodes}
    assert len(started) == 5
    assert started <= executables()


@needs_sources
def test_every_setting_of_a_trip_is_an_argument(launch_stubs: list[Recorded]) -> None:
    module = Loop(launch_stubs).module
    declared = {item.arguments[0] for item in of_class(launch_stubs, "DeclareLaunchArgument")}
    assert set(HOME) - {"faults", "domain"} <= declared == set(module["ARGUMENTS"])
    for argument in of_class(launch_stubs, "DeclareLaunchArgument"):
        choices = argument.named["choices"]
        assert argument.named["description"]
        assert choices is None or argument.named["default_value"] in choices


@needs_sources
@pytest.mark.parametrize("node", NODES)
def test_the_nodes_of_a_launch_have_the_parameters_of_its_trip(
    node: str, launch_stubs: list[Recorded]
) -> None:
    specs = {spec.name: spec for spec in parameter_specs(NODES[node])}
    given = Loop(launch_stubs, trip="real_time", cycle="us06").parameters(node)
    expected = {"cycle": "us06", "slope": "small", "mode": "real_time", "deadline_ms": 500.0}
    for name, value in given.items():
        assert plain(checked_value(specs[name], value)) == value
        assert value == expected.get(name, value)


@needs_sources
def test_the_end_of_a_node_ends_its_own_loop_and_that_of_the_recorder_nothing(
    launch_stubs: list[Recorded],
) -> None:
    loop = Loop(launch_stubs)
    assert not any("on_exit" in node.named for node in loop.nodes)
    assert [node.named["executable"] for node in loop.nodes][-1] == "recorder"
    for place, node in enumerate(loop.nodes[:-1]):
        assert loop.end(place) == [other for other in loop.nodes if other is not node]
    assert loop.end(3) == []


@needs_sources
def test_a_launch_fails_when_the_last_process_of_a_loop_has_ended(
    launch_stubs: list[Recorded],
) -> None:
    for record, last in (("true", 3), ("false", 2)):
        loop = Loop(launch_stubs, record=record)
        assert len(loop.end(0, -9)) == last
        for place in range(1, last):
            loop.end(place)
        with pytest.raises(RuntimeError, match=r"-1 ended with exit code -9"):
            loop.end(last)
    with pytest.raises(RuntimeError, match="ended with exit code 2"):  # a mistake, at once
        Loop(launch_stubs).end(1, 2)
    interrupted = Loop(launch_stubs)
    for place in range(4):
        interrupted.end(place, -2, is_shutdown=True)


@needs_sources
@pytest.mark.usefixtures("launch_stubs")
def test_a_loop_that_is_not_begun_fails_the_launch() -> None:
    module = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))
    end = module["LoopEnd"].on_start_signal
    driving = SimpleNamespace(is_shutdown=False)
    end(SimpleNamespace(returncode=0, process_name="call-5"), driving)
    with pytest.raises(RuntimeError, match="call-5 ended with exit code 2"):
        end(SimpleNamespace(returncode=2, process_name="call-5"), driving)


@needs_sources
def test_a_launch_drives_no_faults(launch_stubs: list[Recorded], tmp_path: Path) -> None:
    file = tmp_path / "faulty.yaml"
    file.write_text("conditions: {faults: [{kind: preview_lost, start_s: 5, duration_s: 5}]}\n")
    with pytest.raises(ScenarioError, match="has faults"):
        Loop(launch_stubs, trip=str(file))
