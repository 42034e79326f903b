"""The command lines of README, docs, `--help` and docstrings work as they are written.

Each runs in a folder of its own that looks like a checkout. `documented_rules` holds how, and why some are
not executed. Those that take long are marked `slow`. The first command line of `scripts/iptm` is run by the
shell, further ones in the process of the test.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState
from tests.documented_commands import ROOT, documented_commands
from tests.integration.documented_rules import RULES, Rule, Way, rule_for

from iptm.commands.run import build_parser, chosen_trip
from iptm.commands.tree import main
from iptm_ros.discovery import reserve_domain
from iptm_ros.graph_client import GraphClient

COMMANDS = documented_commands()
EXAMPLE = ROOT / "bags" / "example_us06_120s"
HOW_TO = ROOT / "docs" / "how-to" / "README.md"
TIMEOUT_S = 200.0
EXECUTED_BY_DEFAULT = 50
BAGS = ("my_run", "run_a", "run_b", "gap_80", "gap_120", "demo_20260101_120000", EXAMPLE.name)
FCD = "".join(
    f'<timestep time="{second}"><vehicle id="leader" x="0" y="{8 * second}" speed="8" slope="0"/></timestep>'
    for second in range(30)
)
# What `ros2 service call` and `ros2 param set` do, for these two only: ros2cli is not among the wheels.
ROS2 = """#!/usr/bin/env python3
import sys, rclpy, yaml
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("stand_in")
group, verb, *given = sys.argv[1:]
if (group, verb) == ("service", "call"):
    name, kind = given
    assert kind == "std_srvs/srv/Trigger"
    client = node.create_client(Trigger, name)
    assert client.wait_for_service(120.0), name
    future = client.call_async(Trigger.Request())
    done = lambda: future.result().success
else:
    assert (group, verb) == ("param", "set")
    target, name, text = given
    client = AsyncParameterClient(node, target)
    assert client.wait_for_services(120.0), target
    future = client.set_parameters([Parameter(name, value=yaml.safe_load(text))])
    done = lambda: future.result().results[0].successful
