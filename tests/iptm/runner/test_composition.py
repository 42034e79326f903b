"""From a trip to commands: names of node parameters, texts that ROS reads as texts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from iptm.runner.composition import (
    grouped,
    node_parameters,
    parameter_file_text,
    recorder_arguments,
    run_information,
    shared_command,
    trip_members,
)
from iptm.trip import Trip
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_core.declaration import checked_value, parameter_specs, plain
from iptm_core.program import sections
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_ros.discovery import reserve_domain
from iptm_ros.recording.recorder_cli import build_parser
from iptm_ros.recording.run_information import load_run_information, stored_model_parameters
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT
from iptm_v2x_bridge.node_answers import BridgeNodeParameters

NODES: dict[str, type[Any]] = {
    PLANT: PlantNodeParameters,
    BRIDGE: BridgeNodeParameters,
    CONTROLLER: ControllerNodeParameters,
}


@pytest.mark.parametrize("node", NODES)
def test_nodes_have_the_parameters_that_they_are_given(node: str, trip: Trip) -> None:
    specs = {spec.name: spec for spec in parameter_specs(NODES[node])}
    for name, value in node_parameters(trip)[node].items():
        assert plain(checked_value(specs[name], value)) == value
        assert type(value) in {bool, int, float, str}


def test_values_arrive_and_the_bridge_starts_where_the_model_does() -> None:
    trip = Trip.of("us06", seed=9, horizon="15x1", overrides="gap.initial_gap_m=22", tolerance=1e-6)
    parameters = node_parameters(trip)
    assert parameters[PLANT]["cycle"] == parameters[BRIDGE]["cycle"] == "us06"
    assert parameters[BRIDGE]["initial_gap_m"] == 22.0
    assert parameters[BRIDGE]["seed"] == 9
    assert parameters[CONTROLLER]["horizon"] == "15x1"
    assert parameters[CONTROLLER]["tolerance"] == 1e-6


def test_the_road_of_a_plan_need_be_as_long_as_the_trip_only() -> None:
    """The whole of US06 is 12.9 km."""
    pytest.importorskip("iptm_drives", reason="the extra is not installed")
    road = Path(__file__).parents[3] / "docs" / "examples" / "phone_drive.gpx"
    trip = Trip.of("us06", slope=str(road), duration_s=60.0)
    bridge = BridgeNodeParameters(**node_parameters(trip)[BRIDGE])  # type: ignore[arg-type]
    assert bridge.trip_route(bridge.initial_gap_m).road_line.length_m < 6000.0


def test_the_trip_waits_for_its_own_nodes_and_those_of_its_neighbours(trip: Trip) -> None:
    assert node_parameters(trip)[PLANT]["start_paused"] is True
    assert trip_members(trip, recorder=True) == (
        "/plant", "/v2x_bridge", "/controller", "/recorder"
    )  # fmt: skip
    second = trip.changed(
        foreign=frozenset({CONTROLLER}), namespace="/car_2", vehicle_ahead="/car_1"
    )
    assert trip_members(second, recorder=False) == (
        "/car_2/plant", "/car_2/v2x_bridge", "/car_1/plant", "/car_1/v2x_bridge", "/car_1/controller"
    )  # fmt: skip


def test_ros_reads_parameter_files_as_they_are_meant(tmp_path: Path) -> None:
    values = {
        "truth": True, "count": 3, "small": 1e-7, "large": 1e22, "whole": 2.0, "text": "3x1+5x5",
        "digits": "1e3", "word": "on", "path": "a b/c: #d", "quote": "it's \"so\"", "nothing": "",
        "unicode": "ö",
    }  # fmt: skip
    path = tmp_path / "parameters.yaml"
    path.write_text(parameter_file_text("plant", values), encoding="utf-8")
    context = Context()
    with reserve_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        node = Node(
            "plant",
            namespace="/car_1",
            context=context,
            cli_args=["--ros-args", "--params-file", str(path)],
            automatically_declare_parameters_from_overrides=True,
            enable_rosout=False,
        )
        found = {name: node.get_parameter(name).value for name in values}
        node.destroy_node()
        context.try_shutdown()
    assert found == values
    assert {name: type(value) for name, value in found.items()} == {
        name: type(value) for name, value in values.items()
    }


def test_the_recorder_understands_its_command() -> None:
    given = [
        recorder_arguments(
            Path("out"),
            Path("info.yaml"),
            "zstd",
            f"/car_{number}",
            repeats=True,
            also={"plant/door": "std_msgs/msg/Bool"},
        )
        for number in (1, 2)
    ]
    command = shared_command("a.module", given)
    assert command[3] == "a.module"
    assert sections(command[4:]) == given
    assert given[0][-3:] == ["--ros-args", "-r", "__ns:=/car_1"]
    parsed = build_parser().parse_args(remove_ros_args(given[0]))
    assert parsed.output == Path("out")
    assert parsed.run_information == Path("info.yaml")
    assert parsed.compression == "zstd"
    assert parsed.also == [["plant/door", "std_msgs/msg/Bool"]]


def test_vehicles_are_divided_evenly_and_in_order() -> None:
    assert grouped(range(5), 2) == [range(2), range(2, 5)]
    assert grouped(range(2), 2) == [range(1), range(1, 2)]
    assert grouped(range(1), 1) == [range(1)]


def test_the_bag_holds_everything_about_the_run(trip: Trip, tmp_path: Path) -> None:
    described = run_information(trip, node_parameters(trip))
    path = tmp_path / "information.yaml"
    path.write_text(yaml.safe_dump(described, sort_keys=False), encoding="utf-8")
    information = load_run_information(path)
    assert information.scenario == "short"
    assert information.seed == 0
    assert stored_model_parameters(information) == trip.parameters
    assert yaml.safe_load(information.parameters)[BRIDGE]["cycle"] == "sc03"
    assert yaml.safe_load(information.extra["trip"])["road"]["slope"] == "small"
    assert information.versions["python"]
