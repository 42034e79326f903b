"""The controller as a node: answers every state that it can match with a decision of the same stamp."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from iptm_controller.decision import ControllerMemory, Decision
from iptm_controller.node_parameters import CHANGEABLE, ControllerNodeParameters, SettingsChanges
from iptm_controller.node_reports import (
    DecisionCounts,
    OperatorWatch,
    decision_values,
    plan_trajectory,
    road_warning,
    situation,
)
from iptm_controller.node_ticks import (
    OTHER_INPUTS,
    CatchUp,
    CompleteTick,
    MatchedSet,
    StampMatcher,
    read_measurements,
)
from iptm_core.decision_record import DrivingMode
from iptm_core.errors import MessageError, ServiceError
from iptm_core.frozen import replace
from iptm_core.saved_state import write_state
from iptm_core.state import (
    NS_PER_S,
    SlopePreview,
)
from iptm_ros.codecs import (
    decode_leader_preview,
    decode_road_ahead,
    decode_slope,
    encode_command,
    encode_decision_record,
    plan_bytes,
    read_numbers,
    stamp_of,
)
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.node_health import Watchdog
from iptm_ros.parameters import FrictionInput, declare_parameters
from iptm_ros.services import Service, state_path
from iptm_ros.stamp_gate import Verdict
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import CONTROLLER, TOPICS, Topic

CHECKS_PER_TIMEOUT = 5.0
PLANT_TIMEOUT_S = 5.0
"""Wall time without any part of a state after which the plant is reported as stopped."""
UNMATCHED_AFTER_TIMEOUTS = 2.0
"""Times `input_timeout_s` for which states may arrive without one that can be answered."""
LEAST_WAIT_S = 0.02
"""Wall time for which inputs are waited for however fast trip time runs."""


class ControllerNode(SuiteNode):
    """Matches state, leader, preview and road by stamp, decides, and publishes the decision."""

    PARAMETERS = ControllerNodeParameters

    def __init__(self, **options: Any) -> None:
        super().__init__("controller", **options)
        self._options = declare_parameters(self, self.PARAMETERS, CHANGEABLE)
        self.reject_unknown_parameters()
        self.use_frame_prefix(self._options.frame_prefix)
        self._controller = self._options.build_controller()
        self._changes = SettingsChanges(self, self._options)
        self._model = self._options.model().values
        self._watch = OperatorWatch(self._model, self._options)
        self._start_memories = self._options.start_memories()
        self._before: tuple[int, Callable[[], ControllerMemory]] | None = None
        self._trip_before = (self._controller.memory, self._watch)
        self._slope: SlopePreview | None = None
        self._slope_fault = ""
        self._matcher = StampMatcher(
            Topic.PLANT_STATE, OTHER_INPUTS, is_complete=CompleteTick(self)
        )
        self._waiting_since_s: float | None = None
        self._unanswered_since_s: float | None = None
        self._held: MatchedSet[Topic] | None = None
        self._counts = DecisionCounts()
        self._catch_up = CatchUp(self, self._answer)
        self._is_followed = True
        self._last: Decision | None = None
        self._last_ns = 0
        self._command_publisher = self.advertise(Topic.COMMAND)
        self._plan_publisher = self.advertise(Topic.PLAN)
        self._solve_publisher = self.advertise(Topic.SOLVE)
        self._reporter = DiagnosticsReporter.of_node(self, "optimal control")
        self.listen(Topic.SLOPE, self._on_slope)
        for topic, decode in (
            (Topic.ROAD_AHEAD, decode_road_ahead),
            (Topic.LEADER_PREVIEW, decode_leader_preview),
        ):
            self.listen(topic, partial(self._on_decoded, topic, decode))
        self.listen(Topic.ENGAGEMENT, self._on_engagement)
        self.listen(Topic.ARRIVAL_COST, self._changes.on_arrival_cost)
        self._friction = FrictionInput(self, self._options.road_friction)
        for topic in (Topic.LEADER, Topic.PLANT_STATE):
            self.listen(topic, partial(self._on_stamped, topic))
        self.watch_peers(Topic.PLANT_STATE, Topic.LEADER, Topic.COMMAND)
        self._watchdog = Watchdog(PLANT_TIMEOUT_S, lambda _: self._report()).attach(self)
        self.every(self._options.input_timeout_s / CHECKS_PER_TIMEOUT, self._check_inputs)
        self.every(REPORT_PERIOD_S, self._report)
        self.serve(Service.SAVE_CONTROLLER, self._save_state)
        self.show_life()
        self._report()

    # --- inputs

    def _on_slope(self, message: Float64MultiArray) -> None:
        try:
            self._slope = decode_slope(message)
            self._slope_fault = ""
        except MessageError as error:
            self._slope_fault = str(error)
        if self._held is not None:
            self._answer(self._held)

    def _on_stamped(self, topic: Topic, message: Any) -> None:
        self._put(topic, stamp_of(message), message)

    def _on_engagement(self, message: JointState) -> None:
        """Note whether a car follows the commands, or its driver drives."""
        mode = read_numbers(Topic.ENGAGEMENT, message)[0]
        self._is_followed = mode == DrivingMode.ENGAGED.number

    def _on_decoded(
        self, topic: Topic, decode: Callable[[Any], tuple[int, Any]], message: Any
    ) -> None:
        try:
            stamp_ns, value = decode(message)
        except MessageError as error:
            # Without a stamp it cannot be matched: the tick is answered when the inputs time out,
            # unless a newer state arrives first.
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)
            return
        self._put(topic, stamp_ns, value)

    def _put(self, topic: Topic, stamp_ns: int, value: Any) -> None:
        duplicates = self._matcher.counts["duplicate"]
        matched = self._matcher.put(topic, stamp_ns, value)
        if self._matcher.counts["duplicate"] > duplicates:
            self.health.note_contradiction(TOPICS[topic].publisher)
        if matched is not None:
            self._on_matched(matched)
            return
        is_state = topic is Topic.PLANT_STATE
        if is_state:
            self._watchdog.feed()
        if stamp_ns != self._matcher.last_ns:
            self._await_inputs(is_state=is_state)

    def _await_inputs(self, *, is_state: bool) -> None:
        """Begin or end the wait for the rest of a tick, a part of which has arrived."""
        now_s = self.awake.now_s()
        if is_state and self._unanswered_since_s is None:
            self._unanswered_since_s = now_s
        if not self._matcher.is_waiting:
            return
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        # Where trip time runs fast, a plant has lost its controller long before a wall-clock timeout.
        elif (
            self._matcher.backlog_ns > NS_PER_S * self._options.input_timeout_s
            and now_s - self._waiting_since_s >= LEAST_WAIT_S
        ):
            self._answer_incomplete()

    def _on_matched(self, matched: MatchedSet[Topic]) -> None:
        """Answer a complete set, or the last one once more."""
        self._follow(matched)
        self._watchdog.timeout_s = max(PLANT_TIMEOUT_S, self._matcher.gate.quiet_s)
        self._watchdog.feed()
        if matched.verdict is Verdict.REPEATED:
            if self._last is not None and matched.stamp_ns == self._last_ns:
                self._publish(matched.stamp_ns, self._last)
        elif self._slope is None and not self._slope_fault and self._last is None:
            self._held = matched  # the road comes once, but maybe after the first state
            if self._waiting_since_s is None:
                self._waiting_since_s = self.awake.now_s()
        elif not self._catch_up.takes(matched):
            self._answer(matched)

    def _follow(self, matched: MatchedSet[Topic]) -> None:
        """Restart for a new trip, or resume the one before a stray start."""
        start = self._start_memories.get(matched.stamp_ns)
        if self._before is None:
            if start is None and self._options.start_state:
                self.get_logger().warning("the trip does not start where start_state was saved")
            self._controller.memory = start or ControllerMemory()
        elif matched.verdict is Verdict.NEW_TRIP and start is not None:
            self._trip_before = (self._controller.memory, self._watch)
            self._controller.memory = start
            self._watch = OperatorWatch(self._model, self._options)
        elif matched.verdict is Verdict.RESUMED:
            self._controller.memory, self._watch = self._trip_before

    def _check_inputs(self) -> None:
        """Answer a tick whose inputs do not arrive with what there is."""
        if self._waiting_since_s is None:
            return
        if self.awake.now_s() - self._waiting_since_s >= self._options.input_timeout_s:
            self._answer_incomplete()

    def _answer_incomplete(self) -> None:
        matched = self._held or self._matcher.take_incomplete()
        if matched is None:
            self._waiting_since_s = None  # what is there has stamps of no trip
        else:
            self._follow(matched)
            self._answer(matched)

    # --- answers

    def _answer(self, matched: MatchedSet[Topic]) -> None:
        self._waiting_since_s = None
        self._unanswered_since_s = None
        self._held = None
        started_s = time.monotonic()
        self._take_changes_over(matched.stamp_ns)
        measured = read_measurements(matched.values, self._slope)
        measured = replace(measured, is_followed=self._is_followed)
        self._before = (matched.stamp_ns, self._controller.kept_memory())
        self._controller.lead.friction = self._friction.coefficient
        decision = self._controller.decide(measured)
        self._last, self._last_ns = decision, matched.stamp_ns
        self._publish(matched.stamp_ns, decision)
        self._watch.update(measured, decision)
        self._counts.add(decision)
        self._report()
        self._catch_up.note_answer(started_s)

    def _take_changes_over(self, stamp_ns: int) -> None:
        """Apply changed settings, and report from which tick on."""
        if self._changes.take_over(self._controller, stamp_ns):
            self._options = self._changes.options
            self._last_ns = stamp_ns
            level, _ = self._situation()
            self._reporter.report(stamp_ns, level, "settings have been changed", self._values)

    def _save_state(self) -> str:
        if self._before is None:
            raise ServiceError("no decision has been made; allowed: a state of a trip under way")
        stamp_ns, memory = self._before
        path = state_path(self, self._options.state_folder, stamp_ns)
        write_state(path, self._options.saved_state(stamp_ns, memory()))
        return f"saved {stamp_ns / NS_PER_S:g} s in {path}"

    def _publish(self, stamp_ns: int, decision: Decision) -> None:
        """Publish the command last, so that it completes the tick."""
        prefix = self.frame_prefix
        self._solve_publisher.publish(
            encode_decision_record.data(prefix, stamp_ns, decision.record)
        )
        plan = plan_bytes(plan_trajectory(decision.plan), stamp_ns, prefix)
        self._plan_publisher.publish(plan)
        self._command_publisher.publish(encode_command.data(prefix, stamp_ns, decision.command))

    # --- diagnostics

    def _report(self) -> None:
        level, reason = self._situation()
        self._reporter.report(self._last_ns, level, reason, self._values)

    def _values(self) -> dict[str, object]:
        values: dict[str, object] = {
            "strategy": self._options.strategy,
            "horizon": self._options.horizon,
            **self._changes.values,
            "limited_ticks": self._counts.limited,
            "skipped_ticks": self._catch_up.skipped_ticks,
            "road_friction": self._friction.coefficient,
            "late_messages": self._matcher.counts["late"],
            "stray_stamps": self._matcher.gate.strays,
        }
        values.update(self._counts.values)
        if self._last is not None:
            values.update(decision_values(self._last))
            values.update(self._watch.values)
        return values

    def _situation(self) -> tuple[Level, str]:
        """Return the fault of the inputs as a whole, else the situation of the last decision."""
        if self._watchdog.is_silent:
            return Level.STALE, "no state arrives: the plant has stopped or cannot be heard"
        patience_s = UNMATCHED_AFTER_TIMEOUTS * self._options.input_timeout_s
        since_s = self._unanswered_since_s
        if since_s is not None and self.awake.now_s() - since_s > patience_s:
            return Level.ERROR, "states arrive, but none that can be answered"
        if self._last is None and self._matcher.missing() is not None:
            return Level.WARN, "inputs of a tick are incomplete"
        if self._catch_up.is_skipping:
            return Level.WARN, "decisions take longer than ticks, some of which are skipped"
        road = road_warning(self._slope_fault, is_known=self._slope is not None)
        begun_anew = self._matcher.gate.has_restarted
        return situation(self._last, road, self._watch, begun_anew=begun_anew)


def main() -> None:
    """Run the node."""
    sys.exit(node_main(CONTROLLER, ControllerNode, ControllerNodeParameters))


if __name__ == "__main__":
    main()