rclpy.spin_until_future_complete(node, future, timeout_sec=120.0)
sys.exit(0 if done() else str(future.result()))
"""


def commands(*ways: Way) -> list[str]:
    """Return the documented command lines that are executed in one of these ways."""
    return [command for command in COMMANDS if _rule(command).way in ways]


def _rule(command: str) -> Rule:
    return rule_for(command) or Rule(Way.NOT, "", "no rule")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command lines read, by the names that they use."""
    folder = tmp_path_factory.mktemp("files")
    for name in ("scripts", "ros2_ws", "requirements", ".venv"):
        (folder / name).symlink_to(ROOT / name)
    drive = ROOT / "docs" / "examples" / "phone_drive.gpx"
    for name in ("my_drive.gpx", "drive.gpx"):
        shutil.copy(drive, folder / name)
    plan = re.sub("<time>.*?</time>", "", drive.read_text("utf-8"))
    (folder / "my_plan.gpx").write_text(plan, encoding="utf-8")
    speeds = "\n".join(f"{second},{min(second, 10)}" for second in range(30))
    for name in ("my_commute.csv", "my_drive.csv"):
        (folder / name).write_text(f"time_s,speed_m_s\n{speeds}\n", encoding="utf-8")
    (folder / "traffic.fcd.xml").write_text(f"<fcd-export>{FCD}</fcd-export>", encoding="utf-8")
    (folder / "qos.yaml").write_text("/plant/odometry: {reliability: best_effort, depth: 5}\n")
    (folder / "my.yaml").write_text("/**: {ros__parameters: {use_sim_time: false}}\n")
    blocks = re.findall(r"^```yaml\n(.*?)^```", HOW_TO.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    car, trip = blocks
    (folder / "my_car.yaml").write_text(car, encoding="utf-8")
    (folder / "my_trip.yaml").write_text(trip, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A ROS domain for the nodes of this file."""
    with reserve_domain() as number:
        yield number


class Place:
    """A folder that looks like a checkout, in which one command line runs."""

    def __init__(self, folder: Path, files: Path, domain: int) -> None:
        self.folder = folder
        self.out = folder / "out"
        self.domain = domain
        for path in files.iterdir():
            (folder / path.name).symlink_to(path)
        (folder / "bags").mkdir()
        for name in BAGS:
            (folder / "bags" / name).symlink_to(EXAMPLE)
        killed = folder / "bags" / "killed_run"
        killed.mkdir()
        data = next(EXAMPLE.glob("*.mcap")).read_bytes()
        (killed / "killed_run_0.mcap").write_bytes(data[: len(data) // 2])
        shutil.copytree(ROOT / "docs" / "examples", folder / "docs" / "examples")
        (folder / "bin").mkdir()
        (folder / "bin" / "ros2").write_text(ROS2, encoding="utf-8")
        (folder / "bin" / "ros2").chmod(0o755)

    def written(self, command: str) -> str:
        """Return a command line with its placeholders filled in."""
        text = command.replace(" BAG", f" bags/{EXAMPLE.name}").format(out=self.out)
        return text.replace("--domain 42", f"--domain {self.domain}")

    def start(self, command: str, extra: str = "") -> subprocess.Popen[str]:
        """Start a command line with further options."""
        text = self.written(f"{command.removesuffix('&')} {extra}")
        for output in re.findall(r"(?:scripts/iptm record|--output) (bags/\S+)", text):
            (self.folder / output).unlink(missing_ok=True)
        return subprocess.Popen(
            ["bash", "-c", text],
            cwd=self.folder,
            env={
                **os.environ,
                "PATH": f"{self.folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}",
                "ROS_DOMAIN_ID": str(self.domain),
                "ROS_LOG_DIR": str(self.folder / "log"),
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def run_here(self, command: str, capfd: pytest.CaptureFixture[str]) -> str:
        """Run a command of `iptm` in this process; return what it printed."""
        arguments = shlex.split(command)[1:]
        capfd.readouterr()
        with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
            warnings.simplefilter("default")
            patch.chdir(self.folder)
            patch.setenv("ROS_DOMAIN_ID", str(self.domain))
            patch.setattr(sys, "argv", sys.argv)
            code, printed = main(arguments), "".join(capfd.readouterr())
            deadline_s = time.monotonic() + TIMEOUT_S
            # The controller refuses a change while it compiles that of an earlier command.
            while "another change" in printed and time.monotonic() < deadline_s:
                time.sleep(0.2)
                code, printed = main(arguments), "".join(capfd.readouterr())
        assert code == 0, f"{command}\n{printed}"
        return printed

    def run(self, command: str, extra: str = "") -> str:
        """Run a command line to its end; return what it printed."""
        with self.start(command, extra) as process:
            try:
                printed, _ = process.communicate(timeout=TIMEOUT_S)
            finally:
                end_group(process)
        assert process.returncode == 0, f"{command}\n{printed}"
        assert "Traceback" not in printed
        return printed


def end_group(process: subprocess.Popen[str]) -> None:
    """End whatever a command line has left running."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return


Run = Callable[[Place, str, str], str]


@pytest.fixture(scope="module")
def shell_runs() -> list[str]:
    """Command lines of `scripts/iptm` that were run by the shell."""
    return []


@pytest.fixture
def run(shell_runs: list[str], capfd: pytest.CaptureFixture[str]) -> Run:
    """Run a command line in a place, with further options."""

    def run_command(place: Place, command: str, extra: str = "") -> str:
        is_iptm = command.startswith("scripts/iptm ")
        if is_iptm and shell_runs and not re.search(r"[*&|$]|--help", command):
            return place.run_here(place.written(f"{command} {extra}"), capfd)
        shell_runs.extend([command] if is_iptm else [])
        return place.run(command, extra)

    return run_command


@pytest.fixture
def place(tmp_path: Path, files: Path, domain: int) -> Place:
    return Place(tmp_path, files, domain)


def test_every_command_line_is_executed_or_there_is_a_reason() -> None:
    without = [f"{file}: {command}" for command, file in COMMANDS.items() if not rule_for(command)]
    assert without == [], "add a rule to documented_rules.py"
    used = {rule_for(command) for command in COMMANDS}
    assert [rule for rule in RULES if rule not in used] == []
    counts = Counter(_rule(command).way for command in COMMANDS)
    by_default = sum(
        counts[way] for way in (Way.RUN, Way.ASK, Way.RECORD, Way.PREPARE, Way.ELSEWHERE)
    )
    slow = counts[Way.SERVE] + counts[Way.DRIVE]
    print(f"{len(COMMANDS)} command lines: {by_default} executed by default, {slow} with -m slow")
    for command in commands(Way.NOT):
        print(f"not executed ({_rule(command).extra}): {command}")
    assert by_default >= EXECUTED_BY_DEFAULT


@pytest.mark.parametrize("command", commands(Way.RUN))
def test_command_runs(command: str, place: Place, run: Run) -> None:
    run(place, command, _rule(command).extra)


def test_python_of_the_how_to_runs(place: Place) -> None:
    """The snippet that reads exported tables, behind the commands that export them."""
    page = HOW_TO.read_text(encoding="utf-8")
    (snippet,) = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    exports = re.findall(r"^scripts/iptm export .*parquet", page, re.MULTILINE)
    (place.folder / "snippet.py").write_text(
        f"{snippet}\nprint(both.num_rows, len(parameters) > 0)"
    )
    printed = place.run(" && ".join([*exports, "python snippet.py"]))
    assert printed.endswith("121 True\n")


@pytest.fixture(scope="module")
def ring(files: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """Nodes to talk to: a trip that goes on, one in a namespace, a recorder and a player."""
    with reserve_domain() as domain:
        place = Place(tmp_path_factory.mktemp("ring"), files, domain)
        forever = "-p duration_s:=1e6 -p mode:=real_time -p rate_factor:=5.0"
        car_1 = "-r __ns:=/car_1"
        short = "-p horizon:=3x1"
        module = "python -m iptm_core"
        started = [
            place.start(f"{module} {text}")
            for text in (
                "iptm_ros.recording.recorder_cli recorded --start-paused",
                "iptm_bags.player_cli BAG --loop --topics controller/plan",
                "iptm_v2x_bridge.node",
                f"iptm_controller.node --ros-args {short}",
                f"iptm_controller.node --ros-args {short} {car_1}",
                f"iptm_plant_sim.node --ros-args {forever}",
                f"iptm_plant_sim.node --ros-args -p start_paused:=true {car_1}",
            )
        ]
        try:
            heard: list[JointState] = []
            with GraphClient(domain, TIMEOUT_S) as client:
                client.node.create_subscription(JointState, "/controller/command", heard.append, 10)
                assert client.wait(lambda: len(heard) > 2), "the trip does not start"
                for name in ("recorder", "player", "car_1/plant", "car_1/controller"):
                    client.find(name)
            yield place
        finally:
            for process in started:
                end_group(process)
                process.communicate()


@pytest.mark.parametrize("command", commands(Way.ASK))
def test_command_beside_running_nodes(command: str, ring: Place, run: Run) -> None:
    printed = run(ring, command, "")
    assert printed or command.startswith("ros2 ")
    if re.search(r"plant reset|/plant/pause", command):
        # A change of a controller waits for a tick, so the next command may need a plant that runs.
        run(ring, "scripts/iptm call plant resume", "")


@pytest.mark.parametrize("command", commands(Way.PREPARE))
def test_trip_of_a_command_is_prepared(
    command: str, place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What its options mean is tested elsewhere; files and names that it gives are read."""
    monkeypatch.chdir(place.folder)
    trip = chosen_trip(build_parser().parse_args(shlex.split(command)[1:]))
    assert trip.route.duration_s > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("command", commands(Way.DRIVE))
def test_command_drives(command: str, place: Place) -> None:
    place.run(command, _rule(command).extra)


@pytest.mark.parametrize(
    "command",
    [
        *commands(Way.RECORD),
        *(pytest.param(command, marks=pytest.mark.slow) for command in commands(Way.SERVE)),
    ],
)
def test_command_serves_until_ctrl_c(command: str, place: Place) -> None:
    rule = _rule(command)
    process = place.start(f"exec {command}", rule.extra)
    try:
        if rule.node:
            with GraphClient(place.domain, TIMEOUT_S) as client:
                client.wait(
                    lambda: (
                        process.poll() is not None
                        or any(name.endswith(f"/{rule.node}") for name in client.nodes())
                    )
                )
        else:
            assert process.stdout is not None
            lines = iter(process.stdout.readline, "")
            assert any("http://" in line for line in lines), command
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=TIMEOUT_S)
    finally:
        end_group(process)
        process.communicate()
    assert process.returncode == 0, printed
    assert "Traceback" not in printed
