"""The node's parameters, and its answers to the clock: of any kind, for a cycle, no leader, and a vehicle."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from sensor_msgs.msg import JointState, PointCloud2

from iptm_core.braking import RangeSensorSettings
from iptm_core.declaration import parameter
from iptm_core.errors import ParameterError
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.routes import Route
from iptm_core.settings import (
    FrameSettings,
    LeaderSource,
    ModelSettings,
    TickSettings,
    TripSettings,
)
from iptm_core.state import NS_PER_S, LeaderPreview
from iptm_ros.codecs import decode_motion, decode_plan
from iptm_ros.node_health import VehiclePresence
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic
from iptm_v2x_bridge.bridge import (
    BridgeAnswer,
    CycleSource,
    EmptyRoad,
    PreviewSource,
    TickBridge,
    V2xBridge,
    sampling_times_s,
    single_sample,
)
from iptm_v2x_bridge.prediction.predictor import PredictorName
from iptm_v2x_bridge.prediction.road_rules import RoadRules
from iptm_v2x_bridge.rules_of_the_road import given_rules, with_rules
from iptm_v2x_bridge.settings import LeaderSettings


@dataclass(frozen=True)
class BridgeNodeParameters(
    RangeSensorSettings,
    LeaderSettings,
    FrameSettings,
    TickSettings,
    ModelSettings,
    RoadAheadSettings,
    TripSettings,
):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    initial_gap_m: float = parameter(
        15.0, "position of the leader at t = 0, the ego vehicle being at 0", "m", 1.0, 500.0
    )
    start_time_s: float = parameter(
        0.0,
        "cycle: trip time at which a trip that starts from a saved state is taken up; predictions of the "
        "ticks before are known then",
        "s",
        0.0,
        1e6,
    )

    @property
    def earlier_ticks_ns(self) -> range:
        """Ticks before the one at which the trip is taken up, in integer nanoseconds."""
        return range(0, round(self.start_time_s * NS_PER_S), round(self.period_s * NS_PER_S))


KEPT = 16
"""States and plans kept: neighbours keep step within one tick, and a repeated tick is asked for again."""

Trip = TypeVar("Trip")


@dataclass(frozen=True)
class AnswerContext:
    """What answers are built from.

    Attributes:
        node: takes part in the graph.
        options: parameters of the node.
        route: road, and the leader of the cycle.
        retry: called whenever something missing may have arrived.
    """

    node: SuiteNode
    options: BridgeNodeParameters
    route: Route
    retry: Callable[[], None]


class TickAnswers(ABC, Generic[Trip]):
    """Answers a tick once everything that belongs to it has arrived.

    The state of a trip is created at its first tick. The previous trip is kept in case a stray clock message
    began the present one.

    Attributes:
        missing: the awaited input, empty for none.
    """

    def __init__(self, context: AnswerContext, *, needs_ego: bool) -> None:
        """Set up the answers.

        Args:
            context: node, parameters and road.
            needs_ego: wait for the position of the ego vehicle.

        Raises:
            ParameterError: a rule of the road is not usable.
        """
        self.missing = ""
        self._options, self._route, self._retry = context.options, context.route, context.retry
        self._model = self._options.model().values
        self._given = given_rules(self._options, self._route)
        self._trip: tuple[Trip, TickBridge] | None = None
        self._before: tuple[Trip, TickBridge] | None = None
        self._ego: dict[int, tuple[float, float]] | None = {} if needs_ego else None
        if needs_ego:
            context.node.listen(Topic.PLANT_STATE, self._on_ego)

    def _on_ego(self, message: JointState) -> None:
        stamp_ns, *state = decode_motion(message)
        if self._ego is None or not all(map(math.isfinite, state)):
            return  # the tick stays unanswered; the report states what is waited for
        self._ego[stamp_ns] = state[0], state[1]
        while len(self._ego) > KEPT:
            del self._ego[next(iter(self._ego))]
        self._retry()

    def begin_trip(self) -> None:
        """Start a new trip, keeping the previous one."""
        self._before, self._trip = self._trip, None

    def resume_trip(self) -> None:
        """Resume the trip before the last start."""
        self._trip = self._before

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        """Return the answer to a tick, None while something is missing."""
        trip, bridge = self._trip = self._trip or self._start(time_ns)
        ego = (0.0, 0.0) if self._ego is None else self._ego.get(time_ns)
        self.missing = self._awaited(trip, time_ns)
        if ego is None:
            self.missing = self.missing or "waiting for the position of the ego vehicle"
        if self.missing or ego is None:
            return None
        return self._checked(trip, bridge.answer(time_ns, *ego))

    def _with_rules(
        self, inner: TickBridge, rules: RoadRules | None = None, start_timestamp_ms: int = 0
    ) -> TickBridge:
        options = self._options
        rules = rules or self._given
        return with_rules(
            inner, options, self._route, self._model, options, rules, start_timestamp_ms
        )

    @abstractmethod
    def _start(self, time_ns: int) -> tuple[Trip, TickBridge]:
        """Return what belongs to a trip that begins with a tick, and the bridge that answers its ticks."""

    def _awaited(self, trip: Trip, time_ns: int) -> str:  # noqa: ARG002
        """Take in what has arrived by a tick; return the input that it lacks, empty for none."""
        return ""

    def _checked(self, trip: Trip, answer: BridgeAnswer) -> BridgeAnswer:  # noqa: ARG002
        return answer

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        """Return what a range sensor measures of the leader from the tick of an answer to the next one."""
        return single_sample(answer.leader, answer.time_ns / NS_PER_S)

    @abstractmethod
    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""

    def close(self) -> None:
        """Release its resources."""


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
        from iptm_v2x_bridge.range_sensor import VehicleAhead  # noqa: PLC0415  most leaders are none

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
