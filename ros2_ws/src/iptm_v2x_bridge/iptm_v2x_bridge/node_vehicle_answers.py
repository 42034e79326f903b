"""The node's answers to the clock where the leader is a cycle, no vehicle, or a vehicle of the same graph."""

from __future__ import annotations

import math
from dataclasses import replace

from sensor_msgs.msg import JointState, PointCloud2

from iptm_core.errors import ParameterError
from iptm_core.settings import LeaderSource
from iptm_core.state import LeaderPreview
from iptm_ros.codecs import decode_motion, decode_plan
from iptm_ros.node_health import VehiclePresence
from iptm_ros.topics import Topic
from iptm_v2x_bridge.bridge import (
    BridgeAnswer,
    CycleSource,
    EmptyRoad,
    PreviewSource,
    TickBridge,
    V2xBridge,
    sampling_times_s,
)
from iptm_v2x_bridge.node_answers import KEPT, AnswerContext, TickAnswers
from iptm_v2x_bridge.prediction.predictor import PredictorName
from iptm_v2x_bridge.range_sensor import VehicleAhead


class CycleAnswers(TickAnswers[V2xBridge]):
    """The leader drives a cycle, and a simulated link delays and loses its predictions; or there is none."""

    def __init__(self, context: AnswerContext) -> None:
        super().__init__(context, needs_ego=context.options.keeps_rules)
        self._source: PreviewSource = CycleSource(context.route)
        if context.options.leader_source is LeaderSource.NONE:
            self._source = EmptyRoad()

    def _start(self, time_ns: int) -> tuple[V2xBridge, TickBridge]:  # noqa: ARG002
        bridge = V2xBridge(self._source, self._options, self._options.earlier_ticks_ns)
        return bridge, self._with_rules(bridge)

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        """Return the source at every sampling time of the range sensor; see `TickAnswers`."""
        options = self._options
        return self._source.sampled(
            sampling_times_s(answer.time_ns, options.period_s, options.monitor_period_s)
        )

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return _sent(self._trip)


class VehicleAnswers(TickAnswers[V2xBridge]):
    """The leader is the vehicle ahead: its state comes from its plant, the preview of its motion is its plan.

    A tick is answered when both of that stamp are there, so it does not matter what arrives first. The
    simulated link delays and loses plans as it does the predictions of a cycle. When the vehicle has gone
    from the graph, ticks are answered as if it braked to a halt.
    """

    def __init__(self, context: AnswerContext) -> None:
        """Listen to the vehicle ahead.

        Raises:
            ParameterError: the vehicle ahead is not named.
        """
        name = self._name = context.options.vehicle_ahead
        if not name.strip("/"):
            raise ParameterError(
                f"vehicle_ahead is {name!r} with leader_source vehicle; allowed: the namespace of a vehicle"
            )
        super().__init__(context, needs_ego=context.options.keeps_rules)
        self._vehicle = VehicleAhead(context.options.leader_length_m, KEPT)
        self._assumed = 0
        node, retry = context.node, context.retry
        self._states = VehiclePresence(node, name, Topic.PLANT_STATE, retry)
        self._plans = VehiclePresence(node, name, Topic.PLAN, retry)
        node.listen(Topic.PLANT_STATE, self._on_state, vehicle=name)
        node.listen(Topic.PLAN, self._on_plan, vehicle=name)

    def _on_state(self, message: JointState) -> None:
        stamp_ns, *state = decode_motion(message)
        if not all(map(math.isfinite, state)):
            return  # the tick stays unanswered; the report states what is waited for
        self._vehicle.note_state(stamp_ns, *state)
        self._retry()

    def _on_plan(self, message: PointCloud2) -> None:
        stamp_ns, plan = decode_plan(message)
        self._vehicle.note_plan(stamp_ns, plan.times_s, plan.positions_m, plan.speeds_m_s)
        self._retry()

    def _start(self, time_ns: int) -> tuple[V2xBridge, TickBridge]:  # noqa: ARG002
        bridge = V2xBridge(self._vehicle, self._options)
        return bridge, self._with_rules(bridge)

    def _awaited(self, trip: V2xBridge, time_ns: int) -> str:  # noqa: ARG002
        vehicle = self._vehicle
        if not (vehicle.has_state(time_ns) or (self._states.is_gone and vehicle.was_heard)):
            return f"waiting for the state of {self._name}"
        if not (vehicle.has_plan(time_ns) or self._plans.is_gone):
            return f"waiting for the plan of {self._name}"
        return ""

    def _checked(self, trip: V2xBridge, answer: BridgeAnswer) -> BridgeAnswer:  # noqa: ARG002
        time_ns, vehicle = answer.time_ns, self._vehicle
        if vehicle.has_state(time_ns) and vehicle.has_plan(time_ns):
            return answer
        self._assumed += 1
        return replace(answer, predictor=str(PredictorName.ASSUMED_BRAKING))

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {
            "vehicle_ahead": self._name,
            **_sent(self._trip),
            "assumed_ticks": self._assumed,
        }


def _sent(trip: tuple[V2xBridge, TickBridge] | None) -> dict[str, object]:
    sent, lost = (trip[0].sent, trip[0].lost) if trip else (0, 0)
    return {"predictions_sent": sent, "dropouts": lost}
