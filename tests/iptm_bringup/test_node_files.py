"""Parameter files and launch files agree with the packages that they start."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

import iptm_bringup
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_core.declaration import checked_value, parameter_specs
from iptm_core.errors import ScenarioError
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters

CONFIG = Path(iptm_bringup.__file__).parent / "config" / "nodes"
SOURCE = Path(iptm_bringup.__file__).parents[2]
LAUNCH = SOURCE / "iptm_bringup" / "launch"
NODES: dict[str, type[Any]] = {
    "plant": PlantNodeParameters,
    "v2x_bridge": BridgeNodeParameters,
    "controller": ControllerNodeParameters,
}

needs_sources = pytest.mark.skipif(not LAUNCH.is_dir(), reason="installed without its sources")


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
        lambda name: str(SOURCE / name / name)
    )
    monkeypatch.setitem(sys.modules, "ament_index_python.packages", package_index)
    Recorded.made = []
    return Recorded.made


def executables() -> set[tuple[str, str]]:
    """Return (package, executable) of every set-up script."""
    found = set()
    for path in SOURCE.glob("*/setup.py"):
        texts = {
            node.value
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
        found |= {(path.parent.name, text.split(" = ")[0]) for text in texts if " = iptm_" in text}
    return found


def of_class(made: list[Recorded], name: str) -> list[Recorded]:
    return [item for item in made if type(item).__name__ == name]


@needs_sources
def test_the_launch_file_starts_what_the_packages_install(launch_stubs: list[Recorded]) -> None:
    module = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))
    module["generate_launch_description"]()
    nodes = of_class(launch_stubs, "Node")
    started = {(node.named["package"], node.named["executable"]) for node in nodes}
    assert len(started) == 4
    assert started <= executables()


@needs_sources
def test_the_launch_file_sets_parameters_and_arguments_that_exist(
    launch_stubs: list[Recorded],
) -> None:
    module = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))
    module["generate_launch_description"]()
    declared = {item.arguments[0] for item in of_class(launch_stubs, "DeclareLaunchArgument")}
    used = {item.arguments[0] for item in of_class(launch_stubs, "LaunchConfiguration")}
    assert used == declared - {"scenario"}  # which is read before the others are set
    for argument in of_class(launch_stubs, "DeclareLaunchArgument"):
        choices = argument.named["choices"]
        assert argument.named["description"]
        assert choices is None or argument.named["default_value"] in choices
    for node in of_class(launch_stubs, "Node"):
        name = node.named["name"]
        if name not in NODES:
            continue
        specs = {spec.name: spec for spec in parameter_specs(NODES[name])}
        for key, value in node.named["parameters"][1].items():
            if key == "use_sim_time":
                continue
            assert specs[key].kind is value.named["value_type"], key
            if key in module["ARGUMENTS"]:
                default = value.named["value_type"](module["ARGUMENTS"][key][0])
                assert checked_value(specs[key], default) == specs[key].default, key
    for name in NODES:
        assert Path(module["ARGUMENTS"][f"{name}_parameters"][0]).is_file()


@needs_sources
def test_the_end_of_a_process_ends_its_own_loop_and_no_other(launch_stubs: list[Recorded]) -> None:
    module = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))
    module["generate_launch_description"]()
    nodes = of_class(launch_stubs, "Node")
    assert not any("on_exit" in node.named for node in nodes)
    ended = SimpleNamespace(returncode=0, process_name="plant-1")
    driving, stopping = SimpleNamespace(is_shutdown=False), SimpleNamespace(is_shutdown=True)
    handlers = {
        id(handler.named["target_action"]): [
            action.named["event"].named["process_matcher"].arguments[0]
            for action in handler.named["on_exit"](ended, driving)
        ]
        for handler in of_class(launch_stubs, "OnProcessExit")
    }
    # One that fails ends the launch, unless that is ending anyway.
    failed = SimpleNamespace(returncode=2, process_name="controller-3")
    on_exit = of_class(launch_stubs, "OnProcessExit")[0].named["on_exit"]
    with pytest.raises(RuntimeError, match="controller-3 ended with exit code 2"):
        on_exit(failed, driving)
    assert on_exit(failed, stopping)
    assert len(of_class(launch_stubs, "RegisterEventHandler")) == len(nodes)
    for node in nodes:
        assert handlers[id(node)] == [other for other in nodes if other is not node]


@needs_sources
def test_a_scenario_is_the_default_of_arguments_that_are_not_given(
    launch_stubs: list[Recorded], tmp_path: Path
) -> None:
    module = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))
    module["generate_launch_description"]()
    (description,) = of_class(launch_stubs, "LaunchDescription")
    first, second = description.arguments[0][:2]
    assert first.arguments[0] == "scenario"
    take = second.named["function"]

    given = {"scenario": "real_time", "cycle": "us06"}
    take(SimpleNamespace(launch_configurations=given))
    assert (given["cycle"], given["slope"], given["mode"]) == ("us06", "small", "real_time")
    text = Path(given["controller_parameters"]).read_text(encoding="utf-8")
    assert yaml.safe_load(text)["/**/controller"]["ros__parameters"]["deadline_ms"] == 500
    assert given.keys() <= module["ARGUMENTS"].keys()

    clash = {"scenario": "real_time", "controller_parameters": "mine.yaml"}
    with pytest.raises(ScenarioError, match="parameters of controller"):
        take(SimpleNamespace(launch_configurations=clash))
    file = tmp_path / "faulty.yaml"
    file.write_text("faults:\n  - {kind: preview_lost, start_s: 5, duration_s: 5}\n")
    with pytest.raises(ScenarioError, match="has faults"):
        take(SimpleNamespace(launch_configurations={"scenario": str(file)}))
    none = {"scenario": ""}
    take(SimpleNamespace(launch_configurations=none))
    assert none == {"scenario": ""}


@needs_sources
def test_the_vehicles_of_a_string_follow_each_other(launch_stubs: list[Recorded]) -> None:
    module = runpy.run_path(str(LAUNCH / "string.launch.py"))
    module["generate_launch_description"]()
    configuration: Any = sys.modules["launch.substitutions"].LaunchConfiguration
    configuration.perform = lambda self, _: module["ARGUMENTS"][self.arguments[0]][0]
    (opaque,) = of_class(launch_stubs, "OpaqueFunction")
    opaque.named["function"](None)
    given = [
        dict(item.named["launch_arguments"])
        for item in of_class(launch_stubs, "IncludeLaunchDescription")
    ]
    names = ["/car_1", "/car_2", "/car_3", "/car_4", "/car_5"]
    assert [entry["namespace"] for entry in given] == names
    assert [entry["vehicle_ahead"] for entry in given] == ["", *names[:-1]]
    assert [entry["vehicle_behind"] for entry in given] == [*names[1:], ""]
    assert [entry["leader_source"] for entry in given] == ["cycle", *["vehicle"] * 4]
    # 15 m from bumper to bumper, and 4.5 m of car.
    starts_m = [float(entry["start_position_m"]) for entry in given]
    assert starts_m == [0.0, -19.5, -39.0, -58.5, -78.0]
    assert [Path(entry["bag"]).name for entry in given] == [name[1:] for name in names]
    assert not any("clock" in entry for entry in given)  # the namespace moves it
    # What is set for the first vehicle must not be in force for the second.
    groups = [item.arguments[0] for item in of_class(launch_stubs, "GroupAction")]
    assert groups == [[item] for item in of_class(launch_stubs, "IncludeLaunchDescription")]
    known = runpy.run_path(str(LAUNCH / "closed_loop.launch.py"))["ARGUMENTS"]
    assert all(entry.keys() <= known.keys() for entry in given)
