"""The bridge as a node: answers every `/clock` with the leader and the prediction of that stamp."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from rosgraph_msgs.msg import Clock

from iptm_core.routes import SLOPE_CHOICES, build_route
from iptm_interfaces.codecs import (
    encode_leader,
    encode_leader_preview_bytes,
    encode_slope,
    ns_from_time,
)
from iptm_interfaces.command_line import node_main
from iptm_interfaces.diagnostics import DiagnosticsReporter, Level
from iptm_interfaces.parameters import declare_parameters, parameter
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_interfaces.watchdog import Watchdog
from iptm_v2x_bridge.bridge import BridgeAnswer, BridgeSettings, PreviewMode, V2xBridge
from iptm_v2x_bridge.cycle_source import CycleSource
from iptm_v2x_bridge.imperfections import MAX_BURST, MAX_SEED, Imperfections
from iptm_v2x_bridge.source import MAX_LENGTH_S, MIN_LENGTH_S, MIN_STEP_S, PreviewGrid

CLOCK_TIMEOUT_S = 5.0
REPORT_PERIOD_S = 1.0
MATCHING_PERIOD_S = 0.02


@dataclass(frozen=True)
class BridgeParameters:
    """Parameters of the node; ranges and units are in the declarations."""

    cycle: str = parameter(
        "wltc_class3b", "driving cycle of the leader: a name, or the path of a .csv file"
    )
    slope: str = parameter("as_designed", "slope of the road", choices=SLOPE_CHOICES)
    initial_gap_m: float = parameter(
        15.0, "position of the leader at t = 0, the host being at 0", "m", 1.0, 500.0
    )
    preview_mode: str = parameter(
        PreviewMode.FULL.value,
        "what the host is told about the future of the leader",
        choices=tuple(mode.value for mode in PreviewMode),
    )
    preview_length_s: float = parameter(
        60.0, "how far a prediction reaches", "s", MIN_LENGTH_S, MAX_LENGTH_S
    )
    preview_step_s: float = parameter(
        1.0, "time between the nodes of a prediction", "s", MIN_STEP_S, MAX_LENGTH_S
    )
    latency_s: float = parameter(0.0, "delay from generation to reception", "s", 0.0, 3600.0)
    dropout_probability: float = parameter(0.0, "share of the predictions lost", "", 0.0, 1.0)
    dropout_burst: int = parameter(
        1, "predictions lost in a row by one disturbance", "", 1, MAX_BURST
    )
    noise_std_m_s: float = parameter(
        0.0, "standard deviation of the predicted speed, far ahead", "m/s", 0.0, 20.0
    )
    noise_correlation_s: float = parameter(
        10.0, "correlation time of the speed error along a prediction", "s", 0.1, 3600.0
    )
    seed: int = parameter(0, "seed of loss and error", "", 0, MAX_SEED)
    expected_peers: int = parameter(
        0, "subscribers of v2x/leader_preview to wait for before the first answer", "", 0, 100
    )

    def settings(self) -> BridgeSettings:
        """Return the settings of the bridge."""
        return BridgeSettings(
            mode=PreviewMode(self.preview_mode),
            grid=PreviewGrid(self.preview_length_s, self.preview_step_s),
            imperfections=Imperfections(
                latency_s=self.latency_s,
                dropout_probability=self.dropout_probability,
                dropout_burst=self.dropout_burst,
                noise_std_m_s=self.noise_std_m_s,
                noise_correlation_s=self.noise_correlation_s,
                seed=self.seed,
            ),
        )


class BridgeNode(SuiteNode):
    """Publishes `v2x/slope` once, then `v2x/leader` and `v2x/leader_preview` for every `/clock`.

    The clock sets the pace in lock-step and in real time alike, so the node has no timer of its own
    but for its diagnostics and the wait for its peers.
    """

    def __init__(self) -> None:
        super().__init__("v2x_bridge")
        self._parameters_used = declare_parameters(self, BridgeParameters)
        self.reject_unknown_parameters()
        source = CycleSource(
            build_route(
                self._parameters_used.cycle,
                self._parameters_used.slope,
                initial_gap_m=self._parameters_used.initial_gap_m,
            )
        )
        self._bridge = V2xBridge(source, self._parameters_used.settings())
        self._answer: BridgeAnswer | None = None
        self._unanswered_ns: int | None = None
        self._leader_publisher = self.advertise(Topic.LEADER)
        self._preview_publisher = self.advertise(Topic.LEADER_PREVIEW)
        self._slope_publisher = self.advertise(Topic.SLOPE)
        self._slope_publisher.publish(encode_slope(source.slope_ahead()))
        self._reporter = DiagnosticsReporter.of_node(self, "preview")
        self._watchdog = Watchdog(CLOCK_TIMEOUT_S, lambda _: self._report()).attach(self)
        self.every(REPORT_PERIOD_S, self._report)
        self._matching_timer = self.every(MATCHING_PERIOD_S, self._answer_if_matched)
        self.listen(Topic.CLOCK, self._on_clock)
        self._report()

    def _on_clock(self, message: Clock) -> None:
        time_ns = ns_from_time(message.clock)
        if time_ns < 0:
            return  # no trip has such a time; the watchdog reports the missing clock
        self._watchdog.feed()
        self._unanswered_ns = time_ns
        if self._peers_matched():
            self._answer_clock()
        self._report()

    def _peers_matched(self) -> bool:
        """Return whether an answer would reach everyone; once true, it stays true."""
        if self._matching_timer.is_canceled():
            return True
        expected = self._parameters_used.expected_peers
        publishers = (self._leader_publisher, self._preview_publisher)
        if min(publisher.get_subscription_count() for publisher in publishers) < expected:
            return False
        self._matching_timer.cancel()
        return True

    def _answer_if_matched(self) -> None:
        """Answer the tick that came before the peers were found."""
        if self._peers_matched() and self._unanswered_ns is not None:
            self._answer_clock()

    def _answer_clock(self) -> None:
        """Publish the answer to the last tick; the same tick again gets the same answer."""
        time_ns, self._unanswered_ns = self._unanswered_ns, None
        if time_ns is None:
            return
        self._answer = self._bridge.answer(time_ns)
        self._leader_publisher.publish(encode_leader(self._answer.leader))
        self._preview_publisher.publish(encode_leader_preview_bytes(self._answer.preview, time_ns))

    def _report(self) -> None:
        answer = self._answer
        level, reason = self._situation(answer)
        values: dict[str, object] = {
            "cycle": self._parameters_used.cycle,
            "preview_mode": self._parameters_used.preview_mode,
            "predictions_sent": self._bridge.sent,
            "dropouts": self._bridge.lost,
            "seed": self._parameters_used.seed,
        }
        if answer is not None:
            values["preview_age_s"] = answer.preview_age_s
            values["preview_points"] = int(answer.preview.times_s.size)
        self._reporter.report(answer.time_ns if answer else 0, level, reason, values)

    def _situation(self, answer: BridgeAnswer | None) -> tuple[Level, str]:
        if answer is None and self._unanswered_ns is not None:
            return Level.OK, "waiting for the expected peers"
        if answer is None:
            return Level.OK, "waiting for the clock"
        if self._watchdog.is_silent:
            return Level.STALE, "the clock has stopped"
        if self._parameters_used.preview_mode == PreviewMode.NONE.value:
            return Level.OK, "leader only, no preview by choice"
        if answer.preview.times_s.size == 0:
            return Level.WARN, "no prediction received yet"
        if answer.preview_age_s > self._parameters_used.preview_length_s:
            return Level.WARN, "the prediction held ends in the past"
        # Single losses are counted, not reported: they come and go with every tick.
        return Level.OK, "predictions arrive"


def main() -> None:
    """Run the node."""
    sys.exit(node_main("v2x_bridge", BridgeNode, BridgeParameters))


if __name__ == "__main__":
    main()
