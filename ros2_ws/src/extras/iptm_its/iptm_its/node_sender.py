"""The sender as a node: a drive as messages on a UDP port, on every `/clock` or by the computer's clock."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2

from iptm_core.decision_record import Rung
from iptm_core.declaration import TextEnum, declared, parameter
from iptm_core.errors import ParameterError
from iptm_core.settings import RoadSettings, TickSettings
from iptm_core.state import NS_PER_MS, NS_PER_S, FloatArray
from iptm_ros.codecs import (
    decode_decision_record,
    decode_motion,
    decode_plan,
    ns_from_time,
    stamp_of,
)
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.parameters import declare_parameters
from iptm_ros.publishers import RAW_QOS
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic
from iptm_v2x_bridge.datagrams import (
    NOT_ALL_SENT,
    REPEAT_PERIOD_S,
    DatagramSender,
)
from iptm_v2x_bridge.messages.cam import specification
from iptm_v2x_bridge.messages.packets import its_timestamp_ms
from iptm_v2x_bridge.node_answers import BridgeNodeParameters
from iptm_v2x_bridge.sender import LONG_BEFORE_NS, CamSender, EgoTick, PlanSender
from iptm_v2x_bridge.settings import LOCALHOST, CamSettings, SenderSettings

WALL_PERIOD_S = 0.01


class SentDrive(TextEnum):
    """Drive that the sender sends."""

    CYCLE = "cycle"
    """The leader in the cycle."""
    EGO = "ego"
    """The vehicle whose topics it hears, with its plan as path prediction."""


@dataclass(frozen=True)
class SenderNodeParameters(SenderSettings, TickSettings, RoadSettings):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    sent_drive: SentDrive = parameter(
        SentDrive.CYCLE,
        "cycle: the leader in the cycle; ego: the vehicle in the namespace of the node, at "
        "every decision, with its plan as path prediction, on the road of the cycle and initial_gap_m ahead "
        "of its own position",
    )
    initial_gap_m: float = declared(BridgeNodeParameters, "initial_gap_m")
    to_address: str = parameter(LOCALHOST, "address that the messages are sent to")
    to_port: int = declared(CamSettings, "cam_port", minimum=1)
    follow_clock: bool = parameter(
        default=True,
        description="send at every tick of the clock, with a mark at its end (lock-step); false sends by "
        "the clock of the computer, from drive_began_s on",
    )
    drive_began_s: float = parameter(
        0.0,
        "follow_clock false: Unix time at which the drive began; 0: with the start of the node",
        "s",
        0.0,
        1e11,
    )
    trip_start_timestamp_ms: int = declared(CamSettings, "trip_start_timestamp_ms")


class SenderNode(SuiteNode):
    """Sends the leader's cooperative awareness messages of a drive, with configured loss and latency.

    On `/clock`, or at every decision of the vehicle whose plan it sends, it sends everything that arrives up
    to the tick, then the end of the tick, which is repeated until the next tick in case the bridge was not
    there yet.
    """

    def __init__(self) -> None:
        super().__init__("v2x_sender")
        self._options = declare_parameters(self, SenderNodeParameters)
        self.reject_unknown_parameters()
        options = self._options
        self._route = options.route(options.initial_gap_m)
        self._datagrams = DatagramSender(self._resolved(options), options.to_port)
        self._sender: CamSender | None = None
        self._last_ns: int | None = None
        specification()  # compiled now, not at the first tick, which others wait for
        began_ns = round(options.drive_began_s * NS_PER_S) or time.time_ns()
        self._start_ns = time.monotonic_ns() - (time.time_ns() - began_ns)
        self._reporter = DiagnosticsReporter.of_node(self, "messages")
        self.every(REPORT_PERIOD_S, self._report)
        if options.follow_clock:
            self.every(REPEAT_PERIOD_S, self._datagrams.repeat_end)
        self._plan_sender: PlanSender | None = None
        if options.sent_drive is SentDrive.EGO:
            self._ego = EgoTicks(self, self._on_ego)
        elif options.follow_clock:
            self.listen(Topic.CLOCK, self._on_clock)
        else:
            self.every(WALL_PERIOD_S, self._on_wall_clock)
        self._report()

    @staticmethod
    def _resolved(options: SenderNodeParameters) -> str:
        try:
            return socket.gethostbyname(options.to_address)
        except (OSError, UnicodeError) as reason:
            raise ParameterError(
                f"to_address is {options.to_address!r} ({reason}); allowed: an address or name of a computer"
            ) from reason

    def _on_clock(self, message: Clock) -> None:
        time_ns = ns_from_time(message.clock)
        if time_ns < 0 or not self._options.is_tick(time_ns):
            return
        self._send_until(time_ns)
        self._datagrams.end_tick(time_ns)

    def _on_ego(self, tick: EgoTick) -> None:
        if self._last_ns is not None and tick.time_ns <= self._last_ns:
            if tick.time_ns == self._last_ns:
                return  # a state that was repeated, and answered again
            self._plan_sender = None  # a new trip
            self._datagrams.sent = 0
        options = self._options
        sender = self._plan_sender = self._plan_sender or PlanSender(
            self._route.road_line, options, options.initial_gap_m, self._start_ms(tick.time_ns)
        )
        for datagram in sender.arrivals(tick):
            self._datagrams.send(datagram)
        self._last_ns = tick.time_ns
        if options.follow_clock:
            self._datagrams.end_tick(tick.time_ns)

    def _on_wall_clock(self) -> None:
        self._send_until(time.monotonic_ns() - self._start_ns)

    def _send_until(self, time_ns: int) -> None:
        if self._last_ns is not None and time_ns < self._last_ns:
            self._last_ns, self._sender = None, None  # a new trip
            self._datagrams.sent = 0
        sender = self._sender or self._start(time_ns)
        after_ns = -LONG_BEFORE_NS if self._last_ns is None else self._last_ns
        for _, datagram in sender.arrivals(after_ns, time_ns):
            self._datagrams.send(datagram)
        self._last_ns = time_ns

    def _start(self, time_ns: int) -> CamSender:
        self._sender = CamSender(
            self._route.leader, self._route.road_line, self._options, self._start_ms(time_ns)
        )
        return self._sender

    def _start_ms(self, time_ns: int) -> int:
        """Return the TimestampIts of trip time 0, the present being a trip time."""
        start_ms = self._options.trip_start_timestamp_ms
        if start_ms < 0:
            start_ms = its_timestamp_ms(time.time_ns()) - time_ns // NS_PER_MS
        return start_ms

    def _report(self) -> None:
        values: dict[str, object] = {
            "sent_drive": self._options.sent_drive.value,
            "cycle": self._options.cycle,
            **self._datagrams.report(),
        }
        level, reason = Level.OK, "messages are sent"
        if self._last_ns is None:
            drives = self._options.sent_drive is SentDrive.EGO
            reason = "waiting for a decision" if drives else "waiting for the clock"
        elif self._datagrams.failed:
            level, reason = Level.WARN, NOT_ALL_SENT
        self._reporter.report(self._last_ns or 0, level, reason, lambda: values)

    def destroy_node(self) -> None:
        """Give the socket back, too."""
        self._datagrams.close()
        super().destroy_node()


_MOST_KEPT = 5000
_Plan = tuple[FloatArray, FloatArray]
_NO_PLAN: _Plan = (np.empty(0), np.empty(0))


class EgoTicks:
    """Calls back once for every decision of the vehicle in the namespace of a node.

    The vehicle does not wait for this subscriber, hence the deep queues. A plan is awaited if the decision
    record marks it as followed.
    """

    def __init__(self, node: SuiteNode, on_tick: Callable[[EgoTick], None]) -> None:
        """Listen."""
        self._on_tick = on_tick
        self._states: dict[int, tuple[float, float]] = {}
        self._followed: dict[int, bool] = {}
        self._plans: dict[int, _Plan] = {}
        self._newest_ns = dict.fromkeys((Topic.PLANT_STATE, Topic.SOLVE, Topic.PLAN), -1)
        node.listen(Topic.SOLVE, self._on_solve, qos=RAW_QOS)
        node.listen(Topic.PLAN, self._on_plan, qos=RAW_QOS)
        node.listen(Topic.PLANT_STATE, self._on_state, qos=RAW_QOS)

    def _on_state(self, message: JointState) -> None:
        stamp_ns, place, speed = decode_motion(message)
        if stamp_ns < self._newest_ns[Topic.PLANT_STATE]:
            self._begin_trip(stamp_ns)
        self._newest_ns[Topic.PLANT_STATE] = stamp_ns
        if np.isfinite([place, speed]).all():
            self._states[stamp_ns] = (place, max(speed, 0.0))
            self._pass_on()

    def _begin_trip(self, stamp_ns: int) -> None:
        """Forget the trip before; what was decided for the first state of this one may be here already."""
        self._states.clear()
        for kept in (self._followed, self._plans):
            for later_ns in [at_ns for at_ns in kept if at_ns > stamp_ns]:
                del kept[later_ns]
        self._newest_ns = dict.fromkeys(self._newest_ns, stamp_ns - 1)

    def _on_solve(self, message: JointState) -> None:
        stamp_ns = stamp_of(message)
        self._followed[stamp_ns] = decode_decision_record(message).rung is Rung.OPTIMAL
        self._newest_ns[Topic.SOLVE] = stamp_ns
        self._pass_on()

    def _on_plan(self, message: PointCloud2) -> None:
        stamp_ns, plan = decode_plan(message)
        self._plans[stamp_ns] = (plan.times_s, plan.speeds_m_s)
        self._newest_ns[Topic.PLAN] = stamp_ns
        self._pass_on()

    def _pass_on(self) -> None:
        """Pass on the complete ticks in order; messages of one topic arrive in order."""
        for kept in (self._states, self._followed, self._plans):
            while len(kept) > _MOST_KEPT:
                del kept[next(iter(kept))]
        while self._states:
            stamp_ns = next(iter(self._states))
            followed = self._followed.get(stamp_ns)
            if followed is None and self._newest_ns[Topic.SOLVE] <= stamp_ns:
                return
            missing = followed and stamp_ns not in self._plans
            if missing and self._newest_ns[Topic.PLAN] <= stamp_ns:
                return
            place_m, speed_m_s = self._states.pop(stamp_ns)
            plan = self._plans.get(stamp_ns, _NO_PLAN) if followed else _NO_PLAN
            for kept in (self._followed, self._plans):
                for done_ns in [at_ns for at_ns in kept if at_ns <= stamp_ns]:
                    del kept[done_ns]
            if followed is not None:  # else the controller left this state out
                self._on_tick(EgoTick(stamp_ns, place_m, speed_m_s, *plan))


def main() -> None:
    """Run the node."""
    sys.exit(node_main("v2x_sender", SenderNode, SenderNodeParameters))


if __name__ == "__main__":
    main()
