"""A scripted controller for tests of the plant, and the start of a plant as a process."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from iptm_core.state import Command, VehicleState
from iptm_interfaces.codecs import decode_vehicle_state, encode_command, ns_from_time
from iptm_interfaces.diagnostics import status_values
from iptm_interfaces.services import Service
from iptm_interfaces.topics import STATE_TOPICS, Topic

MODULE = "iptm_plant_sim.node"
S = 1_000_000_000
OTHER_TOPICS = (
    Topic.PLANT_BATTERY,
    Topic.PLANT_COOLANT_INLET_TEMPERATURE,
    Topic.PLANT_COOLANT_OUTLET_TEMPERATURE,
)
Script = Callable[[int], Command | None]


def lively(tick: int) -> Command:
    """Start, speed up, brake to a stop, start again."""
    return Command(1.2 * math.sin(tick / 9.0) - 0.1, 1000.0 + 900.0 * math.sin(tick / 5.0))


class Driver:
    """A scripted controller that answers every clock, and records all messages of the plant."""

    def __init__(self, peer: Any, script: Script) -> None:
        self.peer = peer
        self.script = script
        self.messages: dict[Topic, dict[int, Any]] = {
            topic: {} for topic in (*STATE_TOPICS, *OTHER_TOPICS)
        }
        self.ticks: list[int] = []
        self.missing_at_clock: list[int] = []
        self.statuses = peer.statuses("/plant")
        node = peer.node
        self.commands = node.advertise(Topic.COMMAND)
        for topic, heard in self.messages.items():
            node.listen(
                topic, lambda message, heard=heard: heard.update({_stamp(message): message})
            )
        node.listen(Topic.CLOCK, self._on_clock)

    def _on_clock(self, message: Clock) -> None:
        stamp_ns = ns_from_time(message.clock)
        self.ticks.append(stamp_ns)
        command = self.script(stamp_ns // S)
        if command is not None:
            self.send(stamp_ns, command)

    def send(self, stamp_ns: int, command: Command) -> None:
        self.commands.publish(encode_command(stamp_ns, command))

    def state(self, stamp_ns: int) -> VehicleState:
        return decode_vehicle_state(
            {topic: self.messages[topic][stamp_ns] for topic in STATE_TOPICS}
        )

    def has_all(self, stamp_ns: int) -> bool:
        """Whether all of a tick has arrived that the plant makes sure of: the state and the clock."""
        return stamp_ns in self.ticks and all(
            stamp_ns in self.messages[topic] for topic in STATE_TOPICS
        )

    def wait(self, condition: Callable[[], object], what: str) -> None:
        self.peer.wait_until(condition, what=what)

    def end(self, process: Any) -> int:
        """Listen to the last words of the plant and return its exit code."""
        self.wait(lambda: self.phases()[-1:] == ["finished"], "the report of the end")
        self.wait(lambda: not process.is_running, "the end of the plant")
        return int(process.wait())

    def values(self) -> dict[str, str]:
        """Key values of the latest diagnostics of the plant."""
        return status_values(self.statuses[-1]) if self.statuses else {}

    def reasons(self) -> list[str]:
        return [status.message for status in self.statuses]

    def phases(self) -> list[str]:
        return [status_values(status)["phase"] for status in self.statuses]


def _stamp(message: Any) -> int:
    return ns_from_time(message.header.stamp)


def start(launcher: Any, *arguments: str, **parameters: object) -> Any:
    defaults: dict[str, object] = {"cycle": "nycc", "slope": "large", "linger_s": 0.5}
    return launcher.start_node(MODULE, *arguments, parameters={**defaults, **parameters})


def call(peer: Any, service: Service) -> Any:
    """Call a service of the suite and return its answer."""
    client = peer.node.create_client(Trigger, service.value)
    peer.wait_until(client.service_is_ready, what=f"{service.value} offered")
    future = client.call_async(Trigger.Request())
    peer.wait_until(future.done, what=f"an answer of {service.value}")
    peer.node.destroy_client(client)
    return future.result()
