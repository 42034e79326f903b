"""State and plan of the ego vehicle, joined tick by tick."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from iptm_core.decision_record import Rung
from iptm_core.state import FloatArray
from iptm_interfaces.codecs import decode_decision_record, decode_plan, ns_from_time
from iptm_interfaces.qos import RAW_QOS
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_v2x_bridge.sending.plan_sender import HostTick

_JOIN_PERIOD_S = 0.05
_MOST_KEPT = 5000
_Plan = tuple[FloatArray, FloatArray]
_NO_PLAN: _Plan = (np.empty(0), np.empty(0))


class HostTicks:
    """Calls back once for every decision of the vehicle in the namespace of a node.

    The vehicle does not wait for this subscriber, hence the deep queues. A plan is awaited if the decision
    record marks it as followed. The state is subscribed to last, after the controller: a plant that counts
    this subscriber in its `expected_peers` then loses no tick.
    """

    def __init__(self, node: SuiteNode, on_tick: Callable[[HostTick], None]) -> None:
        """Listen."""
        self._node, self._on_tick = node, on_tick
        self._states: dict[int, tuple[float, float]] = {}
        self._followed: dict[int, bool] = {}
        self._plans: dict[int, _Plan] = {}
        self._newest_ns = dict.fromkeys((Topic.PLANT_ODOMETRY, Topic.SOLVE, Topic.PLAN), -1)
        self._decisions = [
            node.listen(Topic.SOLVE, self._on_solve, qos=RAW_QOS),
            node.listen(Topic.PLAN, self._on_plan, qos=RAW_QOS),
        ]
        self._joining = node.every(_JOIN_PERIOD_S, self._join)

    def _join(self) -> None:
        if all(subscription.get_publisher_count() for subscription in self._decisions):
            self._joining.cancel()
            self._node.listen(Topic.PLANT_ODOMETRY, self._on_state, qos=RAW_QOS)
            # Only to be counted: the plant waits for its peers on either topic.
            self._node.listen(Topic.CLOCK, self._on_clock)

    def _on_clock(self, message: Clock) -> None:
        pass

    def _on_state(self, message: Odometry) -> None:
        stamp_ns = ns_from_time(message.header.stamp)
        if stamp_ns < self._newest_ns[Topic.PLANT_ODOMETRY]:
            self._begin_trip(stamp_ns)
        self._newest_ns[Topic.PLANT_ODOMETRY] = stamp_ns
        place, speed = message.pose.pose.position.x, message.twist.twist.linear.x
        if np.isfinite([place, speed]).all():
            self._states[stamp_ns] = (float(place), max(float(speed), 0.0))
            self._tell()

    def _begin_trip(self, stamp_ns: int) -> None:
        """Forget the trip before; what was decided for the first state of this one may be here already."""
        self._states.clear()
        for kept in (self._followed, self._plans):
            for later_ns in [at_ns for at_ns in kept if at_ns > stamp_ns]:
                del kept[later_ns]
        self._newest_ns = dict.fromkeys(self._newest_ns, stamp_ns - 1)

    def _on_solve(self, message: JointState) -> None:
        stamp_ns = ns_from_time(message.header.stamp)
        self._followed[stamp_ns] = decode_decision_record(message).rung is Rung.OPTIMAL
        self._newest_ns[Topic.SOLVE] = stamp_ns
        self._tell()

    def _on_plan(self, message: JointTrajectory) -> None:
        stamp_ns, plan = decode_plan(message)
        self._plans[stamp_ns] = (plan.times_s, plan.speeds_m_s)
        self._newest_ns[Topic.PLAN] = stamp_ns
        self._tell()

    def _tell(self) -> None:
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
                for told_ns in [at_ns for at_ns in kept if at_ns <= stamp_ns]:
                    del kept[told_ns]
            if followed is not None:  # else the controller left this state out
                self._on_tick(HostTick(stamp_ns, place_m, speed_m_s, *plan))
