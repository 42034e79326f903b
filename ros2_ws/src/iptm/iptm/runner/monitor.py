"""Monitor node of a run: keeps the serialised messages that the figures of a run need.

A lock-step run passes some thousand messages a second, and the runner must not take time from the
nodes. So messages stay bytes until the run is over; while it lasts, only the newest are decoded, a
few times a second, to show how far it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from iptm.runner.composition import RECORDER
from iptm_core.decision_record import DecisionRecord, Rung
from iptm_core.errors import MessageError
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.assembly import last_trip
from iptm_ros.codecs import (
    decode_decision_record,
    decode_motion,
    decode_observation,
    ns_from_s,
    numbers_of,
    stamp_ns_of,
    stamp_of,
)
from iptm_ros.connections import StartSignal
from iptm_ros.diagnostics import TRIP_TIME, Level, find_status, status_values
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import (
    BRIDGE,
    CONTROLLER,
    PLANT,
    TICK_TOPICS,
    TOPICS,
    Topic,
    full_name,
)

NAME = "run_monitor"
_RECENT_STATES = 20
_REPORTING = (PLANT, BRIDGE, CONTROLLER, RECORDER)
HEARD = (*TICK_TOPICS, Topic.SOLVE, Topic.COMMAND, Topic.CLOCK)

_DEPTH = 10_000  # the runner may be busy for a moment, the nodes do not wait for it
_NEEDED = (Topic.PLANT_STATE, Topic.CLOCK, Topic.LEADER, Topic.COMMAND)
"""Topics that a run requires, whichever node publishes them."""
_ONLY_ONE_PUBLISHES = (Topic.CLOCK, Topic.PLANT_STATE, Topic.LEADER, Topic.COMMAND)


@dataclass(frozen=True)
class Snapshot:
    """Where a run stands.

    Attributes:
        time_s: trip time.
        speed_m_s: of the ego vehicle.
        gap_m: to the leader, NaN while it is not known.
        cell_1_temperature_c: of the first cell.
        cell_n_temperature_c: of the last cell.
        solve_time_s: processor time of the latest solve.
        iterations: of the latest solve.
        rung: where the latest command comes from.
    """

    time_s: float
    speed_m_s: float
    gap_m: float
    cell_1_temperature_c: float
    cell_n_temperature_c: float
    solve_time_s: float
    iterations: int
    rung: Rung


class HeardStatus(NamedTuple):
    """A status of a node.

    Attributes:
        about_ns: trip time that it is about.
        node: name of the node.
        status: the status.
        clocks: number of clocks received before it; identifies the trip where there are several.
    """

    about_ns: int
    node: str
    status: DiagnosticStatus
    clocks: int


class RunMonitor(SuiteNode):
    """Listens to one run, from before its first message to after its last.

    Attributes:
        recorded: bytes of the messages by topic, in order of arrival.
        began_s: steady time of the start signal, or of the first clock without one; None before that clock.
        last_clock_s: steady time of the newest clock, None before the first.
        last_sign_s: steady time of the newest clock or diagnostics of the plant, else of the start.
        warnings: reasons that the nodes gave in their diagnostics since the first clock, worse than
            OK, once each.
        reports: every status of the nodes, in order of arrival.
        plant_reason: latest reason of the plant's diagnostics.
        start_signal: resumes the plant.

    Args:
        namespace: of the run.
        context: of the node.
        foreign: nodes that the user starts; of what they publish, only `_NEEDED` is waited for.
        members: full names of the other nodes that the trip waits for.
    """

    def __init__(
        self,
        namespace: str,
        context: Context,
        foreign: Collection[str] = frozenset(),
        members: Collection[str] = (),
    ) -> None:
        super().__init__(NAME, namespace=namespace, context=context)
        self._foreign = frozenset(foreign)
        self.start_signal = StartSignal(
            self,
            (*members, self.get_fully_qualified_name()),
            full_name(namespace, PLANT),
        )
        self.recorded: dict[Topic, list[bytes]] = {topic: [] for topic in HEARD}
        self.began_s: float | None = None
        self.last_clock_s: float | None = None
        self.last_sign_s = time.monotonic()
        self.warnings: dict[str, None] = {}
        self.reports: list[HeardStatus] = []
        self.plant_reason = ""
        self._diagnostics_count = 0
        self._started: set[str] = set(foreign)
        self._prefix = self.get_namespace().rstrip("/")
        self._marks = [f"{self._prefix}/{node}: ".encode() for node in _REPORTING]
        self.listen(Topic.DIAGNOSTICS, self._on_diagnostics, raw=True)
        for topic in HEARD:
            self._subscribe(topic)

    @property
    def awaited_nodes(self) -> tuple[str, ...]:
        """Nodes that do not publish all of their topics yet."""
        silent = (
            topic for topic in HEARD if self._is_awaited(topic) and not self._publisher_count(topic)
        )
        return tuple(dict.fromkeys(TOPICS[topic].publisher for topic in silent))

    @property
    def deaf_nodes(self) -> tuple[str, ...]:
        """Nodes that do not hear the nodes of the user yet."""
        needed = (TOPICS[topic] for topic in _NEEDED if TOPICS[topic].publisher in self._foreign)
        names = [self.resolve_topic_name(spec.name) for spec in needed]
        return self.start_signal.meeting.deaf_to(names)

    def _is_awaited(self, topic: Topic) -> bool:
        return topic in _NEEDED or TOPICS[topic].publisher not in self._foreign

    @property
    def crowded_topics(self) -> tuple[str, ...]:
        """Topics with more publishers than the run has: another run shares the domain."""
        return tuple(
            topic.value
            for topic in _ONLY_ONE_PUBLISHES
            if self._publisher_count(topic) > int(TOPICS[topic].publisher in self._started)
        )

    def is_doubled(self, node: str) -> bool:
        """Return whether more than one node of a name takes part, wherever its topics are remapped to."""
        return self.get_node_names_and_namespaces().count((node, self.get_namespace())) > 1

    def expect(self, nodes: Iterable[str]) -> None:
        """Take what nodes of these names publish as part of the run; before, it belongs to another one."""
        self._started.update(nodes)

    @property
    def message_count(self) -> int:
        """Messages received so far."""
        return self._diagnostics_count + sum(map(len, self.recorded.values()))

    @property
    def time_ns(self) -> int | None:
        """Trip time of the newest clock, None before the first."""
        clocks = self.recorded[Topic.CLOCK]
        return stamp_ns_of(clocks[-1]) if clocks else None

    @property
    def clocks(self) -> int:
        """Clocks received so far."""
        return len(self.recorded[Topic.CLOCK])

    def newest_stamp_ns(self, topic: Topic) -> int | None:
        """Return the stamp of the newest message of a stamped topic, None without one."""
        messages = self.recorded[topic]
        return stamp_ns_of(messages[-1]) if messages else None

    def snapshot(self) -> Snapshot | None:
        """Decode the newest messages; None while one is missing or cannot be read."""
        now_ns = self.time_ns
        try:
            if now_ns is None:
                return None
            state = decode_observation(self._newest(Topic.PLANT_STATE)).state
            gap_m = self._gap_m()
            solve = self._newest_solve()
        except (IndexError, MessageError):
            return None
        return Snapshot(
            time_s=now_ns * 1e-9,
            speed_m_s=state.speed_m_s,
            gap_m=gap_m,
            cell_1_temperature_c=state.cell_1_temperature_k - CELSIUS_ZERO_K,
            cell_n_temperature_c=state.cell_n_temperature_k - CELSIUS_ZERO_K,
            solve_time_s=math.nan if solve is None else solve.solve_time_s,
            iterations=0 if solve is None else solve.iterations,
            rung=Rung.OPTIMAL if solve is None else solve.rung,
        )

    def _gap_m(self) -> float:
        """Return the gap at the stamp of the newest leader, NaN if no recent state has that stamp."""
        if not self.recorded[Topic.LEADER]:
            return math.nan  # an empty road
        leader = self._newest(Topic.LEADER)
        stamp_ns = stamp_of(leader)
        for data in self.recorded[Topic.PLANT_STATE][: -1 - _RECENT_STATES : -1]:
            if stamp_ns_of(data) == stamp_ns:
                ego = deserialize_message(data, TOPICS[Topic.PLANT_STATE].message_type)
                return float(leader.pose.pose.position.x) - decode_motion(ego)[1]
        return math.nan

    def _newest_solve(self) -> DecisionRecord | None:
        """Return the newest decision; None where a controller of the user's reports none."""
        if CONTROLLER in self._foreign and not self.recorded[Topic.SOLVE]:
            return None
        return decode_decision_record(self._newest(Topic.SOLVE))

    def _newest(self, topic: Topic) -> Any:
        return deserialize_message(self.recorded[topic][-1], TOPICS[topic].message_type)

    def _publisher_count(self, topic: Topic) -> int:
        return int(self.count_publishers(TOPICS[topic].name))

    def _subscribe(self, topic: Topic) -> None:
        spec = TOPICS[topic]
        take = self._on_clock if topic is Topic.CLOCK else self.recorded[topic].append
        qos = QoSProfile(
            history=spec.qos.history,
            depth=_DEPTH,
            reliability=spec.qos.reliability,
            durability=spec.qos.durability,
        )
        self.create_subscription(spec.message_type, spec.name, take, qos, raw=True)

    def _on_clock(self, data: bytes) -> None:
        self.last_clock_s = self.last_sign_s = time.monotonic()
        if self.began_s is None:
            self.began_s = self.start_signal.called_s or self.last_clock_s
        self.recorded[Topic.CLOCK].append(data)

    def _on_diagnostics(self, data: bytes) -> None:
        self._diagnostics_count += 1
        if not any(mark in data for mark in self._marks):
            return  # of another vehicle
        message = deserialize_message(data, DiagnosticArray)
        for node in _REPORTING:
            status = find_status(message, f"{self._prefix}/{node}")
            if status is None:
                continue
            # A node that has just been started has no trip time yet.
            about_s = float(status_values(status).get(TRIP_TIME, 0.0))
            about_ns = ns_from_s(about_s) or self.time_ns or 0
            self.reports.append(HeardStatus(about_ns, node, status, self.clocks))
            # Before the first tick all nodes wait for inputs; not reported.
            if self.began_s is not None and status.level != Level.OK.value:
                self.warnings[f"{node}: {status.message}"] = None
        plant = find_status(message, f"{self._prefix}/{PLANT}")
        if plant is not None:
            self.last_sign_s = time.monotonic()
            self.plant_reason = plant.message


def heard_by_stamp(
    heard: Mapping[Topic, Sequence[bytes]], topics: Iterable[Topic]
) -> dict[Topic, dict[int, Any]]:
    """Decode the messages of stamped topics that count, by topic and stamp (ns), see `last_trip`."""
    arrivals = {topic: [(stamp_ns_of(entry), entry) for entry in heard[topic]] for topic in topics}
    counted = last_trip({topic: stamped for topic, stamped in arrivals.items() if stamped})
    return {topic: {} for topic in arrivals} | {
        topic: {
            stamp_ns: numbers_of(topic, entry)
            or deserialize_message(entry, TOPICS[topic].message_type)
            for stamp_ns, entry in entries.items()
        }
        for topic, entries in counted.items()
    }
