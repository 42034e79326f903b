"""Exported tables hold what the bag holds, to the last bit, and never take the place of a file."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from sensor_msgs.msg import BatteryState

from iptm_bags.reading import export as main
from iptm_core.errors import BagError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_ros.codecs import serialized
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.run_information import RunInformation
from iptm_ros.recording.trajectory_file import read_exported_trajectory
from iptm_ros.recording.trajectory_reader import read_trajectory

WriteRun = Callable[..., Path]


@pytest.fixture
def bag(trajectory: Trajectory, write_run: WriteRun, tmp_path: Path) -> Path:
    information = RunInformation("us06", 7, yaml.safe_dump({"plant": {"cycle": "us06"}}))
    return write_run(tmp_path / "bag", trajectory, custom_data=information.to_custom_data())


@pytest.fixture
def two_vehicles(trajectory: Trajectory, write_run: WriteRun, tmp_path: Path) -> Path:
    """One bag with two vehicles; the second is 2 m further on."""
    moved = trajectory.to_arrays()
    for name in ("position_m", "leader_position_m"):
        moved[name] = moved[name] + 2.0
    runs = {"/car_1": trajectory, "/car_2": Trajectory.from_arrays(moved)}
    with BagWriter(tmp_path / "both") as writer:
        for namespace, run in runs.items():
            one = write_run(tmp_path / namespace[1:], run, namespace=namespace)
            with BagReader(one) as reader:
                ids = {
                    t.name: writer.add_topic(t.name, t.type_name) for t in reader.topics.values()
                }
                for message in reader.raw_messages():
                    writer.write(ids[message.topic], message.data, message.log_time_ns)
    return tmp_path / "both"


def read_csv(path: Path) -> dict[str, list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, map(list, zip(*rows, strict=True)), strict=True))


def test_trajectory_comes_back_exactly(bag: Path, tmp_path: Path) -> None:
    for name in ("run.parquet", "run.csv"):
        assert main([str(bag), "-o", str(tmp_path / name)]) == 0
    expected = read_trajectory(bag)
    table = pq.read_table(tmp_path / "run.parquet")
    text = read_csv(tmp_path / "run.csv")
    assert table.column_names == list(text) == [*TRAJECTORY_COLUMNS, "gap_m"]
    for name in table.column_names:
        values = getattr(expected, name)
        np.testing.assert_array_equal(table[name].to_numpy(), values, err_msg=name)
        np.testing.assert_array_equal([float(x) for x in text[name]], values, err_msg=name)


def test_a_trajectory_is_read_back_from_parquet(bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "run.parquet"
    assert main([str(bag), "-o", str(file)]) == 0
    trajectory, metadata = read_exported_trajectory(file)
    driven = read_trajectory(bag)
    for name in TRAJECTORY_COLUMNS:
        np.testing.assert_array_equal(getattr(trajectory, name), getattr(driven, name))
    assert metadata["table"] == "trajectory"
    for content in (b"", b"PAR1 damaged", file.read_bytes()[:-1]):
        file.write_bytes(content)
        with pytest.raises(BagError, match="cannot read a trajectory from"):
            read_exported_trajectory(file)


def test_parquet_tells_what_the_run_depended_on(bag: Path, tmp_path: Path) -> None:
    assert main([str(bag), "-o", str(tmp_path / "run.parquet")]) == 0
    found = {
        k.decode(): v.decode() for k, v in pq.read_schema(tmp_path / "run.parquet").metadata.items()
    }
    assert (found["iptm_scenario"], found["iptm_seed"], found["iptm_bag"]) == ("us06", "7", "bag")
    assert yaml.safe_load(found["iptm_parameters"]) == {"plant": {"cycle": "us06"}}


def test_messages_of_a_topic_join_the_trajectory(bag: Path, tmp_path: Path) -> None:
    arguments = ["--topic", "plant/cell_1_temperature", "-o", str(tmp_path / "t.parquet")]
    assert main([str(bag), *arguments]) == 0
    table = pq.read_table(tmp_path / "t.parquet")
    run = read_trajectory(bag)
    np.testing.assert_array_equal(table["stamp_s"].to_numpy(), run.time_s)
    with BagReader(bag) as reader:
        messages = list(reader.messages(["/plant/cell_1_temperature"]))
    assert table["temperature_c"].to_pylist() == [m.message.temperature for m in messages]
    assert table["log_time_ns"].to_pylist() == [m.log_time_ns for m in messages]
    assert set(table["header.frame_id"].to_pylist()) == {messages[0].message.header.frame_id}


def test_missing_and_undefined_values_stay_apart(tmp_path: Path) -> None:
    """Arrays may grow from message to message; NaN is a value, an element that is not there is none."""
    with BagWriter(tmp_path / "bag") as writer:
        topic = writer.add_topic("/car_1/plant/battery", "sensor_msgs/msg/BatteryState")
        for voltages in ([3.5], [3.25, 3.0], []):
            message = BatteryState(cell_voltage=voltages, charge=math.nan, location='a "b",\nc')
            writer.write(topic, serialized(message), len(voltages))
    for name in ("x.parquet", "x.csv"):
        assert (
            main([str(tmp_path / "bag"), "--topic", "plant/battery", "-o", str(tmp_path / name)])
            == 0
        )
    table = pq.read_table(tmp_path / "x.parquet")
    assert table["cell_voltage.0_v"].to_pylist() == [None, 3.5, 3.25]  # in the order of log times
    assert table["cell_voltage.1_v"].to_pylist() == [None, None, 3.0]
    assert all(map(math.isnan, table["charge_ah"].to_pylist()))
    text = read_csv(tmp_path / "x.csv")
    assert text["cell_voltage.1_v"] == ["", "", "3.0"]
    assert text["charge_ah"] == ["nan"] * 3
    assert set(text["location"]) == {'a "b",\nc'}


def test_one_of_several_vehicles(
    two_vehicles: Path, trajectory: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "run.parquet"
    assert main([str(two_vehicles), "-o", str(output)]) == 2
    assert "--namespace /car_1 or /car_2" in capsys.readouterr().err
    assert not output.exists()
    assert main([str(two_vehicles), "-o", str(output), "--namespace", "car_2"]) == 0
    found = pq.read_table(output)["position_m"].to_numpy()
    np.testing.assert_array_equal(found, trajectory.position_m + 2.0)


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("taken.csv", "exists already"),
        ("run.xlsx", "allowed: a name that ends in .parquet or .csv"),
        ("no_folder/run.csv", "No such file"),
        (f"{'x' * 300}.csv", "too long"),
    ],
)
def test_outputs_that_cannot_be(
    output: str, message: str, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken.csv").write_text("precious")
    assert main([str(bag), "-o", str(tmp_path / output)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert (tmp_path / "taken.csv").read_text() == "precious"


def test_a_bag_that_cannot_be_exported_leaves_no_file(
    bag: Path, small_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = bag / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    for arguments, message in (
        ([str(bag)], "iptm recover"),
        ([str(small_bag)], "no topic 'plant/state'"),
        ([str(small_bag), "--topic", "/c"], "no topic '/c'"),
    ):
        assert main([*arguments, "-o", str(tmp_path / "x.parquet")]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "x.parquet").exists()
