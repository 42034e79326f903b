"""Where predictions come from, before the radio link spoils them."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from iptm_core.routes import Route
from iptm_core.settings import PreviewSettings
from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState, SlopePreview


class PreviewSource(Protocol):
    """Source of the leader: its state, and a prediction of its motion."""

    def leader_at(self, time_ns: int) -> LeaderState | None:
        """Return the leader's state at an instant (integer nanoseconds of trip time), None without one."""
        ...

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the prediction made at the first of its node times, where it is `leader_at`."""
        ...

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return what a range sensor measures of the leader at the given instants of an interval.

        The first instant must be available; later ones may be missing and are left out.
        """
        ...


def preview_times_s(settings: PreviewSettings, generated_ns: int) -> FloatArray:
    """Return the node times of a prediction: its generation, then whole multiples of the step.

    All predictions share these multiples, so a trace with samples there loses none of its corners, whenever
    the prediction is generated.

    Returns:
        Trip times in s, shape (n,), exact to the nanosecond.
    """
    step_ns = round(settings.preview_step_s * NS_PER_S)
    last_ns = generated_ns + round(settings.preview_length_s * NS_PER_S)
    following = np.arange(generated_ns // step_ns + 1, last_ns // step_ns + 1, dtype=np.int64)
    times: FloatArray = np.concatenate([[generated_ns], step_ns * following]) / 1e9
    return times


def sampling_times_s(time_ns: int, interval_s: float, period_s: float) -> FloatArray:
    """Return the instants at which a range sensor measures in an interval, its start included."""
    period_ns = round(period_s * NS_PER_S)
    nodes = np.arange(0, round(interval_s * NS_PER_S), period_ns, dtype=np.int64)
    times: FloatArray = (time_ns + nodes) / NS_PER_S
    return times


def single_sample(leader: LeaderState | None) -> LeaderPreview:
    """Return one measurement of the leader as what a range sensor measures; none for no leader."""
    if leader is None:
        return LeaderPreview.empty()
    return LeaderPreview(
        leader.time_s,
        np.array([leader.time_s]),
        np.array([leader.position_m]),
        np.array([leader.speed_m_s]),
    )


class CycleSource:
    """Perfect predictions: a leader that drives a route and stands still past the end of the trip."""

    def __init__(self, route: Route) -> None:
        self.route = route

    def leader_at(self, time_ns: int) -> LeaderState:
        """Return the leader's state at an instant (integer nanoseconds of trip time)."""
        return self.route.leader.state_at(time_ns / NS_PER_S)

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return what the leader is going to do, without any error; see `PreviewSource`."""
        return LeaderPreview(
            generated_at_s=float(times_s[0]),
            times_s=times_s,
            positions_m=self.route.leader.positions_at(times_s),
            speeds_m_s=self.route.leader.speeds_at(times_s),
        )

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the leader at all of the instants; see `PreviewSource`."""
        return self.predict(times_s)

    def slope_ahead(self) -> SlopePreview:
        """Return the slope of the whole road, as a map holds it."""
        return SlopePreview(self.route.slope.positions_m, self.route.slope.slopes_rad)


class EmptyRoad:
    """No vehicle ahead: a `PreviewSource` without states and predictions."""

    def leader_at(self, time_ns: int) -> None:
        """Return None; see `PreviewSource`."""

    def predict(self, times_s: FloatArray) -> LeaderPreview:  # noqa: ARG002
        """Return the empty prediction."""
        return LeaderPreview.empty()

    def sampled(self, times_s: FloatArray) -> LeaderPreview:  # noqa: ARG002
        """Return no measurement: the road is free."""
        return LeaderPreview.empty()
