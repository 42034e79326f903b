"""Fixtures for tests with real processes over DDS.

Every test gets a ROS domain of its own, processes whose output is kept, and conditions that are
awaited with a timeout. Nothing here sleeps for a fixed time and hopes.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_srvs.srv import Trigger
from tests.integration.controller_ticks import ROAD, SMALL, assert_hears
from tests.integration.node_bench import NodeBench, node_bench
from tests.waiting import PATIENCE_S, POLL_S, wait_until

from iptm_controller.node import ControllerNode
from iptm_core.program import StopRequest
from iptm_ros.codecs import encode_slope
from iptm_ros.connections import Meeting, StartSignal
from iptm_ros.diagnostics import find_status, status_values
from iptm_ros.discovery import middleware_settings, reserve_domain
from iptm_ros.process import joined_node
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

STOP_TIMEOUT_S = 60.0
LISTENED_S = 2.0
"""Wall time for which a test that has failed listens to the diagnostics of all nodes."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark everything in folders of this name, so that `-m "not integration"` leaves it out.

    Real processes share a machine with whatever else runs there: what fails is run once more, and the summary
    lists it as RERUN.
    """
    for item in items:
        if item.path.parent.name == "integration":
            item.add_marker(pytest.mark.integration)
            item.add_marker(pytest.mark.flaky(reruns=1))


@dataclass
class ManagedProcess:
    """A started process and its logs, which are files that can be read at any time."""

    name: str
    popen: subprocess.Popen[bytes]
    stdout_path: Path
    stderr_path: Path

    @property
    def stdout(self) -> str:
        return self.stdout_path.read_text(errors="replace")

    @property
    def stderr(self) -> str:
        return self.stderr_path.read_text(errors="replace")

    @property
    def is_running(self) -> bool:
        return self.popen.poll() is None

    def send(self, number: signal.Signals) -> None:
        if self.is_running:
            self.popen.send_signal(number)

    def wait(self, timeout_s: float = STOP_TIMEOUT_S) -> int:
        """Return the exit code; fail the test if the process does not end."""
        wait_until(lambda: not self.is_running, timeout_s, f"end of {self.name}\n{self.stderr}")
        return int(self.popen.returncode)

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Ask the process to end, twice as users press Ctrl-C; return its exit code."""
        self.send(number)
        self.send(number)
        code = self.wait()
        assert "Traceback" not in self.stderr
        return code


@dataclass
class ProcessLauncher:
    """Starts processes in the domain of the test and cleans up after it."""

    directory: Path
    environment: Mapping[str, str]
    processes: list[ManagedProcess] = field(default_factory=list)

    def start(self, name: str, *command: str | Path, **environment: str) -> ManagedProcess:
        """Start any command; its output goes to files named after it."""
        index = len(self.processes)
        stdout_path = self.directory / f"{index}_{name}.out"
        stderr_path = self.directory / f"{index}_{name}.err"
        with stdout_path.open("wb") as out, stderr_path.open("wb") as err:
            popen = subprocess.Popen(
                [str(part) for part in command],
                stdout=out,
                stderr=err,
                stdin=subprocess.DEVNULL,
                env={**self.environment, **environment},
                cwd=self.directory,
                start_new_session=True,
            )
        process = ManagedProcess(name, popen, stdout_path, stderr_path)
        self.processes.append(process)
        return process

    def start_module(
        self, module: str, *arguments: str | Path, name: str = "", **environment: str
    ) -> ManagedProcess:
        """Start a module of the suite with `python -m`."""
        name = name or module.split(".", maxsplit=1)[0]
        return self.start(name, sys.executable, "-m", module, *arguments, **environment)

    def start_node(
        self, module: str, *arguments: str, parameters: Mapping[str, object] | None = None
    ) -> ManagedProcess:
        """Start a node of the suite by its module, with further ROS arguments, e.g. `-r`, `__ns:=/car_1`."""
        return self.start_module(module, "--ros-args", *_overrides(parameters or {}), *arguments)

    def close(self) -> None:
        """End whatever still runs, politely first, and show all logs (kept by pytest on failure)."""
        running = [process for process in self.processes if process.is_running]
        for process in running:
            process.popen.send_signal(signal.SIGINT)
        deadline = time.monotonic() + STOP_TIMEOUT_S / 6.0
        while any(process.is_running for process in running) and time.monotonic() < deadline:
            time.sleep(POLL_S)
        for process in running:
            if process.is_running:
                os.killpg(process.popen.pid, signal.SIGKILL)
                process.popen.wait()
        for process in self.processes:
            for kind, text in (("stdout", process.stdout), ("stderr", process.stderr)):
                if text:
                    print(f"--- {process.name} {kind}\n{text}")


