"""The vehicle among its neighbours: in step with a string, and its range sensor.

Measurements of the vehicle ahead are joined with commands by their stamps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from rclpy.timer import Timer
from sensor_msgs.msg import PointCloud2

from iptm_core.lead_track import RangeTrack
from iptm_core.settings import LoopMode
from iptm_core.state import NS_PER_S, LeaderPreview, VehicleState
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_ros.codecs import (
    decode_leader_preview,
    encode_tracks,
    stamp_ns_of,
)
from iptm_ros.node_health import VehiclePresence
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic, topic_of

LONGEST_SILENCE_S, _SILENT_PERIODS = 3.0, 3.0
"""Real time: wall time, and periods, after which a neighbour without a clock is not waited for until it is
back. A paused one repeats its clock."""


class Neighbours:
    """Determines whether the neighbours of the plant allow its next state.

    The state of an instant is published when the vehicle ahead has planned at that instant, so that the
    answer to the state waits for nothing from elsewhere, and when the vehicle behind has published the
    instant before, so that no vehicle falls behind further than the queues reach. A neighbour that has left
    the graph is not waited for. This affects the timing only: the numbers depend on stamps.

    In real time the vehicle ahead need only have reached the instant. A vehicle that misses a tick stays a
    period behind the wall clock: if the others did not wait for it, the one behind it would not receive its
    state of an instant before its own next tick, until the end of the trip.
    """

    def __init__(
        self, node: SuiteNode, options: PlantNodeParameters, retry: Callable[[], None]
    ) -> None:
        """Listen to the neighbours that there are; `retry` is called when one of them has advanced."""
        self._period_ns = round(options.period_s * NS_PER_S)
        self._retry, self._now_s = retry, node.awake.now_s
        self._reached: dict[str, int] = {}
        self._heard_s: dict[str, float] = {}
        first, self._patience_s = Topic.PLAN, math.inf
        if options.mode is LoopMode.REAL_TIME:
            wall_period_s = options.period_s / options.rate_factor
            first = Topic.CLOCK
            self._patience_s = max(LONGEST_SILENCE_S, _SILENT_PERIODS * wall_period_s)
        self._needed: dict[str, tuple[VehiclePresence, int]] = {}
        for vehicle, topic, later_ns in (
            (options.vehicle_ahead, first, 0),
            (options.vehicle_behind, Topic.CLOCK, self._period_ns),
        ):
            if vehicle:
                name = topic_of(vehicle, topic)
                presence = VehiclePresence(node, vehicle, topic, retry)
                self._needed[name] = presence, later_ns
                node.listen(topic, partial(self._on_stamped, name), raw=True, vehicle=vehicle)

    def allow_answer_to(self, stamp_ns: int) -> bool:
        """Return whether the state that follows the one of a stamp may be published."""
        return not self.missing(stamp_ns + self._period_ns)

    def missing(self, time_ns: int) -> tuple[str, ...]:
        """Return the topics that must advance before the state of an instant may be published."""
        return tuple(
            name
            for name, (presence, later_ns) in self._needed.items()
            if self._reached.get(name, -1) < time_ns - later_ns
            and not presence.is_gone
            and not self._is_silent(name)
        )

    def _is_silent(self, name: str) -> bool:
        return self._now_s() - self._heard_s.get(name, math.inf) > self._patience_s

    def _on_stamped(self, name: str, data: bytes) -> None:
        self._reached[name], self._heard_s[name] = stamp_ns_of(data), self._now_s()
        self._retry()


RANGE_M = 250.0
"""How far the sensor of the simulated vehicle sees."""
WAIT_S, PREVIEW_WAIT_S = 1.0, 0.1
"""Lock-step: wall times for which a command waits for measurements and preview of its stamp; the controller
had the preview before it decided."""
_KEPT = 16


class PlayedRangeSensor:
    """What the sensor of the simulated vehicle measures, published where the trip asks for it."""

    def __init__(self, node: SuiteNode, options: PlantNodeParameters) -> None:
        self._lead = options.lead_motion()
        self._publisher = node.advertise(Topic.RANGE_TRACKS) if self._lead else None
        self._prefix = node.frame_prefix

    def publish(self, own: VehicleState, stamp_ns: int) -> None:
        """Publish the vehicle ahead at a state of the own one, if it is in range."""
        if self._lead is None or self._publisher is None:
            return
        ahead = self._lead.state_at(own.time_s)
        gap_m = ahead.position_m - own.position_m
        track = RangeTrack(gap_m, 0.0, ahead.speed_m_s - own.speed_m_s)
        seen = (track,) if gap_m <= RANGE_M else ()
        self._publisher.publish(encode_tracks(seen, stamp_ns, self._prefix))


class StampedInput:
    """Messages of one topic by stamp; in lock-step an answer waits until that of its stamp has arrived.

    After a timeout the topic is not waited for again until it has answered.

    Attributes:
        is_silent: whether the present interval has no message.
    """

    def __init__(
        self,
        node: SuiteNode,
        topic: Topic,
        retry: Callable[[], None],
        wait_s: float,
        *,
        is_awaited: bool,
    ) -> None:
        """Listen to a topic; `retry` is called when the awaited message may be there."""
        self._topic, self._retry = topic, retry
        self._kept: dict[int, LeaderPreview] = {}
        self._awaited_ns = self._given_up_ns = -1
        self.is_silent = False
        # The first message must not be missed: the publisher keeps it.
        node.listen(topic, self._on_message, qos=TOPICS[topic].offered_qos)
        self._timer: Timer | None = None
        if is_awaited:
            self._timer = node.every(wait_s, self._give_up)
            self._timer.cancel()

    def begin_trip(self) -> None:
        """Forget the messages of another trip."""
        self._kept.clear()
        self._awaited_ns = self._given_up_ns = -1

    def taken(self, now_ns: int) -> LeaderPreview | None:
        """Return the message of a stamp, None for none; older ones are forgotten."""
        found = self._kept.get(now_ns)
        for stamp_ns in [stamp_ns for stamp_ns in self._kept if stamp_ns <= now_ns]:
            del self._kept[stamp_ns]
        self.is_silent = found is None
        return found

    def allows_answer_to(self, stamp_ns: int) -> bool:
        """Return whether the present state, of a stamp, may be answered; else wait for the message."""
        known = stamp_ns in self._kept or stamp_ns == self._given_up_ns
        if self._timer is None or self.is_silent or known:
            return True
        if stamp_ns != self._awaited_ns:
            self._awaited_ns = stamp_ns
            self._timer.reset()
        return False

    def _on_message(self, message: PointCloud2) -> None:
        stamp_ns, preview = decode_leader_preview(message, self._topic)
        self._kept[stamp_ns] = preview
        while len(self._kept) > _KEPT:
            del self._kept[next(iter(self._kept))]
        self._retry()

    def _give_up(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._given_up_ns = self._awaited_ns
        self._retry()


class NodeRangeSensor:
    """What the safety monitor has of the vehicle ahead: measurements, and messages that are authenticated.

    Attributes:
        is_silent: whether the present interval has no measurement.
    """

    def __init__(
        self, node: SuiteNode, options: PlantNodeParameters, retry: Callable[[], None]
    ) -> None:
        """Listen to both; `retry` is called when the awaited message may be there."""
        self._is_used = options.safety_monitor
        is_awaited = self._is_used and options.mode is LoopMode.LOCK_STEP
        self._samples = StampedInput(
            node, Topic.LEADER_SAMPLES, retry, WAIT_S, is_awaited=is_awaited
        )
        self._previews: StampedInput | None = None
        if self._is_used and options.authenticated_radio:
            self._previews = StampedInput(
                node, Topic.LEADER_PREVIEW, retry, PREVIEW_WAIT_S, is_awaited=is_awaited
            )
        self._heard = LeaderPreview.empty()
        self.is_silent = False
        self.silent_intervals = 0

    def begin_trip(self) -> None:
        """Forget what belongs to another trip."""
        self._samples.begin_trip()
        self._heard = LeaderPreview.empty()
        if self._previews is not None:
            self._previews.begin_trip()

    def measure(self, state: VehicleState) -> LeaderPreview | None:
        """Return the measurements of the interval that begins with a state; None if the sensor is silent."""
        found = self._samples.taken(round(state.time_s * NS_PER_S))
        self.is_silent = self._is_used and found is None
        self.silent_intervals += self.is_silent
        return found

    def heard(self, stamp_ns: int) -> LeaderPreview:
        """Return the newest preview at a stamp."""
        if self._previews is not None:
            self._heard = self._previews.taken(stamp_ns) or self._heard
        return self._heard

    def allows_answer_to(self, stamp_ns: int) -> bool:
        """Return whether the present state, of a stamp, may be answered; else wait for what belongs to it."""
        if not self._samples.allows_answer_to(stamp_ns):
            return False
        return self._previews is None or self._previews.allows_answer_to(stamp_ns)
