"""The whole suite as a user runs it: one command, real processes, a bag, and every way it can end."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pyarrow.parquet import read_table
from tests.foreign_readers import assert_read_by_all

from iptm_core.metrics.figures import FIGURES, figure_values
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_ros.codecs import ns_from_time
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.recording.trajectory_reader import read_decisions, read_trajectory
from iptm_ros.topics import TOPICS, Topic

MODULE = "iptm.commands.run"
TICKS = 60
RUN_TIMEOUT_S = 120.0
WELL_UNDER_WAY_BYTES = 500_000  # the definitions of the types take almost 200 000
PNG = b"\x89PNG\r\n\x1a\n"
NODE_MODULES = {
    "controller": "iptm_controller.node",
    "plant": "iptm_plant_sim.node",
    "v2x_bridge": "iptm_v2x_bridge.node",
    "recorder": "iptm_ros.recording.recorder_cli",
}
"""Name of a fork, and module in the command of a process that was not forked."""
ROOT = Path(__file__).resolve().parents[2]
# Names and standard types as promised to the outside, written down once more on purpose.
PROMISED = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/plant/odometry": "nav_msgs/msg/Odometry",
    "/plant/acceleration": "geometry_msgs/msg/AccelStamped",
    "/plant/battery": "sensor_msgs/msg/BatteryState",
    "/plant/cell_1_temperature": "sensor_msgs/msg/Temperature",
    "/plant/cell_n_temperature": "sensor_msgs/msg/Temperature",
    "/plant/coolant_inlet_temperature": "sensor_msgs/msg/Temperature",
    "/plant/coolant_outlet_temperature": "sensor_msgs/msg/Temperature",
    "/plant/state": "sensor_msgs/msg/JointState",
    "/v2x/leader": "nav_msgs/msg/Odometry",
    "/v2x/leader_preview": "sensor_msgs/msg/PointCloud2",
    "/v2x/slope": "std_msgs/msg/Float64MultiArray",
    "/controller/command": "sensor_msgs/msg/JointState",
    "/controller/plan": "sensor_msgs/msg/PointCloud2",
    "/controller/solve": "sensor_msgs/msg/JointState",
}
FULL_TABLE = ("Cooling energy", "Degradation inconsistency", "solve time (ms)")
LATCHED = "/v2x/slope"
# Runs with `-I`-like isolation from the project: it refuses to have any of its modules loaded.
STRANGER = """
import importlib, json, sys, time
import rclpy
from tests.foreign_readers import content_of
from rclpy.qos import DurabilityPolicy, QoSProfile

topics, latched = json.loads(sys.argv[1]), sys.argv[2]
rclpy.init()
node = rclpy.create_node("stranger")
counts = dict.fromkeys(topics, 0)
for name, type_name in topics.items():
    package, _, cls = type_name.split("/")
    kind = getattr(importlib.import_module(package + ".msg"), cls)
    qos = QoSProfile(depth=10)
    if name == latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    def heard(data, name=name, type_name=type_name):
        content_of(type_name, data)
        counts[name] += 1
    node.create_subscription(kind, name, heard, qos, raw=True)
deadline = time.monotonic() + 100.0
while not all(counts.values()) and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.1)
seen = {name: types for name, types in node.get_topic_names_and_types() if name in topics}
assert not [name for name in sys.modules if name.startswith("iptm")]
print(json.dumps({"counts": counts, "seen": seen}), flush=True)
"""
Start = Callable[..., Any]


@pytest.fixture
def start(launcher: Any) -> Start:
    """Start the runner with an output folder and options."""

    def run(output: Path, *arguments: str) -> Any:
        return launcher.start_module(MODULE, *arguments, "--output", output)

    return run


def processes_of(runner: Any) -> dict[str, int]:
    """Return name and pid of the runner's processes that are alive."""
    found = {}
    for folder in Path("/proc").iterdir():
        try:
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            words = (folder / "cmdline").read_bytes().decode().split("\0")
            words.append((folder / "comm").read_text().strip())
        except (OSError, ValueError, IndexError):
            continue
        if parent == runner.popen.pid:
            names = [name for name, module in NODE_MODULES.items() if {name, module} & {*words}]
            found |= dict.fromkeys(names, int(folder.name))
    return found


def wait_for_trip(runner: Any, output: Path, wait_until: Callable[..., None]) -> dict[str, int]:
    """Wait until the trip is well under way; return the processes."""

    def recorded() -> int:
        return sum(path.stat().st_size for path in output.glob("*.mcap"))

    wait_until(
        lambda: recorded() > WELL_UNDER_WAY_BYTES or not runner.is_running,
        timeout_s=RUN_TIMEOUT_S,
        what="messages in the bag",
    )
    assert runner.is_running, runner.stderr
    processes = processes_of(runner)
    assert processes.keys() == NODE_MODULES.keys()
    return processes


def all_gone(processes: dict[str, int]) -> bool:
    return not any(Path(f"/proc/{pid}").exists() for pid in processes.values())


