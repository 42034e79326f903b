"""Where the node's answers to the clock come from: a cycle, an empty road, a vehicle, or messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from iptm_core.settings import LeaderSource
from iptm_core.state import LeaderPreview, SlopePreview
from iptm_interfaces.suite_node import SuiteNode
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge, V2xBridge
from iptm_v2x_bridge.node_cam_answers import CamAnswers
from iptm_v2x_bridge.node_host_states import MISSING, HostStates
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters
from iptm_v2x_bridge.node_vehicle_answers import VehicleAnswers
from iptm_v2x_bridge.road_knowledge import with_rules
from iptm_v2x_bridge.source import CycleSource, EmptyRoad, PreviewSource, sampling_times_s


class NodeAnswers(Protocol):
    """Answers ticks once everything that belongs to them is there."""

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        """Return the answer to a tick, None while something is missing."""
        ...

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        """Return what a range sensor measures of the leader from the tick of an answer to the next one."""
        ...

    def begin_trip(self) -> None:
        """Start a new trip, keeping the previous one in case its clock was stray."""
        ...

    def resume_trip(self) -> None:
        """Resume the trip before the last start."""
        ...

    def missing(self) -> str:
        """Return the awaited input, empty for none."""
        ...

    def is_heard(self) -> bool:
        """Return whether the other outputs have a subscriber."""
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
        IptmError: the cycle, its file, the socket or the recorded packets are not usable.
    """
    source = options.build_source()
    if options.leader_source in {LeaderSource.CYCLE, LeaderSource.NONE}:
        return _CycleAnswers(node, source, options, retry)
    if options.leader_source is LeaderSource.VEHICLE:
        return VehicleAnswers(node, source, options, retry)
    return CamAnswers(node, source, options, retry)


class _CycleAnswers:
    """The leader drives a cycle, and a simulated link spoils its predictions; or there is none."""

    def __init__(
        self,
        node: SuiteNode,
        source: CycleSource,
        options: BridgeNodeParameters,
        retry: Callable[[], None],
    ) -> None:
        self._road, self._options = source, options
        self._source: PreviewSource = source
        if options.leader_source is LeaderSource.NONE:
            self._source = EmptyRoad()
        self._host = HostStates(node, retry, is_counted=True) if options.keeps_rules else None
        self._missing = ""
        self._model = options.model().values
        self._bridge, self._ruled = self._before = self._fresh()

    def begin_trip(self) -> None:
        self._before = self._bridge, self._ruled
        self._bridge, self._ruled = self._fresh()

    def _fresh(self) -> tuple[V2xBridge, TickBridge]:
        options = self._options
        bridge = V2xBridge(self._source, options, options.earlier_ticks_ns)
        return bridge, with_rules(bridge, options, self._road.route, self._model, options)

    def resume_trip(self) -> None:
        self._bridge, self._ruled = self._before

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        host = (0.0, 0.0) if self._host is None else self._host.at(time_ns)
        self._missing = MISSING if host is None else ""
        return None if host is None else self._ruled.answer(time_ns, *host)

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        options = self._options
        return self._source.sampled(
            sampling_times_s(answer.time_ns, options.period_s, options.monitor_period_s)
        )

    def missing(self) -> str:
        return self._missing

    def is_heard(self) -> bool:
        return True

    def report(self) -> dict[str, object]:
        return {"predictions_sent": self._bridge.sent, "dropouts": self._bridge.lost}

    def slope_ahead(self) -> SlopePreview:
        return self._road.slope_ahead()

    def close(self) -> None:
        pass
