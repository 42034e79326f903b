"""Loads the bridge with the messages of a crowd: does it lose any, and what does it cost?

The node runs by the computer's clock, as with a radio. Two hundred cars behind the ego vehicle send ten
messages a second each, in bursts of two hundred, and the leader sends its own among them. A flood of maps of
intersections may come on top, half of them from one station and each of the others from another one, and
closed loops in real time may take their share of the processor.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from iptm.runner.supervisor import environment_of_run, process_environment
from iptm_core.errors import ScenarioError
from iptm_core.routes.road_line import RoadLine
from iptm_its.mapem import IntersectionMap, Lane, encode_mapem
from iptm_ros.codecs import ns_from_time, time_from_s
from iptm_ros.connections import Meeting
from iptm_ros.diagnostics import find_status, status_values
from iptm_ros.discovery import reserve_domain
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic
from iptm_v2x_bridge.messages.cam import encode_cam
from iptm_v2x_bridge.messages.packets import delta_time_ms, its_timestamp_ms
from iptm_v2x_bridge.sender import car_on_road

BURST_S = 0.1
LEADER = 4711
SPEED_M_S = 10.0
MAPS = 200
"""Different maps in a flood."""
LANES, NODES = 21, 16
"""Of each map, which then has 1.3 kB."""
START_TIMEOUT_S = 120.0
READ_TIMEOUT_S = 60.0
"""Time until the diagnostics report all datagrams as read; the others count as lost."""


class _Ego:
    """Clock and place of the ego vehicle, and ears for the bridge."""

    def __init__(self, context: Context) -> None:
        self.node = SuiteNode("v2x_load", context=context)
        self._meeting = Meeting(self.node, ("/v2x_load", "/v2x_bridge"))
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._clock = self.node.advertise(Topic.CLOCK)
        self._state = self.node.advertise(Topic.PLANT_STATE)
        self.values: dict[str, str] = {}
        self.leaders = 0
        self._ticked_s: dict[int, float] = {}
        self.answered_after_s: dict[int, float] = {}
        self.node.listen(Topic.DIAGNOSTICS, self._on_diagnostics)
        self.node.listen(Topic.LEADER, self._on_leader)
        self.node.listen(Topic.LEADER_PREVIEW, self._on_preview)

    def _on_leader(self, _: Any) -> None:
        self.leaders += 1

    def _on_preview(self, message: Any) -> None:
        at_ns = ns_from_time(message.header.stamp)
        self.answered_after_s[at_ns] = time.monotonic() - self._ticked_s[at_ns]

    def _on_diagnostics(self, message: Any) -> None:
        status = find_status(message, "/v2x_bridge")
        if status is not None:
            self.values = status_values(status)

    def wait(self, reached: Callable[[], bool], timeout_s: float) -> bool:
        """Spin until a condition holds; return whether it does."""
        until_s = time.monotonic() + timeout_s
        while not reached() and time.monotonic() < until_s:
            self.spin(0.05)
        return reached()

    def has_bridge(self) -> bool:
        """Return whether bridge and this node hear each other, and its first report is there."""
        return bool(self._meeting.is_complete and self.values)

    def tick(self, second: int) -> None:
        message = JointState(
            name=["position_m", "speed_m_s"], position=[SPEED_M_S * second, SPEED_M_S]
        )
        message.header.stamp = time_from_s(float(second))
        self._state.publish(message)
        self._ticked_s[ns_from_time(message.header.stamp)] = time.monotonic()
        self._clock.publish(Clock(clock=time_from_s(float(second))))

    def spin(self, duration_s: float) -> None:
        until_s = time.monotonic() + duration_s
        while (left_s := until_s - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left_s)


def processor_s(process: subprocess.Popen[bytes]) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def bursts(cars: int, seconds: int) -> list[list[bytes]]:
    """Return the messages of all cars, burst by burst, without the time of generation."""
    road = RoadLine.test_road()
    found = []
    for burst in range(round(seconds / BURST_S)):
        ego_m = SPEED_M_S * burst * BURST_S
        places = {10_000 + number: ego_m - 20.0 - 10.0 * number for number in range(cars)}
        places[LEADER] = ego_m + 20.0
        found.append(
            [
                encode_cam(car_on_road(road, identity, 0, rear_m, SPEED_M_S))
                for identity, rear_m in places.items()
            ]
        )
    return found


def flood(maps: int) -> Iterator[bytes]:
    """Yield at most MAPS different maps cyclically."""
    latitude, longitude, _ = (float(value) for value in RoadLine.test_road().locate(500.0))
    nodes = [tuple((0.1 * lane, -10.0 * node) for node in range(NODES)) for lane in range(LANES)]
    lanes = tuple(Lane(number, places, leads_in=True) for number, places in enumerate(nodes))
    places = [(latitude + 1e-5 * number, number) for number in range(min(maps, MAPS))]
    encoded = [
        encode_mapem(1, [IntersectionMap((0, number), 0, place, longitude, lanes)])
        for place, number in places
    ]
    # The identity of the station follows the first two bytes of the header.
    return (
        payload if number % 2 else payload[:2] + number.to_bytes(4, "big") + payload[6:]
        for number, payload in enumerate(cycle(encoded))
    )


def load(
    ego: _Ego, port: int, bursts_of_cars: list[list[bytes]], maps: Iterator[bytes], each: int
) -> int:
    """Send all bursts at real time, each with `each` maps; return the number of datagrams."""
    sent = 0
    begin_s, begin_ms = time.monotonic(), its_timestamp_ms(time.time_ns())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        for burst, messages in enumerate(bursts_of_cars):
            if burst % round(1.0 / BURST_S) == 0:
                ego.tick(round(burst * BURST_S))
            # The time of generation follows the six bytes of the header.
            delta = delta_time_ms(begin_ms + round(1000.0 * burst * BURST_S)).to_bytes(2, "big")
            for _ in range(each):
                radio.sendto(next(maps), ("127.0.0.1", port))
            for message in messages:
                radio.sendto(message[:6] + delta + message[8:], ("127.0.0.1", port))
            sent += len(messages) + each
            ego.spin(max(begin_s + (burst + 1) * BURST_S - time.monotonic(), 1e-3))
    return sent


@contextmanager
def closed_loop_beside(seconds: int) -> Iterator[None]:
    """Drive a trip in real time in other processes, for a time or until the end of the context."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "run"
        command = [
            sys.executable,
            "-m",
            "iptm.commands.run",
            "real_time",
            "--no-picture",
        ]
        options = ["--output", str(output), "--duration-s", str(seconds)]
        trip = subprocess.Popen(  # noqa: S603 - the project's own
            [*command, *options], stdout=subprocess.DEVNULL
        )
        try:
            until_s = time.monotonic() + START_TIMEOUT_S
            while not list(output.glob("*.mcap")):
                if trip.poll() is not None or time.monotonic() > until_s:
                    raise ScenarioError("the closed loop beside the bridge does not start")
                time.sleep(0.1)
            yield
            if trip.poll() is not None:
                raise ScenarioError("the closed loop beside the bridge ended early")
        finally:
            trip.terminate()
            trip.wait()


