"""The vehicle among its neighbours: in step with those of a string, and its range sensor.

Measurements of the vehicle ahead are joined with commands by their stamps.
"""

from __future__ import annotations

from collections.abc import Callable

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2

from iptm_core.errors import ParameterError
from iptm_core.lead_track import RangeTrack
from iptm_core.settings import LoopMode
from iptm_core.state import NS_PER_S, LeaderPreview, VehicleState
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_ros.codecs import (
    decode_leader_preview,
    encode_tracks,
    ns_from_time,
    stamp_ns_of,
    stamp_of,
)
from iptm_ros.node_health import VehiclePresence
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic, topic_of


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
        if not self.missing(stamp_of(held) + self._period_ns):
            self._held = None
            self._take(held)


RANGE_M = 250.0
"""How far the sensor of the simulated vehicle sees."""
WAIT_S = 1.0
"""Lock-step: wall time for which a command waits for the measurements of its stamp."""
_KEPT = 16


class PlayedRangeSensor:
    """What the sensor of the simulated vehicle measures, published where the trip asks for it."""

    def __init__(self, node: SuiteNode, options: PlantNodeParameters) -> None:
        self._lead = options.lead_motion()
        self._publisher = node.advertise(Topic.RANGE_TRACKS) if self._lead else None

    def publish(self, own: VehicleState, stamp_ns: int) -> None:
        """Publish the vehicle ahead at a state of the own one, if it is in range."""
        if self._lead is None or self._publisher is None:
            return
        ahead = self._lead.state_at(own.time_s)
        gap_m = ahead.position_m - own.position_m
        track = RangeTrack(gap_m, 0.0, ahead.speed_m_s - own.speed_m_s)
        self._publisher.publish(encode_tracks((track,) if gap_m <= RANGE_M else (), stamp_ns))


class NodeRangeSensor:
    """Measurements by stamp; in lock-step a command is held until the measurements of its stamp have arrived.

    After a timeout the sensor is not waited for again until it has answered.

    Attributes:
        is_silent: whether the present interval has no measurement.
    """

    def __init__(self, node: SuiteNode, options: PlantNodeParameters) -> None:
        self._is_used = options.safety_monitor
        self._waits = self._is_used and options.mode is LoopMode.LOCK_STEP
        self._samples: dict[int, LeaderPreview] = {}
        self._held: JointState | None = None
        self._take: Callable[[JointState], None] = lambda _: None
        self._now_ns: Callable[[], int] = lambda: -1
        self.is_silent = False
        self.silent_intervals = 0
        # The first message must not be missed: the publisher keeps it.
        qos = TOPICS[Topic.LEADER_SAMPLES].offered_qos
        node.listen(Topic.LEADER_SAMPLES, self._on_samples, qos=qos)
        self._timer = node.every(WAIT_S, self._release) if self._waits else None
        self._cancel_timer()

    @property
    def is_holding(self) -> bool:
        """Whether a command waits for measurements."""
        return self._held is not None

    def begin_trip(self) -> None:
        """Forget the measurements of another trip."""
        self._samples.clear()

    def measure(self, state: VehicleState) -> LeaderPreview | None:
        """Return the measurements of the interval that begins with a state; None if the sensor is silent."""
        now_ns = round(state.time_s * NS_PER_S)
        found = self._samples.get(now_ns)
        for stamp_ns in [stamp_ns for stamp_ns in self._samples if stamp_ns <= now_ns]:
            del self._samples[stamp_ns]
        self.is_silent = self._is_used and found is None
        self.silent_intervals += self.is_silent
        return found

    def in_step(
        self, take: Callable[[JointState], None], now_ns: Callable[[], int]
    ) -> Callable[[JointState], None]:
        """Return a callback that hands commands on, the awaited one when its measurements are there."""
        self._take, self._now_ns = take, now_ns
        return self._on_command

    def _on_command(self, message: JointState) -> None:
        stamp_ns = stamp_of(message)
        measured = self.is_silent or stamp_ns in self._samples
        if not self._waits or measured or stamp_ns != self._now_ns():
            self._take(message)
            return
        self._held = message
        if self._timer is not None:
            self._timer.reset()

    def _on_samples(self, message: PointCloud2) -> None:
        stamp_ns, samples = decode_leader_preview(message, Topic.LEADER_SAMPLES)
        self._samples[stamp_ns] = samples
        while len(self._samples) > _KEPT:
            del self._samples[next(iter(self._samples))]
        held = self._held
        if held is not None and stamp_of(held) == stamp_ns:
            self._release()

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _release(self) -> None:
        self._cancel_timer()
        held, self._held = self._held, None
        if held is not None and stamp_of(held) == self._now_ns():
            self._take(held)
