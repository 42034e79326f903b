"""The bridge as a node: answers every `/clock` with the leader and the prediction of that stamp."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

from iptm_core.settings import LeaderSource, PreviewMode
from iptm_ros.codecs import (
    encode_leader,
    encode_slope,
    leader_preview_bytes,
    road_ahead_bytes,
    stamp_ns_of,
)
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.node_health import Watchdog
from iptm_ros.parameters import declare_parameters
from iptm_ros.stamp_gate import StampGate, Verdict
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import BRIDGE, TOPICS, Topic
from iptm_v2x_bridge.bridge import BridgeAnswer, CycleSource
from iptm_v2x_bridge.node_answers import (
    AnswerContext,
    BridgeNodeParameters,
    CycleAnswers,
    TickAnswers,
    VehicleAnswers,
)
from iptm_v2x_bridge.prediction.predictor import PredictorName

CLOCK_TIMEOUT_S = 5.0
_FREE = (Level.OK, "no vehicle ahead, the rules of the road are kept")


def _answers_of(source: LeaderSource) -> Callable[[AnswerContext], TickAnswers[Any]]:
    if source in {LeaderSource.CYCLE, LeaderSource.NONE}:
        return CycleAnswers
    if source is LeaderSource.VEHICLE:
        return VehicleAnswers
    # Only here: what decodes messages takes long to import, and most bridges hear none.
    from iptm_v2x_bridge.node_leader_answers import ANSWERS  # noqa: PLC0415

    return ANSWERS[source]


class BridgeNode(SuiteNode):
    """Publishes `v2x/slope` once, then the road ahead, leader, samples and preview for every `/clock`.

    The clock sets the pace in lock-step and in real time alike. A stray clock is not answered, as the
    controller would lose the trip. The same clock again gets the same answer.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("v2x_bridge", **options)
        self._options = declare_parameters(self, BridgeNodeParameters)
        self.reject_unknown_parameters()
        self.use_frame_prefix(self._options.frame_prefix)
        route = self._options.trip_route(self._options.initial_gap_m)
        answers = _answers_of(self._options.leader_source)
        self._answers = answers(AnswerContext(self, self._options, route, self._answer_clock))
        self._gate = StampGate()
        self._turned_away_s = -math.inf
        self._answer: BridgeAnswer | None = None
        self._unanswered_ns: int | None = None
        # The first one: who hears of another topic of this node has found this one, too.
        self._road_publisher = self.advertise(Topic.ROAD_AHEAD)
        self._leader_publisher = self.advertise(Topic.LEADER)
        self._samples_publisher = self.advertise(Topic.LEADER_SAMPLES)
        self._preview_publisher = self.advertise(Topic.LEADER_PREVIEW)
        self._slope_publisher = self.advertise(Topic.SLOPE)
        self._slope_publisher.publish(encode_slope(CycleSource(route).slope_ahead()))
        self._reporter = DiagnosticsReporter.of_node(self, "preview")
        self._watchdog = Watchdog(CLOCK_TIMEOUT_S, lambda _: self._report()).attach(self)
        self.watch_peers(Topic.CLOCK, Topic.LEADER)
        self.every(REPORT_PERIOD_S, self._report)
        self.show_life()
        self.listen(Topic.CLOCK, self._on_clock, raw=True)
        self._report()

    def _on_clock(self, clock: bytes) -> None:
        time_ns = stamp_ns_of(clock)
        if not self._options.is_tick(time_ns):
            return
        verdict = self._gate.judge(time_ns)
        if verdict is Verdict.STRAY:
            self._turned_away_s = self.awake.now_s()
            self.health.note_contradiction(TOPICS[Topic.CLOCK].publisher)
            self._report()
            return
        if verdict is Verdict.NEW_TRIP and time_ns == 0:
            self._answers.begin_trip()
        elif verdict is Verdict.RESUMED:
            self._answers.resume_trip()
        self._watchdog.timeout_s = max(CLOCK_TIMEOUT_S, self._gate.quiet_s)
        self._watchdog.feed()
        self._unanswered_ns = time_ns
        self._answer_clock()
        if not self._answers.missing:
            # Missing inputs have a moment to arrive; the timer reports the ones that do not.
            self._report()

    def _answer_clock(self) -> None:
        """Publish the answer to the last tick; the same tick again gets the same answer."""
        time_ns = self._unanswered_ns
        answer = None if time_ns is None else self._answers.answer(time_ns)
        if time_ns is None or answer is None:
            return
        self._answer, self._unanswered_ns = answer, None
        self._publish(answer)

    def _publish(self, answer: BridgeAnswer) -> None:
        time_ns, has_leader = answer.time_ns, answer.leader is not None
        prefix = self.frame_prefix
        road = road_ahead_bytes(answer.road, time_ns, prefix, has_leader=has_leader)
        self._road_publisher.publish(road)
        if answer.leader is not None:
            # The stamp is the clock's time to the nanosecond, however late the hour.
            leader = encode_leader.data(prefix, answer.leader, time_ns)
            self._leader_publisher.publish(leader)
        samples = self._answers.samples(answer)
        measured = leader_preview_bytes(samples, time_ns, prefix, Topic.LEADER_SAMPLES)
        self._samples_publisher.publish(measured)
        self._preview_publisher.publish(leader_preview_bytes(answer.preview, time_ns, prefix))

    def _report(self) -> None:
        answer = self._answer
        level, reason = self._situation(answer)
        time_ns = answer.time_ns if answer else 0
        self._reporter.report(time_ns, level, reason, self._values)

    def _values(self) -> dict[str, object]:
        answer = self._answer
        values: dict[str, object] = {
            "cycle": self._options.cycle,
            "preview_mode": self._options.preview_mode.value,
            "seed": self._options.seed,
            "stray_stamps": self._gate.strays,
            **self._answers.report(),
        }
        if answer is not None:
            values["preview_age_s"] = answer.preview_age_s
            values["preview_points"] = int(answer.preview.times_s.size)
            if answer.road is not None:
                values["stops_ahead"] = len(answer.road.stops)
        return values

    def _situation(self, answer: BridgeAnswer | None) -> tuple[Level, str]:
        waits = self._unanswered_ns is not None
        missing = self._answers.missing if waits else ""
        if answer is None:
            return Level.WARN, missing or "waiting for the clock"
        if self._watchdog.is_silent:
            if self.awake.now_s() - self._turned_away_s < CLOCK_TIMEOUT_S:
                return Level.ERROR, "clocks arrive that do not belong to the trip, and no others"
            return Level.STALE, "the clock has stopped"
        if missing:
            return Level.WARN, missing
        if answer.leader is None:
            return _FREE if answer.road is not None else (Level.WARN, "no leader is known")
        if answer.contested:
            return (
                Level.WARN,
                "messages of the leader contradict each other or the range sensor",
            )
        if answer.predictor == PredictorName.ASSUMED_BRAKING:
            return Level.WARN, "the leader is not heard any more and taken to brake to a halt"
        return self._preview_situation(answer)

    def _preview_situation(self, answer: BridgeAnswer) -> tuple[Level, str]:
        if self._options.leader_source is LeaderSource.RANGE_SENSOR and not answer.predictor:
            return Level.OK, "leader by the range sensor, no preview"
        if self._options.preview_mode is PreviewMode.NONE:
            return Level.OK, "leader only, no preview by choice"
        if answer.preview.times_s.size == 0:
            return Level.WARN, "no prediction received yet"
        if answer.preview_age_s > self._options.preview_length_s:
            return Level.WARN, "the prediction held ends in the past"
        # Single losses are counted, not reported: they come and go with every tick.
        return Level.OK, "predictions arrive"

    def destroy_node(self) -> None:
        """Give the socket back, too."""
        self._answers.close()
        super().destroy_node()


def main() -> None:
    """Run the node."""
    sys.exit(node_main(BRIDGE, BridgeNode, BridgeNodeParameters))


if __name__ == "__main__":
    main()
