"""Where the node's answers to the clock come from: a cycle, a vehicle, or messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from iptm_core.state import LeaderPreview, SlopePreview
from iptm_interfaces.suite_node import SuiteNode
from iptm_v2x_bridge.bridge import BridgeAnswer, V2xBridge
from iptm_v2x_bridge.node_cam_answers import CamAnswers
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters, LeaderSource
from iptm_v2x_bridge.node_vehicle_answers import VehicleAnswers
from iptm_v2x_bridge.source import CycleSource, sampling_times_s


class NodeAnswers(Protocol):
    """Answers ticks once everything that belongs to them is there."""

    def answer(self, time_ns: int) -> BridgeAnswer | None:
        """Return the answer to a tick, None while something is missing."""
        ...

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        """Return what a range sensor measures of the leader from the tick of an answer to the next one."""
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

    def is_heard(self) -> bool:
        """Return whether somebody listens to whatever is published beside the answers."""
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
    if options.leader_source is LeaderSource.CYCLE:
        return _CycleAnswers(source, options)
    if options.leader_source is LeaderSource.VEHICLE:
        return VehicleAnswers(node, source, options, retry)
    return CamAnswers(node, source, options, retry)


class _CycleAnswers:
    """The leader drives a cycle; a simulated link spoils its predictions."""

    def __init__(self, source: CycleSource, options: BridgeNodeParameters) -> None:
        self._source = source
        self._options = options
        self._bridge = self._before = self._fresh()

    def begin_trip(self) -> None:
        self._before, self._bridge = self._bridge, self._fresh()

    def _fresh(self) -> V2xBridge:
        return V2xBridge(self._source, self._options, self._options.earlier_ticks_ns)

    def resume_trip(self) -> None:
        self._bridge = self._before

    def answer(self, time_ns: int) -> BridgeAnswer:
        return self._bridge.answer(time_ns)

    def samples(self, answer: BridgeAnswer) -> LeaderPreview:
        options = self._options
        return self._source.sampled(
            sampling_times_s(answer.time_ns, options.period_s, options.monitor_period_s)
        )

    def missing(self) -> str:
        return ""

    def is_heard(self) -> bool:
        return True

    def report(self) -> dict[str, object]:
        return {"predictions_sent": self._bridge.sent, "dropouts": self._bridge.lost}

    def slope_ahead(self) -> SlopePreview:
        return self._source.slope_ahead()

    def close(self) -> None:
        pass
