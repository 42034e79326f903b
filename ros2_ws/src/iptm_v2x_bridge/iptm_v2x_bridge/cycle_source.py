"""Perfect predictions: the leader follows a known driving cycle."""

from __future__ import annotations

from iptm_core.routes import Route
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, SlopePreview
from iptm_core.trip_time import NS_PER_S


class CycleSource:
    """Leader of a route; past the end of the trip it stands still."""

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