def test_a_run_ends_with_bag_table_and_picture(start: Start, tmp_path: Path) -> None:
    """That it can be repeated to the last bit: `test_cam_closed_loop`, `test_traffic_over_ros`."""
    options = (
        "imperfect_preview", "--cycle", "us06", "--slope", "large",
        "--duration-s", str(TICKS), "--set", "leader.seed=11"
    )  # fmt: skip
    bag = tmp_path / "run"
    runner = start(bag, *options, "--full", "--against", "reference")
    assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
    assert "Traceback" not in runner.stderr

    # The bag: complete, for every reader, and it knows what it was made of.
    assert sum(assert_read_by_all(bag).values()) > TICKS * len(NODE_MODULES)
    with BagReader(bag) as reader:
        counts = {name: topic.message_count for name, topic in reader.topics.items()}
        information = reader.run_information()
    for topic, spec in TOPICS.items():
        if spec.on_request:
            continue
        name = topic.value if topic.value.startswith("/") else f"/{topic.value}"
        if topic is Topic.SLOPE:
            assert counts[name] == 1
        elif topic is not Topic.DIAGNOSTICS:
            # The answer to the last state is awaited, so that every run ends alike.
            assert counts[name] == TICKS + 1, name
    assert (information.scenario, information.seed) == ("imperfect_preview", 11)
    assert 'cycle: "us06"' in information.extra["trip"]
    trajectory = read_trajectory(bag)
    assert list(trajectory.time_s) == list(range(TICKS + 1))

    # The figures: on the terminal, in the file, and from the bag.
    parameters, is_stored = read_model_parameters(bag)
    assert is_stored
    values = figure_values(compute_metrics(trajectory, parameters, read_decisions(bag)))
    results = json.loads((bag / "results.json").read_text(encoding="utf-8"))
    assert {row["key"]: row["value"] for row in results["rows"]} == {
        key: values.get(key) for key in FIGURES
    }
    assert results["good"] is True
    assert results["metrics"]["decisions"]["decisions"] == TICKS + 1
    for text in FULL_TABLE:
        assert text in runner.stdout
    for text in results["summary"]["text"]:
        assert text.partition(": ")[2][:40] in runner.stdout
    assert len(read_table(bag / "reference.parquet")) == TICKS + 1
    assert "no hard limit broken, bag complete" in runner.stdout
    assert (bag / "closed_loop.png").read_bytes().startswith(PNG)
    for name in ("plant", "recorder"):
        assert (bag / "logs" / f"{name}.log").is_file()


def test_real_time_in_a_namespace_without_recording(start: Start, tmp_path: Path) -> None:
    output = tmp_path / "run"
    runner = start(
        output, "real_time", "--rate-factor", "20", "--duration-s", "40", "--namespace", "car_1",
        "--set", "controller.deadline_ms=0", "--no-record", "--no-picture"
    )  # fmt: skip
    assert runner.wait(RUN_TIMEOUT_S) == 0, runner.stdout + runner.stderr
    assert "not recorded" in runner.stdout
    assert "mode=real_time" in runner.stdout
    for text in (*FULL_TABLE, "as driven"):
        assert text not in runner.stdout
    assert sorted(path.name for path in output.iterdir()) == ["logs", "results.json"]
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert results["metrics"]["duration_s"] == 40.0
    assert results["bag_messages"] is None
    # Two seconds of wall time at least: the wall clock set the pace.
    assert results["wall_time_s"] > 1.9


def test_a_killed_process_is_named_and_everything_stops(
    start: Start, wait_until: Callable[..., None], tmp_path: Path
) -> None:
    output = tmp_path / "run"
    runner = start(output, "comprehensive", "--processes")
    processes = wait_for_trip(runner, output, wait_until)
    os.kill(processes["controller"], signal.SIGKILL)
    assert runner.wait() == 1
    assert "controller was killed by signal 9 (SIGKILL) at " in runner.stderr
    assert "s of the trip; the other processes of this run were stopped" in runner.stderr
    assert f"logs: {output / 'logs'}" in runner.stderr
    assert "Traceback" not in runner.stderr
    assert all_gone(processes)
    # The bag of the run so far is sound.
    assert len(read_trajectory(output)) > 10


def test_a_run_keeps_its_domain_any_ros_program_hears_it_and_it_can_be_interrupted(
    start: Start, launcher: Any, wait_until: Callable[..., None], tmp_path: Path
) -> None:
    """The other program joins late; constant data are still received."""
    output = tmp_path / "run"
    runner = start(output, "comprehensive", "--processes")
    processes = wait_for_trip(runner, output, wait_until)

    path = os.pathsep.join((os.environ.get("PYTHONPATH", ""), str(ROOT)))
    arguments = ("-c", STRANGER, json.dumps(PROMISED), LATCHED)
    stranger = launcher.start("stranger", sys.executable, *arguments, PYTHONPATH=path)
    intruder = start(tmp_path / "intruder", "demo")
    assert intruder.wait(RUN_TIMEOUT_S) == 2
    assert f"in use by process {runner.popen.pid} (iptm.commands.run" in intruder.stderr
    assert not (tmp_path / "intruder").exists()
    assert stranger.wait(RUN_TIMEOUT_S) == 0, stranger.stderr
    report = json.loads(stranger.stdout)
    assert [name for name, count in report["counts"].items() if not count] == []
    assert report["seen"] == {name: [type_name] for name, type_name in PROMISED.items()}
    assert runner.is_running

    # A terminal sends Ctrl-C to everybody, and users press it twice.
    for _ in range(2):
        os.killpg(runner.popen.pid, signal.SIGINT)
    assert runner.wait() == 130
    assert "stopped by SIGINT" in runner.stderr
    assert "Traceback" not in runner.stdout + runner.stderr
    assert all_gone(processes)
    trajectory = read_trajectory(output)
    assert len(trajectory) > 10
    with BagReader(output) as reader:
        (last,) = [item.message for item in reader.messages(["/clock"])][-1:]
    assert ns_from_time(last.clock) >= 1_000_000_000 * int(trajectory.time_s[-1])


def test_a_mistake_that_only_a_node_can_report_is_one_line(start: Start, tmp_path: Path) -> None:
    runner = start(tmp_path / "run", "--set", "controller.tolerence=1e-4")
    assert runner.wait(RUN_TIMEOUT_S) == 2
    (line,) = runner.stderr.splitlines()
    assert line.startswith("iptm run: ")
    assert "did you mean 'tolerance'?" in line
    assert not (tmp_path / "run").exists()
