"""The range sensor of the plant node: measurements of the vehicle ahead, joined with commands by stamps."""

from __future__ import annotations

from collections.abc import Callable

from sensor_msgs.msg import JointState, PointCloud2

from iptm_core.lead_track import RangeTrack
from iptm_core.settings import LoopMode
from iptm_core.state import NS_PER_S, LeaderPreview, VehicleState
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_ros.codecs import decode_leader_preview, encode_tracks, ns_from_time
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic

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
        stamp_ns = ns_from_time(message.header.stamp)
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
        if held is not None and ns_from_time(held.header.stamp) == stamp_ns:
            self._release()

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _release(self) -> None:
        self._cancel_timer()
        held, self._held = self._held, None
        if held is not None and ns_from_time(held.header.stamp) == self._now_ns():
            self._take(held)
