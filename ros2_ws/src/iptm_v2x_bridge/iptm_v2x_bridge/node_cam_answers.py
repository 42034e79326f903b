"""The node's answers to the clock from messages of other cars."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from iptm_core.routes import Route
from iptm_core.state import NS_PER_MS
from iptm_interfaces.codecs import encode_raw_datagram
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import EndOfTick
from iptm_v2x_bridge.messages.cam import specification
from iptm_v2x_bridge.messages.its_time import its_timestamp_ms
from iptm_v2x_bridge.node_answers import TickAnswers
from iptm_v2x_bridge.node_datagrams import open_source
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters

READ_PERIOD_S = 0.005


@dataclass
class _CamTrip:
    """What belongs to one trip.

    Attributes:
        bridge: takes in the messages.
        start_ms: TimestampIts of trip time 0.
        last_ns: the last tick that was answered.
        read_ns: time up to which datagrams have been read, None before.
        received: datagrams so far.
    """

    bridge: CamBridge
    start_ms: int
    last_ns: int
    read_ns: int | None = None
    received: int = 0


class CamAnswers(TickAnswers[_CamTrip]):
    """Answers from received messages of the leader.

    A tick is answered when the ego vehicle's position of the same stamp is known and, in lock-step, after the
    sender's end of the tick.
    """

    def __init__(
        self,
        node: SuiteNode,
        options: BridgeNodeParameters,
        route: Route,
        retry: Callable[[], None],
    ) -> None:
        """Open the source of the datagrams and listen for the ego vehicle."""
        # Refused now, if at all.
        self._verifier = options.build_verifier()
        super().__init__(node, options, route, retry, needs_ego=True, is_counted=False)
        options.build_heard_rules(self._given, route.road_line)
        options.build_predictors(route, self._given)
        self._datagrams = open_source(options, node)
        self._publisher = node.advertise(Topic.DATAGRAMS) if options.publish_datagrams else None
        # Datagrams of the present are read at once; those of the trip's own time belong to its ticks.
        self._by_wall_clock = options.trip_start_timestamp_ms < 0 and not (
            options.recorded_packets or options.cam_lock_step
        )
        specification()  # compiled now, not at the first tick, which others wait for
        node.every(READ_PERIOD_S, self._on_read_timer)

    def _on_read_timer(self) -> None:
        if self._trip is not None and self._by_wall_clock:
            trip, _ = self._trip
            self._read(trip, trip.last_ns)
        self._retry()

    def _start(self, time_ns: int) -> tuple[_CamTrip, TickBridge]:
        """Start with the first tick, which maps trip time 0 to the time of the messages."""
        start_ms = self._datagrams.begin_trip(time_ns)
        options, route = self._options, self._route
        heard = options.build_heard_rules(self._given, route.road_line)
        bridge = CamBridge(
            options.road_of_messages(route.road_line),
            options,
            predictors=options.build_predictors(route, heard.leader if heard else self._given),
            datagram_offset_bytes=options.datagram_offset_bytes,
            start_timestamp_ms=start_ms,
            roadside=heard,
            verifier=self._verifier,
        )
        ruled = self._with_rules(bridge, heard.ego if heard else None, start_ms)
        return _CamTrip(bridge, start_ms, time_ns), ruled

    def _awaited(self, trip: _CamTrip, time_ns: int) -> str:
        self._read(trip, time_ns)
        return self._datagrams.missing(time_ns)

    def _checked(self, trip: _CamTrip, answer: BridgeAnswer) -> BridgeAnswer:
        trip.last_ns = answer.time_ns
        self._publish(trip, EndOfTick(answer.time_ns, trip.received).encode(), answer.time_ns)
        return answer

    def _read(self, trip: _CamTrip, time_ns: int) -> None:
        """Take in what has arrived by a tick; by the computer's clock, by now, however late the tick is."""
        if self._by_wall_clock:
            passed_ms = its_timestamp_ms(time.time_ns()) - trip.start_ms
            time_ns = max(passed_ms * NS_PER_MS, time_ns)
        receptions, dropped = self._datagrams.take(trip.read_ns, time_ns)
        trip.read_ns = time_ns
        for reception in receptions:
            trip.bridge.receive(reception.datagram, reception.received_ns)
            self._publish(trip, reception.datagram, reception.received_ns)
        trip.bridge.decode_waiting(time_ns)
        trip.bridge.count_overflow(dropped)
        trip.received += len(receptions) + dropped

    def _publish(self, trip: _CamTrip, datagram: bytes, received_ns: int) -> None:
        if self._publisher is not None:
            its_ns = trip.start_ms * NS_PER_MS + received_ns
            self._publisher.publish(encode_raw_datagram(datagram, its_ns))

    def is_heard(self) -> bool:
        """Return whether the datagrams, if published, have a subscriber."""
        return self._publisher is None or self._publisher.get_subscription_count() > 0

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return self._datagrams.report() | (self._trip[0].bridge.report() if self._trip else {})

    def close(self) -> None:
        """Give the socket back."""
        self._datagrams.close()
