"""The injector node: forwards the messages between the nodes of the loop and applies faults to them.

Without a fault the bytes are forwarded unchanged; a fault changes the messages of the ticks that it hits.
Ticks are identified by stamps and no timer is involved, so lock-step runs are repeatable.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, PointCloud2

from iptm.faults.fault import Fault, InjectorNodeParameters, at_places, faulty_name, route_name
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.faults.signals import (
    Delay,
    PreviewFaults,
    RangeSensorFaults,
    StateFaults,
    Traffic,
    faulty_slope,
)
from iptm_core.errors import MessageError
from iptm_core.settings import LoopMode
from iptm_core.state import NS_PER_S, LeaderPreview, SlopePreview
from iptm_faults.node_messages import changed_state_message, with_stamp
from iptm_ros.codecs import (
    decode_leader,
    decode_leader_preview,
    decode_motion,
    decode_slope,
    encode_leader,
    encode_slope,
    leader_preview_bytes,
    serialized,
    stamp_ns_of,
)
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.parameters import declare_parameters
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic

FOREIGN_MESSAGES_PER_TICK = 20
"""Foreign messages sent per tick while such a fault is active."""

_REMEMBERED_TICKS = 50
_FOREIGN_TOPICS = {
    FaultKind.FOREIGN_CLOCK: Topic.CLOCK,
    FaultKind.FOREIGN_LEADER: Topic.LEADER,
    FaultKind.FOREIGN_PREVIEW: Topic.LEADER_PREVIEW,
    FaultKind.FOREIGN_STATE: Topic.PLANT_STATE,
}


class InjectorNode(SuiteNode):
    """Forwards state, leader, preview, slope and clock with the faults of the run applied."""

    def __init__(self) -> None:
        super().__init__("fault_injector")
        self._options = declare_parameters(self, InjectorNodeParameters)
        self.reject_unknown_parameters()
        self._faults = self._options.listed()
        self._traffic = Traffic(self._faults)
        self._previews = PreviewFaults(self._faults)
        self._of_state = at_places(self._faults, FaultPlace.STATE)
        self._states = StateFaults(self._faults)
        self._sensor = RangeSensorFaults(self._faults)
        self._of_clock = at_places(self._faults, FaultPlace.CLOCK)
        self._foreign = at_places(self._faults, FaultPlace.STAMPS)
        self._road = at_places(self._faults, FaultPlace.ROAD)
        self._slope: SlopePreview | None = None
        self._slope_hit: tuple[bool, ...] = ()
        self._ego_positions_m: dict[int, float] = {}
        self._waiting_leaders: dict[int, bytes] = {}
        self._waiting_previews: dict[int, bytes] = {}
        self._waiting_samples: dict[int, bytes] = {}
        self._leader_ns = -1
        self._last_state: bytes | None = None
        self._delay: Delay[bytes] = Delay(self._of_state, FaultKind.STATE_DELAYED)
        self._now_ns = 0
        self._changed = 0
        outputs = (
            Topic.PLANT_STATE, Topic.LEADER, Topic.LEADER_PREVIEW, Topic.SLOPE, Topic.CLOCK
        )  # fmt: skip
        self._outputs = {
            topic: self._publisher(topic, faulty_name(topic.value)) for topic in outputs
        }
        self._newest: dict[Topic, bytes] = {}
        self._true = {
            topic: self.advertise(topic)
            for topic in (Topic.LEADER, Topic.LEADER_SAMPLES, Topic.LEADER_PREVIEW)
        }
        self._reporter = DiagnosticsReporter.of_node(self, "faults")
        self._subscribe(Topic.SLOPE, Topic.SLOPE.value, self._on_slope)
        self._subscribe(Topic.PLANT_STATE, Topic.PLANT_STATE.value, self._on_state)
        self._subscribe(Topic.LEADER, route_name(Topic.LEADER.value), self._on_leader)
        samples_name = route_name(Topic.LEADER_SAMPLES.value)
        self._subscribe(Topic.LEADER_SAMPLES, samples_name, self._on_samples)
        self._subscribe(
            Topic.LEADER_PREVIEW, route_name(Topic.LEADER_PREVIEW.value), self._on_preview
        )
        self._subscribe(Topic.CLOCK, Topic.CLOCK.value, self._on_clock)
        self.every(REPORT_PERIOD_S, self._report)
        self._report()

    def _publisher(self, topic: Topic, name: str) -> Publisher:
        spec = TOPICS[topic]
        return self.create_publisher(spec.message_type, name, spec.qos)

    def _subscribe(self, topic: Topic, name: str, callback: Callable[[bytes], None]) -> None:
        spec = TOPICS[topic]
        guarded = partial(self.guard, name, callback)
        self.create_subscription(spec.message_type, name, guarded, spec.offered_qos, raw=True)

    # --- forwarding

    def _forward(self, topic: Topic, data: bytes, *, changed: bool = False) -> None:
        self._changed += changed
        self._newest[topic] = data
        self._outputs[topic].publish(data)

    # --- state and clock

    def _on_state(self, data: bytes) -> None:
        stamp_ns, position_m, _ = decode_motion(deserialize_message(data, JointState))
        self._ego_positions_m[stamp_ns] = position_m
        while len(self._ego_positions_m) > _REMEMBERED_TICKS:
            del self._ego_positions_m[next(iter(self._ego_positions_m))]
        topic, before, self._last_state = Topic.PLANT_STATE, self._last_state, data
        for fault in self._of_state:
            if not fault.hits(stamp_ns):
                continue
            if fault.kind is FaultKind.STATE_LATE:
                self._later(fault.magnitude, partial(self._forward, topic, data, changed=True))
                break
            if fault.kind is FaultKind.STATE_REPEATED:
                self._forward(topic, before or data, changed=True)
                break
            if fault.kind is FaultKind.STATE_BACKWARDS:
                past_ns = stamp_ns - round(fault.magnitude * NS_PER_S)
                self._forward(topic, with_stamp(data, past_ns), changed=True)
                break
        else:
            changed = changed_state_message(self._states, stamp_ns, data)
            faulty = self._delay.delayed(stamp_ns, changed)
            self._forward(topic, faulty, changed=faulty is not data)
        if stamp_ns in self._waiting_leaders:
            self._on_leader(self._waiting_leaders.pop(stamp_ns))

    def _later(self, delay_s: float, action: Callable[[], None]) -> None:
        timer: Any = None

        def once() -> None:
            timer.cancel()
            self.destroy_timer(timer)
            action()

        timer = self.every(max(delay_s, 1e-3), once)

    def _on_clock(self, data: bytes) -> None:
        self._now_ns = now_ns = stamp_ns_of(data)
        self._send_foreign(now_ns)
        hitting = [fault for fault in self._of_clock if fault.hits(now_ns)]
        if not any(fault.kind is FaultKind.CLOCK_PAUSED for fault in hitting):
            off_s = sum(fault.magnitude for fault in hitting)
            faulty = with_stamp(data, now_ns + round(off_s * NS_PER_S)) if hitting else data
            self._forward(Topic.CLOCK, faulty)
        self._changed += bool(hitting)
        self._report()

    def _send_foreign(self, now_ns: int) -> None:
        """Publish foreign messages: the newest ones with foreign stamps."""
        for fault in self._foreign:
            if not fault.hits(now_ns):
                continue
            topic = _FOREIGN_TOPICS[fault.kind]
            newest = self._newest.get(topic)
            if newest is None:
                continue
            first_ns = now_ns + round(fault.magnitude * NS_PER_S)
            for number in range(FOREIGN_MESSAGES_PER_TICK):
                foreign = with_stamp(newest, first_ns + number * NS_PER_S)
                self._outputs[topic].publish(foreign)
            self._changed += 1

    # --- leader, its previews, and the road

    def _on_leader(self, data: bytes) -> None:
        stamp_ns = stamp_ns_of(data)
        self._update_slope(stamp_ns)
        if self._traffic.is_quiet and self._sensor.is_sound:
            self._true[Topic.LEADER].publish(data)
            self._forward(Topic.LEADER, data)
            return
        ego_m = self._ego_positions_m.get(stamp_ns)
        if ego_m is None:
            self._waiting_leaders = {stamp_ns: data}
            return
        try:
            own = decode_leader(deserialize_message(data, Odometry))
        except MessageError:
            self._forward(Topic.LEADER, data)
            return
        true = self._traffic.leader(own, ego_m)
        encode = partial(encode_leader.data, self.frame_prefix)
        true_data = data if true is own else encode(true, stamp_ns)
        self._true[Topic.LEADER].publish(true_data)
        faulty = self._sensor.leader(stamp_ns, true, ego_m)
        if faulty is None:
            self._changed += 1
        else:
            faulty_data = true_data if faulty is true else encode(faulty, stamp_ns)
            self._forward(Topic.LEADER, faulty_data, changed=faulty is not true)
        self._leader_ns = stamp_ns
        for waiting_ns in sorted(self._waiting_samples):
            if waiting_ns <= stamp_ns:
                self._on_samples(self._waiting_samples.pop(waiting_ns))
        for waiting_ns in sorted(self._waiting_previews):
            if waiting_ns <= stamp_ns:
                self._on_preview(self._waiting_previews.pop(waiting_ns))

    def _on_samples(self, data: bytes) -> None:
        """Forward the measurements of the range sensor: the effective leader with sensor faults."""
        stamp_ns = stamp_ns_of(data)
        publisher = self._true[Topic.LEADER_SAMPLES]
        if self._traffic.is_quiet and self._sensor.is_sound:
            publisher.publish(data)
            return
        if self._leader_ns < stamp_ns:
            self._waiting_samples[stamp_ns] = data
            return
        message = deserialize_message(data, PointCloud2)
        stamp_ns, own = decode_leader_preview(message, Topic.LEADER_SAMPLES)
        ego_m = self._ego_positions_m[stamp_ns]
        true = own if self._traffic.is_quiet else self._traffic.sampled(own, ego_m)
        faulty = self._sensor.samples(true, ego_m)
        if faulty is None:
            return
        if faulty is not own:
            publisher.publish(
                leader_preview_bytes(faulty, stamp_ns, self.frame_prefix, Topic.LEADER_SAMPLES)
            )
        else:
            publisher.publish(data)

    def _on_preview(self, data: bytes) -> None:
        stamp_ns = stamp_ns_of(data)
        hit = self._previews.hits(stamp_ns)
        if self._traffic.is_quiet and not hit:
            self._true[Topic.LEADER_PREVIEW].publish(data)
            self._forward(Topic.LEADER_PREVIEW, data)
            return
        if not self._traffic.is_quiet and self._leader_ns < stamp_ns:
            # The prediction needs the position of its leader.
            self._waiting_previews[stamp_ns] = data
            return
        try:
            stamp_ns, own = decode_leader_preview(deserialize_message(data, PointCloud2))
        except MessageError:
            self._forward(Topic.LEADER_PREVIEW, data)
            return
        true = self._traffic.preview(own)
        true_data = data if true is own else leader_preview_bytes(true, stamp_ns, self.frame_prefix)
        self._true[Topic.LEADER_PREVIEW].publish(true_data)
        faulty = self._previews.apply(stamp_ns, true)
        if faulty is None and self._options.mode is LoopMode.LOCK_STEP:
            faulty = LeaderPreview.empty()  # to the controller the same, at once
        if faulty is None:
            self._changed += 1
        elif faulty is true:
            self._forward(Topic.LEADER_PREVIEW, true_data)
        else:
            faulty_data = leader_preview_bytes(faulty, stamp_ns, self.frame_prefix)
            self._forward(Topic.LEADER_PREVIEW, faulty_data, changed=True)

    def _on_slope(self, data: bytes) -> None:
        self._outputs[Topic.SLOPE].publish(data)
        try:
            spec = TOPICS[Topic.SLOPE]
            self._slope = decode_slope(deserialize_message(data, spec.message_type))
        except MessageError:
            self._slope = None

    def _update_slope(self, stamp_ns: int) -> None:
        """Republish the map of the road when a road fault begins or ends at a tick."""
        if not self._road or self._slope is None:
            return
        hit = tuple(fault.hits(stamp_ns) for fault in self._road)
        if hit != (self._slope_hit or (False,) * len(hit)):
            message = encode_slope(faulty_slope(self._road, stamp_ns, self._slope))
            self._outputs[Topic.SLOPE].publish(serialized(message))
        self._slope_hit = hit

    # --- diagnostics

    def _report(self) -> None:
        acting = [fault for fault in self._faults if fault.covers(self._now_ns) and _is_mine(fault)]
        reason = ", ".join(dict.fromkeys(str(fault.kind) for fault in acting))
        values = {"faults": len(self._faults), "changed_messages": self._changed}
        level = Level.WARN if acting else Level.OK
        self._reporter.report(self._now_ns, level, reason or "handing on", lambda: values)


def _is_mine(fault: Fault) -> bool:
    return fault.spec.place not in {FaultPlace.SOLVER, FaultPlace.PROCESS}


def main() -> None:
    """Run the node."""
    sys.exit(node_main("injector", InjectorNode, InjectorNodeParameters))


if __name__ == "__main__":
    main()