def _overrides(parameters: Mapping[str, object]) -> list[str]:
    return [
        part
        for name, value in parameters.items()
        for part in ("-p", f"{name}:={_yaml_scalar(value)}")
    ]


def _yaml_scalar(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"'{value}'" if isinstance(value, (str, Path)) else str(value)


@pytest.fixture(name="wait_until")
def wait_until_fixture() -> Callable[..., None]:
    """Wait for a condition with a timeout."""
    return wait_until


@contextmanager
def own_domain(folder: Path) -> Iterator[dict[str, str]]:
    """Reserve a domain; yield what sets it for a process, with fast discovery and checked fields."""
    with reserve_domain() as domain:
        yield {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_PYTHON_CHECK_FIELDS": "1",
            "ROS_LOG_DIR": str(folder / "ros_log"),
            **middleware_settings({}),
        }


@pytest.fixture
def ros_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, str]]:
    """Give the test and its processes a domain of their own."""
    with own_domain(tmp_path) as settings:
        for name, value in settings.items():
            monkeypatch.setenv(name, value)
        yield {**os.environ, **settings}


@pytest.fixture
def launcher(ros_environment: dict[str, str], tmp_path: Path) -> Iterator[ProcessLauncher]:
    """Start processes in the domain of the test."""
    processes = ProcessLauncher(tmp_path, ros_environment)
    yield processes
    processes.close()


