"""Where predictions come from, before the radio link spoils them."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from iptm_core.routes import Route
from iptm_core.settings import PreviewSettings
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, SlopePreview
from iptm_core.trip_time import NS_PER_S


class PreviewSource(Protocol):
    """Knows the leader: where it is, and what it will do as far as anyone can tell."""

    def leader_at(self, time_ns: int) -> LeaderState:
        """Return the leader's state at an instant (integer nanoseconds of trip time)."""
        ...

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the prediction made at the first of its node times, where it is `leader_at`."""
        ...


def preview_times_s(settings: PreviewSettings, generated_ns: int) -> FloatArray:
    """Return the node times of a prediction: its generation, and steps from there up to its length.

    Args:
        settings: length and step.
        generated_ns: instant of generation in integer nanoseconds of trip time.

    Returns:
        Trip times in s, shape (n,), exact to the nanosecond.
    """
    step_ns = round(settings.preview_step_s * NS_PER_S)
    count = round(settings.preview_length_s * NS_PER_S) // step_ns + 1
    nodes = generated_ns + step_ns * np.arange(count, dtype=np.int64)
    times: FloatArray = nodes / 1e9
    return times


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

    def slope_ahead(self) -> SlopePreview:
        """Return the slope of the whole road, as a map holds it."""
        return SlopePreview(self.route.slope.positions_m, self.route.slope.slopes_rad)
