"""The sender as a node: a drive as messages on a UDP port, on every `/clock` or by the computer's clock."""

from __future__ import annotations

import socket
import sys
import time

from rosgraph_msgs.msg import Clock

from iptm_core.errors import ParameterError
from iptm_core.state import NS_PER_MS
from iptm_interfaces.codecs import ns_from_time
from iptm_interfaces.command_line import node_main
from iptm_interfaces.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_interfaces.parameters import declare_parameters
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_v2x_bridge.messages.cam_codec import specification
from iptm_v2x_bridge.messages.its_time import its_timestamp_ms
from iptm_v2x_bridge.node_host_ticks import HostTicks
from iptm_v2x_bridge.node_parameters import SenderNodeParameters, SentDrive
from iptm_v2x_bridge.sending.datagrams import (
    NOT_ALL_SENT,
    REPEAT_PERIOD_S,
    DatagramSender,
)
from iptm_v2x_bridge.sending.plan_sender import HostTick, PlanSender
from iptm_v2x_bridge.sending.sender import CamSender, build_sender

WALL_PERIOD_S = 0.01


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
        self._start_ns = time.monotonic_ns()
        self._reporter = DiagnosticsReporter.of_node(self, "messages")
        self.every(REPORT_PERIOD_S, self._report)
        if options.follow_clock:
            self.every(REPEAT_PERIOD_S, self._datagrams.repeat_end)
        self._plan_sender: PlanSender | None = None
        if options.sent_drive is SentDrive.HOST:
            self._host = HostTicks(self, self._on_host)
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

    def _on_host(self, tick: HostTick) -> None:
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
        after_ns = -(10**12) if self._last_ns is None else self._last_ns
        for _, datagram in sender.arrivals(after_ns, time_ns):
            self._datagrams.send(datagram)
        self._last_ns = time_ns

    def _start(self, time_ns: int) -> CamSender:
        self._sender = build_sender(
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
            drives = self._options.sent_drive is SentDrive.HOST
            reason = "waiting for a decision" if drives else "waiting for the clock"
        elif self._datagrams.failed:
            level, reason = Level.WARN, NOT_ALL_SENT
        self._reporter.report(self._last_ns or 0, level, reason, values)

    def destroy_node(self) -> None:
        """Give the socket back, too."""
        self._datagrams.close()
        super().destroy_node()


def main() -> None:
    """Run the node."""
    sys.exit(node_main("v2x_sender", SenderNode, SenderNodeParameters))


if __name__ == "__main__":
    main()
