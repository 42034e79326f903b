"""Faults in the loop without ROS: turns the true values of a tick into measured ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.faults.signals import (
    Delay,
    PreviewFaults,
    RangeSensorFaults,
    StateFaults,
    Traffic,
    faulty_slope,
)
from iptm_controller.measurements import Measurements
from iptm_core.errors import ScenarioError
from iptm_core.settings import LeaderSource
from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState, SlopePreview

NO_LEADER = "no measurement of the leader received"


def check_headless(faults: Iterable[Fault]) -> None:
    """Refuse faults that cannot happen without ROS."""
    for fault in faults:
        if not fault.spec.headless:
            allowed = ", ".join(kind for kind in FaultKind if kind.spec.headless)
            raise ScenarioError(f"fault is {fault.kind}; allowed without ROS: {allowed}")


def check_empty_road(leader_source: LeaderSource, faults: Iterable[Fault]) -> None:
    """Refuse faults of a lead vehicle that is not there."""
    of_leader = {FaultPlace.TRAFFIC, FaultPlace.LEADER, FaultPlace.PREVIEW}
    for fault in faults:
        if leader_source is LeaderSource.NONE and fault.spec.place in of_leader:
            allowed = ", ".join(kind for kind in FaultKind if kind.spec.place not in of_leader)
            raise ScenarioError(
                f"fault is {fault.kind} with leader_source none; allowed: {allowed}"
            )


class FaultInjection:
    """Changes traffic and measurements of a closed loop; ticks in increasing order of time.

    The controller is given what its node would give it: missing inputs are left out, with the reason.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = tuple(faults)
        check_headless(self._faults)
        self._traffic = Traffic(self._faults)
        self._previews = PreviewFaults(self._faults)
        self._sensor = RangeSensorFaults(self._faults)
        self._states = StateFaults(self._faults)
        self._road = at_places(self._faults, FaultPlace.ROAD)
        self._slope: tuple[tuple[bool, ...], SlopePreview] | None = None
        # The controller acts on measurements of one stamp, so all are as late.
        self._delay: Delay[Measurements] = Delay(self._faults, FaultKind.STATE_DELAYED)

    def disturb(self, measured: Measurements) -> tuple[LeaderState, Measurements]:
        """Return the effective leader, and the measurements that the controller receives.

        Args:
            measured: state, leader, preview and slope as they are; all but the preview are there.
        """
        state, own = measured.state, measured.leader
        if state is None or own is None:
            raise ScenarioError(
                "measurements lack state or leader; allowed: complete outputs of plant and bridge"
            )
        now_ns = round(state.time_s * NS_PER_S)
        leader = self._traffic.leader(own, state.position_m)
        faulty = self._sensor.leader(now_ns, leader, state.position_m)
        preview = self._previews.apply(now_ns, self._traffic.preview(measured.preview))
        seen = replace(
            measured,
            state=self._states.apply(now_ns, state),
            leader=faulty,
            preview=LeaderPreview.empty() if preview is None else preview,
            slope=self._faulty_slope(now_ns, measured.slope),
            fault="" if faulty is not None else NO_LEADER,
        )
        return leader, self._delay.delayed(now_ns, seen)

    def sampled(self, own: LeaderPreview, ego_position_m: float) -> LeaderPreview | None:
        """Return the measurements of a range sensor in an interval.

        Args:
            own: the leader of the route at the instants of the interval, the first of which is a tick.
            ego_position_m: where the ego vehicle is at the first of them.

        Returns:
            The measurements that arrive, None for none.
        """
        true = own if self._traffic.is_quiet else self._traffic.sampled(own, ego_position_m)
        return self._sensor.samples(true, ego_position_m)

    def _faulty_slope(self, now_ns: int, slope: SlopePreview) -> SlopePreview:
        if not self._road:
            return slope
        hit = tuple(fault.hits(now_ns) for fault in self._road)
        if self._slope is None or self._slope[0] != hit:
            self._slope = (hit, faulty_slope(self._road, now_ns, slope))
        return self._slope[1]
