"""The node's answers to the clock where the leader is another vehicle of the graph."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from nav_msgs.msg import Odometry
from trajectory_msgs.msg import JointTrajectory

from iptm_core.errors import ParameterError
from iptm_core.state import LeaderPreview, SlopePreview
from iptm_interfaces.codecs import decode_plan, ns_from_time
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_interfaces.vehicle_presence import VehiclePresence
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge, V2xBridge
from iptm_v2x_bridge.node_host_states import MISSING, HostStates
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters
from iptm_v2x_bridge.prediction.predictor import PredictorName
from iptm_v2x_bridge.road_knowledge import with_rules
from iptm_v2x_bridge.source import CycleSource, single_sample
from iptm_v2x_bridge.vehicle_ahead import VehicleAhead

_KEPT = 16
"""Ticks that are kept: neighbours keep step within one, and a repeated tick is asked for again."""


class VehicleAnswers:
    """The leader is the vehicle ahead: its odometry is its state, its plan the preview of its motion.

    A tick is answered when both of that stamp are there, so it does not matter what arrives first. The
    simulated link delays and loses plans as it does the predictions of a cycle. When the vehicle has gone
    from the graph, ticks are answered as if it braked to a halt.
    """

    def __init__(
        self,
        node: SuiteNode,
        source: CycleSource,
        options: BridgeNodeParameters,
        retry: Callable[[], None],
    ) -> None:
        """Listen to the vehicle ahead.

        Args:
            node: the bridge node.
            source: gives the road.
            options: parameters of the node.
            retry: called whenever something missing may have arrived.

        Raises:
            ParameterError: the vehicle ahead is not named.
        """
        self._name = options.vehicle_ahead
        if not self._name.strip("/"):
            raise ParameterError(
                f"vehicle_ahead is {self._name!r} with leader_source vehicle; allowed: the namespace "
                "of a vehicle"
            )
        self._source, self._options, self._retry = source, options, retry
        self._vehicle = VehicleAhead(options.leader_length_m, _KEPT)
        self._host = HostStates(node, retry, is_counted=True) if options.keeps_rules else None
        self._model = options.model().values
        self._bridge, self._ruled = self._before = self._fresh()
        self._missing = ""
        self._assumed = 0
        self._states = VehiclePresence(node, self._name, Topic.PLANT_ODOMETRY, retry)
        self._plans = VehiclePresence(node, self._name, Topic.PLAN, retry)
        node.listen(Topic.PLANT_ODOMETRY, self._on_odometry, vehicle=self._name)
        node.listen(Topic.PLAN, self._on_plan, vehicle=self._name)

    def _on_odometry(self, message: Odometry) -> None:
        position_m = float(message.pose.pose.position.x)
        speed_m_s = float(message.twist.twist.linear.x)
        if not (math.isfinite(position_m) and math.isfinite(speed_m_s)):
            return  # the tick stays unanswered; the report states what it waits for
        self._vehicle.note_state(ns_from_time(message.header.stamp), position_m, speed_m_s)
        self._retry()

    def _on_plan(self, message: JointTrajectory) -> None:
        stamp_ns, plan = decode_plan(message)
        self._vehicle.note_plan(stamp_ns, plan.times_s, plan.positions_m, plan.speeds_m_s)
        self._retry()

    def begin_trip(self) -> None:
        """Start a new trip; messages of the vehicle ahead on it may have arrived already."""
        self._before = self._bridge, self._ruled
        self._bridge, self._ruled = self._fresh()

    def _fresh(self) -> tuple[V2xBridge, TickBridge]:
        options = self._options
        bridge = V2xBridge(self._vehicle, options)
        return bridge, with_rules(bridge, options, self._source.route, self._model, options)

    def resume_trip(self) -> None:
        """Go on with the trip before the last beginning."""
        self._bridge, self._ruled = self._before

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        """Return the answer to a tick, None while state or plan of that stamp are missing."""
        vehicle = self._vehicle
        measured = vehicle.has_state(time_ns)
        planned = vehicle.has_plan(time_ns)
        if not (measured or (self._states.is_gone and vehicle.was_heard)):
            self._missing = f"waiting for the odometry of {self._name}"
            return None
        if not (planned or self._plans.is_gone):
            self._missing = f"waiting for the plan of {self._name}"
            return None
        host = (0.0, 0.0) if self._host is None else self._host.at(time_ns)
        self._missing = MISSING if host is None else ""
        if host is None:
            return None
        answer = self._ruled.answer(time_ns, *host)
        if measured and planned:
            return answer
        self._assumed += 1
        return replace(answer, predictor=str(PredictorName.ASSUMED_BRAKING))

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        """Return the state of the vehicle ahead at the tick; see `NodeAnswers`."""
        return single_sample(answer.leader)

    def is_heard(self) -> bool:
        """Return True, as this source has no other outputs."""
        return True

    def missing(self) -> str:
        """Return what is waited for, empty if nothing is."""
        return self._missing

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {
            "vehicle_ahead": self._name,
            "predictions_sent": self._bridge.sent,
            "dropouts": self._bridge.lost,
            "assumed_ticks": self._assumed,
        }

    def slope_ahead(self) -> SlopePreview:
        """Return the slope of the whole road."""
        return self._source.slope_ahead()

    def close(self) -> None:
        """Nothing is held."""
