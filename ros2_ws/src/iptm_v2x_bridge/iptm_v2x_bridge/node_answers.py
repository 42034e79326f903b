"""Where the node's answers to the clock come from: a cycle, or messages from a socket."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

from nav_msgs.msg import Odometry

from iptm_core.state import SlopePreview
from iptm_interfaces.codecs import ns_from_time
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_v2x_bridge.bridge import BridgeAnswer, V2xBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import DatagramReader
from iptm_v2x_bridge.messages.cam_codec import specification
from iptm_v2x_bridge.messages.its_time import its_timestamp_ms
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters, LeaderSource
from iptm_v2x_bridge.sending.end_of_tick import EndOfTick
from iptm_v2x_bridge.source import CycleSource

READ_PERIOD_S = 0.005
_KEPT_HOST_POSITIONS = 16


class NodeAnswers(Protocol):
    """Answers ticks once everything that belongs to them is there."""

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        """Return the answer to a tick, None while something is missing."""
        ...

    def begin_trip(self) -> None:
        """Begin anew, keeping the trip so far for the case that the clock of the new one was stray."""
        ...

    def resume_trip(self) -> None:
        """Go on with the trip before the last beginning."""
        ...

    def missing(self) -> str:
        """Return what is waited for, empty if nothing is."""
        ...

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        ...

    def slope_ahead(self) -> SlopePreview:
        """Return the slope of the whole road."""
        ...

    def close(self) -> None:
        """Give back what is held."""
        ...


def node_answers(
    node: SuiteNode,
    options: BridgeNodeParameters,
    retry: Callable[[], None],
) -> NodeAnswers:
    """Return the answers that the parameters ask for.

    Args:
        node: listens for the host where its position is needed.
        options: parameters of the node.
        retry: called whenever something missing may have arrived.

    Raises:
        IptmError: the cycle, its file or the socket is not usable.
    """
    source = options.build_source()
    if options.leader_source is LeaderSource.CYCLE:
        return _CycleAnswers(source, options)
    return _CamAnswers(node, source, options, retry)


class _CycleAnswers:
    """The leader drives a cycle; a simulated link spoils its predictions."""

    def __init__(self, source: CycleSource, options: BridgeNodeParameters) -> None:
        self._source = source
        self._options = options
        self._bridge = self._before = V2xBridge(source, options)

    def begin_trip(self) -> None:
        self._before, self._bridge = self._bridge, V2xBridge(self._source, self._options)

    def resume_trip(self) -> None:
        self._bridge = self._before

    def answer(self, time_ns: int) -> BridgeAnswer:
        return self._bridge.answer(time_ns)

    def missing(self) -> str:
        return ""

    def report(self) -> dict[str, object]:
        return {"predictions_sent": self._bridge.sent, "dropouts": self._bridge.lost}

    def slope_ahead(self) -> SlopePreview:
        return self._source.slope_ahead()

    def close(self) -> None:
        pass


class _CamAnswers:
    """The leader is who its messages say it is.

    A tick is answered when the host's position of the same stamp is known and, in lock-step, when the sender
    has said that it has sent everything up to the tick.
    """

    def __init__(
        self,
        node: SuiteNode,
        source: CycleSource,
        options: BridgeNodeParameters,
        retry: Callable[[], None],
    ) -> None:
        self._source, self._options, self._retry = source, options, retry
        self._bridge: CamBridge | None = None
        self._before: tuple[CamBridge | None, int, int] = (None, 0, 0)
        self._reader = DatagramReader(options.cam_address, options.cam_port)
        self._host_m: dict[int, float] = {}
        self._ended: EndOfTick | None = None
        self._start_ms = self._last_ns = 0
        self._heard = 0
        self._lost_on_the_way = 0
        self._missing = ""
        self._dropped = 0
        specification()  # compiled now, not at the first tick, which others wait for
        node.listen(Topic.PLANT_ODOMETRY, self._on_host)
        node.every(READ_PERIOD_S, self._on_read_timer)

    def begin_trip(self) -> None:
        self._before = (self._bridge, self._start_ms, self._last_ns)
        self._bridge = None

    def resume_trip(self) -> None:
        self._bridge, self._start_ms, self._last_ns = self._before

    def _on_host(self, message: Odometry) -> None:
        position_m = float(message.pose.pose.position.x)
        if not math.isfinite(position_m):
            return  # the tick stays unanswered; the report says what it waits for
        self._host_m[ns_from_time(message.header.stamp)] = position_m
        while len(self._host_m) > _KEPT_HOST_POSITIONS:
            del self._host_m[next(iter(self._host_m))]
        self._retry()

    def _on_read_timer(self) -> None:
        """Read at once where the computer's clock says when; in lock-step all belongs to the tick."""
        if self._bridge is not None and self._options.trip_start_timestamp_ms < 0:
            passed_ms = its_timestamp_ms(time.time_ns()) - self._start_ms
            self._read(self._bridge, max(passed_ms * 1_000_000, self._last_ns))
        self._retry()

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        bridge = self._bridge or self._start(time_ns)
        self._read(bridge, time_ns)
        host_m = self._host_m.get(time_ns)
        if host_m is None:
            self._missing = "waiting for the position of the host"
            return None
        if self._options.cam_lock_step and (self._ended is None or self._ended.time_ns != time_ns):
            self._missing = "waiting for the sender's end of the tick"
            return None
        self._missing, self._last_ns = "", time_ns
        return bridge.answer(time_ns, host_m)

    def _start(self, time_ns: int) -> CamBridge:
        """Begin with the first tick: it tells what time of the messages is trip time 0."""
        start_ms = self._options.trip_start_timestamp_ms
        if start_ms < 0:
            start_ms = its_timestamp_ms(time.time_ns()) - time_ns // 1_000_000
        self._start_ms, self._last_ns = start_ms, time_ns
        self._bridge = CamBridge(
            self._source.route.road_line,
            self._options,
            predictors=self._options.build_predictors(self._source.route),
            known_bound_m=self._options.known_bound_m,
            start_timestamp_ms=start_ms,
        )
        return self._bridge

    def _read(self, bridge: CamBridge, time_ns: int) -> None:
        for datagram in self._reader.take():
            ended = EndOfTick.decode(datagram) if self._options.cam_lock_step else None
            if ended is None:
                self._heard += 1
                bridge.receive(datagram, time_ns)
                continue
            if self._ended is not None and ended.time_ns < self._ended.time_ns:
                self._heard = ended.sent  # the sender began a new trip
            self._ended = ended
            self._lost_on_the_way = ended.sent - self._heard
        dropped = self._reader.dropped
        if dropped > self._dropped:
            bridge.count_overflow(dropped - self._dropped)
            self._dropped = dropped

    def missing(self) -> str:
        return self._missing

    def report(self) -> dict[str, object]:
        values: dict[str, object] = {"port": self._reader.port}
        if self._options.cam_lock_step:
            values["lost_between_sender_and_bridge"] = self._lost_on_the_way
        return values | (self._bridge.report() if self._bridge else {})

    def slope_ahead(self) -> SlopePreview:
        return self._source.slope_ahead()

    def close(self) -> None:
        self._reader.close()
