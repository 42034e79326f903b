"""Start of the controller process: time to the first command with a warm and a cold cache, and memory.

The process is started as a user starts it and is fed one scripted state over DDS. The time runs from
the start of the process to the arrival of its command.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor

from benchmarks.harness import peak_memory_mib, run_benchmark
from iptm_bringup.environment import environment_of_run
from iptm_controller.ocp.compilation import CACHE_VARIABLE
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.state import IntervalPowers
from iptm_interfaces.codecs import (
    encode_acceleration,
    encode_capacity_loss,
    encode_host_odometry,
    encode_leader,
    encode_leader_preview,
    encode_powers,
    encode_slope,
    encode_temperature,
)
from iptm_interfaces.discovery import reserve_domain
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import V2xBridge
from iptm_v2x_bridge.source import CycleSource

POLL_S = 0.005
TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Start:
    """One start.

    Attributes:
        ready_s: from the start of the process until all its topics are matched.
        first_command_s: from the start of the process until its first command arrived.
        peak_memory_mib: largest resident memory of the process up to then.
    """

    ready_s: float
    first_command_s: float
    peak_memory_mib: float


def scripted_messages() -> dict[Topic, Any]:
    """Return the messages of the state at the start of a trip, and of the bridge."""
    parameters = load_parameters().values
    route = build_route("wltc_class3b", initial_gap_m=parameters.gap.initial_gap_m)
    source = CycleSource(route)
    answer = V2xBridge(source).answer(0)
    state = Plant(parameters, route.slope.slope_at).initial_state()
    powers = IntervalPowers(0.0, 0.0, parameters.cooling.auxiliary_power_w, 0.0, 0.0)
    return {
        Topic.SLOPE: encode_slope(source.slope_ahead()),
        Topic.PLANT_ACCELERATION: encode_acceleration(state),
        Topic.PLANT_CELL_1_TEMPERATURE: encode_temperature(0.0, state.cell_1_temperature_k),
        Topic.PLANT_CELL_N_TEMPERATURE: encode_temperature(0.0, state.cell_n_temperature_k),
        Topic.PLANT_POWERS: encode_powers(0.0, powers),
        Topic.PLANT_CAPACITY_LOSS: encode_capacity_loss(state),
        Topic.PLANT_ODOMETRY: encode_host_odometry(state),
        Topic.LEADER: encode_leader(answer.leader),
        Topic.LEADER_PREVIEW: encode_leader_preview(answer.preview, 0),
    }


@contextmanager
def _participant(domain: int) -> Iterator[tuple[SuiteNode, EventsExecutor]]:
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = SuiteNode("benchmark", context=context)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
        context.try_shutdown()


def start_once(cache: Path | None) -> Start:
    """Start the controller and wait for its first command.

    Args:
        cache: folder of compiled problems; None for the user's own.

    Raises:
        ScenarioError: the process ends, or no command arrives in time.
    """
    messages = scripted_messages()
    with tempfile.TemporaryDirectory() as folder, reserve_domain() as domain:
        environment = environment_of_run(domain, Path(folder))
        os.environ.update(environment)
        if cache is not None:
            environment[CACHE_VARIABLE] = str(cache)
        with _participant(domain) as (node, executor):
            publishers = {topic: node.advertise(topic) for topic in messages}
            commands: list[float] = []
            node.listen(Topic.COMMAND, lambda _: commands.append(time.perf_counter()))
            began = time.perf_counter()
            process = subprocess.Popen(
                [sys.executable, "-m", "iptm_controller.node"],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                _spin_until(
                    executor,
                    process,
                    lambda: all(p.get_subscription_count() for p in publishers.values()),
                    "its subscriptions",
                )
                ready = time.perf_counter()
                for topic, message in messages.items():
                    publishers[topic].publish(message)
                _spin_until(executor, process, lambda: commands, "its first command")
                memory = peak_memory_mib(process.pid)
            finally:
                process.terminate()
                process.wait(timeout=30)
    return Start(ready - began, commands[0] - began, memory)


def _spin_until(
    executor: EventsExecutor,
    process: subprocess.Popen[bytes],
    condition: Callable[[], object],
    what: str,
) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        if process.poll() is not None:
            raise ScenarioError(f"the controller ended with code {process.returncode}")
        if time.monotonic() > deadline:
            raise ScenarioError(f"the controller did not show {what} within {TIMEOUT_S:g} s")
        executor.spin_once(timeout_sec=POLL_S)


def measure(warm: int = 5, cold: int = 1) -> dict[str, Any]:
    """Start several times.

    Args:
        warm: starts, warm cache.
        cold: starts, empty cache.

    Raises:
        ScenarioError: a start fails.
    """
    start_once(None)  # fills the cache of compiled problems and of files
    warm_starts = [start_once(None) for _ in range(warm)]
    cold_starts = []
    for _ in range(cold):
        with tempfile.TemporaryDirectory() as folder:
            cold_starts.append(start_once(Path(folder)))
    return {"warm": _summary(warm_starts), "cold": _summary(cold_starts)}


def _summary(starts: Sequence[Start]) -> dict[str, float]:
    if not starts:
        return {}
    first = [start.first_command_s for start in starts]
    return {
        "starts": len(starts),
        "ready_median_s": float(np.median([start.ready_s for start in starts])),
        "first_command_median_s": float(np.median(first)),
        "first_command_max_s": float(np.max(first)),
        "peak_memory_mib": float(np.max([start.peak_memory_mib for start in starts])),
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