def measure(
    cars: int = 200, seconds: int = 20, maps_per_s: int = 0, loops_beside: int = 0
) -> dict[str, Any]:
    """Load a bridge.

    Args:
        cars: of the crowd, ten messages a second each.
        seconds: of real time.
        maps_per_s: maps of 1.3 kB that flood the radio.
        loops_beside: closed loops in real time in other processes meanwhile.

    Raises:
        ScenarioError: the bridge does not come up.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = int(taken.getsockname()[1])
    with ExitStack() as stack:
        for _ in range(loops_beside):  # before the domain of this one is in the environment
            stack.enter_context(closed_loop_beside(seconds + 120))
        domain = stack.enter_context(reserve_domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        environment = environment_of_run(domain, folder)
        stack.enter_context(process_environment(environment))
        given = ["leader_source:=cam", f"cam_port:={port}", "cam_lock_step:=false"]
        given += ["roadside_messages:=true"] if maps_per_s else []
        parameters = [
            part for text in (*given, "trip_start_timestamp_ms:=-1") for part in ("-p", text)
        ]
        command = [sys.executable, "-m", "iptm_v2x_bridge.node", "--ros-args", *parameters]
        bridge = subprocess.Popen(command, env=environment)  # noqa: S603 - the project's own
        context = Context()
        context.init(args=[], domain_id=domain)
        ego = _Ego(context)
        try:
            if not ego.wait(ego.has_bridge, START_TIMEOUT_S):
                raise ScenarioError(f"no bridge within {START_TIMEOUT_S:g} s")
            bursts_of_cars, maps = bursts(cars, seconds), flood(maps_per_s)
            before_s, begin_s = processor_s(bridge), time.monotonic()
            sent = load(ego, port, bursts_of_cars, maps, round(maps_per_s * BURST_S))
            used_s, lasted_s = processor_s(bridge) - before_s, time.monotonic() - begin_s
            ego.wait(lambda: int(ego.values.get("datagrams", 0)) >= sent, READ_TIMEOUT_S)
        finally:
            bridge.terminate()
            bridge.wait()
            ego.node.destroy_node()
            context.try_shutdown()
    return {
        "datagrams_per_s": sent / lasted_s,
        "sent": sent,
        "read": int(ego.values.get("datagrams", 0)),
        "accepted": int(ego.values.get("messages_accepted", 0)),
        "refused": {
            name.removeprefix("rejected_"): int(count)
            for name, count in ego.values.items()
            if name.startswith("rejected_")
        },
        "stations": int(ego.values.get("stations", 0)),
        "leader": ego.values.get("leader_station"),
        "ticks": seconds,
        "ticks_with_a_leader": ego.leaders,
        "ticks_answered": len(ego.answered_after_s),
        "slowest_answer_s": max(ego.answered_after_s.values(), default=float("inf")),
        "cams_sent": sum(len(messages) for messages in bursts_of_cars),
        "maps_per_s": maps_per_s,
        "maps_accepted": int(ego.values.get("mapem_accepted", 0)),
        "loops_beside": loops_beside,
        "share_of_a_core": used_s / lasted_s,
    }


def as_text(numbers: dict[str, Any]) -> dict[str, str]:
    """Return what became of the messages in a sentence or two."""
    core = f"at {100.0 * numbers['share_of_a_core']:.0f} % of a processor core"
    if not numbers["maps_per_s"]:
        first = numbers["ticks"] - numbers["ticks_with_a_leader"]
        return {
            "load": (
                f"The node under {numbers['datagrams_per_s']:.0f} datagrams a second of "
                f"{numbers['stations']} cars for {numbers['ticks']} s: {numbers['read']} of "
                f"{numbers['sent']} read, {numbers['accepted']} accepted, {core}. Ticks without a leader, "
                f"which has to be heard for a moment first: {first}."
            )
        }
    return {
        "flood": (
            f"A flood of {numbers['maps_per_s']} maps of 1.3 kB a second for {numbers['ticks']} s on top of "
            f"{10 * numbers['stations']} messages of cars a second, beside {numbers['loops_beside']} closed "
            f"loop in real time: {numbers['accepted']} of {numbers['cams_sent']} messages of cars accepted, "
            f"{numbers['ticks_answered']} of {numbers['ticks']} ticks answered, the slowest after "
            f"{1e3 * numbers['slowest_answer_s']:.0f} ms, {core}. {numbers['refused'].get('waited', 0)} maps "
            "were dropped while others were decoded."
        )
    }
