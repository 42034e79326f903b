"""What keeps a vehicle of a string in step with its neighbours."""

from __future__ import annotations

from collections.abc import Callable

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from iptm_core.errors import ParameterError
from iptm_core.settings import LoopMode
from iptm_core.state import NS_PER_S
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_ros.codecs import ns_from_time, stamp_ns_of
from iptm_ros.node_health import VehiclePresence
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic, topic_of


class Neighbours:
    """Holds back the command that would take the plant to a state before its neighbours allow that state.

    The state of an instant is published when the vehicle ahead has planned at that instant, so that the
    answer to the state waits for nothing from elsewhere, and when the vehicle behind has published the
    instant before, so that no vehicle falls behind further than the queues reach. A neighbour that has left
    the graph is not waited for. This affects the timing only: the numbers depend on stamps.
    """

    def __init__(self, node: SuiteNode, options: PlantNodeParameters) -> None:
        """Listen to the neighbours that there are."""
        self._ahead = options.vehicle_ahead
        self._behind = options.vehicle_behind
        named = {"vehicle_ahead": self._ahead, "vehicle_behind": self._behind}
        if options.mode is LoopMode.REAL_TIME and any(named.values()):
            given = " and ".join(f"{key} {name}" for key, name in named.items() if name)
            raise ParameterError(f"mode is real_time with {given}; allowed in a string: lock_step")
        self._period_ns = round(options.period_s * NS_PER_S)
        self._planned_ns = self._reached_ns = -1
        self._presence: dict[str, VehiclePresence] = {}
        self._take: Callable[[JointState], None] = lambda _: None
        self._held: JointState | None = None
        if self._ahead:
            node.listen(Topic.PLAN, self._on_plan, raw=True, vehicle=self._ahead)
            self._presence[self._ahead] = VehiclePresence(
                node, self._ahead, Topic.PLAN, self._release
            )
        if self._behind:
            node.listen(Topic.CLOCK, self._on_clock, vehicle=self._behind)
            self._presence[self._behind] = VehiclePresence(
                node, self._behind, Topic.CLOCK, self._release
            )

    @property
    def is_holding(self) -> bool:
        """Whether the plant's command is there, but not the consent of its neighbours."""
        return self._held is not None

    def missing(self, time_ns: int) -> tuple[str, ...]:
        """Return the topics that must advance before the state of an instant may be published."""
        found = []
        if self._ahead and self._planned_ns < time_ns and not self._presence[self._ahead].is_gone:
            found.append(topic_of(self._ahead, Topic.PLAN))
        before_ns = time_ns - self._period_ns
        if (
            self._behind
            and self._reached_ns < before_ns
            and not self._presence[self._behind].is_gone
        ):
            found.append(topic_of(self._behind, Topic.CLOCK))
        return tuple(found)

    def in_step(self, take: Callable[[JointState], None]) -> Callable[[JointState], None]:
        """Return a callback that hands commands on as soon as the neighbours allow the state that follows."""
        self._take = take
        return self._on_command

    def _on_command(self, message: JointState) -> None:
        self._held = message
        self._release()

    def _on_plan(self, data: bytes) -> None:
        self._planned_ns = stamp_ns_of(data)
        self._release()

    def _on_clock(self, message: Clock) -> None:
        self._reached_ns = ns_from_time(message.clock)
        self._release()

    def _release(self) -> None:
        held = self._held
        if held is None:
            return
        if not self.missing(ns_from_time(held.header.stamp) + self._period_ns):
            self._held = None
            self._take(held)