@pytest.fixture
def refused(
    ros_environment: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Callable[..., str]:
    """Run a program in this process; check that it ends with a usage error, and return that one line."""
    del ros_environment
    # What is not refused stops as soon as it runs.
    monkeypatch.setattr(StopRequest, "install", lambda stop: setattr(stop, "number", signal.SIGINT))
    monkeypatch.chdir(tmp_path)

    def run(
        module: str, *arguments: str | Path, parameters: Mapping[str, object] | None = None
    ) -> str:
        program = import_module(module)
        overrides = ["--ros-args", *_overrides(parameters)] if parameters else []
        command = [program.__file__, *(str(part) for part in arguments), *overrides]
        monkeypatch.setattr(sys, "argv", command)
        capfd.readouterr()
        with warnings.catch_warnings():
            # Programs leave it to the end of their process to close files.
            warnings.simplefilter("ignore", ResourceWarning)
            try:
                code = program.main()
            except SystemExit as end:
                code = end.code
            gc.collect()
        error = capfd.readouterr().err
        assert code == 2, error
        (line,) = error.strip().splitlines()
        return str(line)

    return run


@dataclass
class Peer:
    """A node of the test itself, spun only while the test waits, so nothing runs in parallel."""

    node: SuiteNode
    executor: object

    def wait_until(
        self,
        condition: Callable[[], object],
        timeout_s: float = PATIENCE_S,
        what: str = "condition",
    ) -> None:
        """Spin until a condition is true; fail the test, describing the graph, if that takes too long."""
        wait_until(condition, timeout_s, what, self._spin, self._described)

    def _spin(self, longest_s: float) -> None:
        self.executor.spin_once(timeout_sec=longest_s)  # type: ignore[attr-defined]

    def _described(self) -> str:
        """Return the nodes of the graph, their newest statuses, and the connections of own topics."""
        newest: dict[str, str] = {}

        def take(message: DiagnosticArray) -> None:
            for status in message.status:
                newest[status.name] = f"{status.message} {status_values(status)}"

        self.node.listen(Topic.DIAGNOSTICS, take)
        until_s = time.monotonic() + LISTENED_S
        while time.monotonic() < until_s:
            self._spin(POLL_S)
        own = {
            **{
                f"{each.topic_name} ->": each.get_subscription_count()
                for each in self.node.publishers
            },
            **{
                f"{each.topic_name} <-": each.get_publisher_count()
                for each in self.node.subscriptions
            },
        }
        nodes = sorted(self.node.get_node_names_and_namespaces())
        lines = [f"nodes: {nodes}", f"own topics: {own}", *(f"{k}: {v}" for k, v in newest.items())]
        return "\n".join(lines)

    def meet(self, *names: str) -> None:
        """Wait until nodes, given by name, and this one hear each other: no message is lost from here on."""
        own = self.node.get_fully_qualified_name()
        meeting = Meeting(self.node, (own, *(f"/{name}" for name in names)))

        def is_complete() -> bool:
            self.node.connections.look()
            return meeting.is_complete

        self.wait_until(is_complete, what=f"{names} to hear each other")

    def begin(self, *names: str, timeout_s: float = PATIENCE_S) -> None:
        """Have the plant begin as soon as nodes, given by name, and this one hear each other."""
        own = self.node.get_fully_qualified_name()
        signal = StartSignal(self.node, (own, *(f"/{name}" for name in names)), "/plant")
        self.wait_until(signal.give, timeout_s, "the trip to begin")

    def call(self, service: str) -> Trigger.Response:
        """Call a service, given by its full name, and return the answer."""
        client = self.node.create_client(Trigger, service)
        self.wait_until(client.service_is_ready, what=service)
        future = client.call_async(Trigger.Request())
        self.wait_until(future.done, what=f"the answer of {service}")
        self.node.destroy_client(client)
        return future.result()

    def statuses(self, name: str) -> list[DiagnosticStatus]:
        """Return a list that grows with every diagnostic status of a node, given by its full name."""
        heard: list[DiagnosticStatus] = []

        def take(message: DiagnosticArray) -> None:
            status = find_status(message, name)
            if status is not None:
                heard.append(status)

        self.node.listen(Topic.DIAGNOSTICS, take)
        return heard


@contextmanager
def joined_peer(domain: int, name: str = "test_peer", *arguments: str) -> Iterator[Peer]:
    """Take part in a domain with a node of the test; the arguments are those of ROS, such as `-r`."""
    ros = ["--ros-args", *arguments]
    with joined_node(
        lambda context: SuiteNode(name, context=context, cli_args=ros), domain
    ) as joined:
        yield Peer(*joined)


@pytest.fixture
def peer(ros_environment: dict[str, str]) -> Iterator[Peer]:
    """Take part in the graph of the test with a node called `test_peer`."""
    with joined_peer(int(ros_environment["ROS_DOMAIN_ID"])) as joined:
        yield joined


@pytest.fixture
def fresh() -> Iterator[NodeBench]:
    """A controller with a small horizon that knows nothing yet; the test uses `ros_environment`."""
    with node_bench(ControllerNode, **SMALL) as bench:
        yield bench


@pytest.fixture
def controller(fresh: NodeBench) -> NodeBench:
    """One that knows the road."""
    fresh.hear({Topic.SLOPE: encode_slope(ROAD)})
    return fresh


@pytest.fixture
def driving(controller: NodeBench) -> NodeBench:
    """One in the middle of a trip."""
    assert_hears(controller, 500, 501, 502)
    return controller
