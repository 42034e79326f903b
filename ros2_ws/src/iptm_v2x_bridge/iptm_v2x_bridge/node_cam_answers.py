"""The node's answers to the clock from messages of other cars."""

from __future__ import annotations

import time
from collections.abc import Callable

from iptm_core.state import NS_PER_MS, LeaderPreview, SlopePreview
from iptm_interfaces.codecs import encode_raw_datagram
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam_codec import specification
from iptm_v2x_bridge.messages.its_time import its_timestamp_ms
from iptm_v2x_bridge.node_datagrams import open_source
from iptm_v2x_bridge.node_host_states import MISSING, HostStates
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters
from iptm_v2x_bridge.road_knowledge import given_rules, with_rules
from iptm_v2x_bridge.sending.end_of_tick import EndOfTick
from iptm_v2x_bridge.source import CycleSource, single_sample

READ_PERIOD_S = 0.005


class CamAnswers:
    """Answers from received messages of the leader.

    A tick is answered when the host's position of the same stamp is known and, in lock-step, after the
    sender's end of the tick.
    """

    def __init__(
        self,
        node: SuiteNode,
        source: CycleSource,
        options: BridgeNodeParameters,
        retry: Callable[[], None],
    ) -> None:
        """Open the source of the datagrams and listen for the host; see `node_answers`."""
        self._source, self._options, self._retry = source, options, retry
        self._model = options.model().values
        self._given = given_rules(options, source.route)
        # Refused now, if at all.
        self._verifier = options.build_verifier()
        options.build_heard_rules(self._given, source.route.road_line)
        options.build_predictors(source.route, self._given)
        self._bridge: CamBridge | None = None
        self._rules: TickBridge | None = None
        self._before: tuple[CamBridge | None, TickBridge | None, int, int, int | None]
        self._before = (None, None, 0, 0, None)
        self._datagrams = open_source(options, node)
        self._start_ms = self._last_ns = 0
        self._read_ns: int | None = None
        self._received = 0
        self._missing = ""
        self._publisher = node.advertise(Topic.DATAGRAMS) if options.publish_datagrams else None
        # Datagrams of the present are read at once; those of the trip's own time belong to its ticks.
        self._by_wall_clock = options.trip_start_timestamp_ms < 0 and not (
            options.recorded_packets or options.cam_lock_step
        )
        specification()  # compiled now, not at the first tick, which others wait for
        self._host = HostStates(node, retry)
        node.every(READ_PERIOD_S, self._on_read_timer)

    def begin_trip(self) -> None:
        """Start a new trip; see `NodeAnswers`."""
        self._before = (self._bridge, self._rules, self._start_ms, self._last_ns, self._read_ns)
        self._bridge = self._rules = None

    def resume_trip(self) -> None:
        """Go on with the trip before the last beginning."""
        self._bridge, self._rules, self._start_ms, self._last_ns, self._read_ns = self._before

    def _on_read_timer(self) -> None:
        if self._bridge is not None and self._by_wall_clock:
            self._read(self._bridge, self._last_ns)
        self._retry()

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        """Return the answer to a tick, None while something is missing."""
        bridge = self._bridge or self._start(time_ns)
        self._read(bridge, time_ns)
        host = self._host.at(time_ns)
        if host is None:
            self._missing = MISSING
            return None
        self._missing = self._datagrams.missing(time_ns)
        if self._missing:
            return None
        self._last_ns = time_ns
        self._publish(EndOfTick(time_ns, self._received).encode(), time_ns)
        return (self._rules or bridge).answer(time_ns, *host)

    def _start(self, time_ns: int) -> CamBridge:
        """Start with the first tick, which maps trip time 0 to the time of the messages."""
        self._start_ms, self._last_ns = self._datagrams.begin_trip(time_ns), time_ns
        self._received, self._read_ns = 0, None
        options, route = self._options, self._source.route
        heard = options.build_heard_rules(self._given, route.road_line)
        bridge = self._bridge = CamBridge(
            options.road_of_messages(route.road_line),
            options,
            predictors=options.build_predictors(route, heard.leader if heard else self._given),
            datagram_offset_bytes=options.datagram_offset_bytes,
            start_timestamp_ms=self._start_ms,
            roadside=heard,
            verifier=self._verifier,
        )
        self._rules = with_rules(
            bridge,
            options,
            route,
            self._model,
            options,
            heard.host if heard else self._given,
            self._start_ms,
        )
        return bridge

    def _read(self, bridge: CamBridge, time_ns: int) -> None:
        """Take in what has arrived by a tick; by the computer's clock, by now, however late the tick is."""
        if self._by_wall_clock:
            passed_ms = its_timestamp_ms(time.time_ns()) - self._start_ms
            time_ns = max(passed_ms * NS_PER_MS, time_ns)
        after_ns, self._read_ns = self._read_ns, time_ns
        for reception in self._datagrams.take(after_ns, time_ns):
            bridge.receive(reception.datagram, reception.received_ns)
            self._publish(reception.datagram, reception.received_ns)
            self._received += 1
        bridge.decode_waiting(time_ns)
        dropped = self._datagrams.take_dropped(after_ns, time_ns)
        if dropped:
            bridge.count_overflow(dropped)
            self._received += dropped

    def _publish(self, datagram: bytes, received_ns: int) -> None:
        if self._publisher is not None:
            its_ns = self._start_ms * NS_PER_MS + received_ns
            self._publisher.publish(encode_raw_datagram(datagram, its_ns))

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        """Return the leader at the tick as its messages have it."""
        return single_sample(answer.leader)

    def missing(self) -> str:
        """Return what is waited for, empty if nothing is."""
        return self._missing

    def is_heard(self) -> bool:
        """Return whether the datagrams, if published, have a subscriber."""
        return self._publisher is None or self._publisher.get_subscription_count() > 0

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return self._datagrams.report() | (self._bridge.report() if self._bridge else {})

    def slope_ahead(self) -> SlopePreview:
        """Return the slope of the whole road."""
        return self._source.slope_ahead()

    def close(self) -> None:
        """Give the socket back."""
        self._datagrams.close()
