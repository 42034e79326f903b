"""Motion of the preceding vehicle: a speed trace, integrated exactly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.piecewise import cumulative_integral, integral_at, read_only_nodes
from iptm_core.state import FloatArray, LeaderState

FINAL_BRAKING_M_S2 = 1.5
"""Deceleration with which a leader stops whose trace ends while it still moves."""

_MIN_BRAKING_S = 1e-3


@dataclass(frozen=True, eq=False)
class LeaderMotion:
    """Position and speed of the preceding vehicle at any time.

    Speed is linear between the nodes, so that position is the exact parabola of its integral.
    Before the first node the leader stands at its start; after the last node it stands at its
    last position. Build it with `from_cycle`, which sees to it that the last node is a standstill.

    Attributes:
        times_s: node times, shape (n,), increasing.
        speeds_m_s: speeds at the nodes, shape (n,), never negative, the last one 0.
        start_position_m: rear-bumper position before the first node; the initial gap.
        positions_m: positions at the nodes, shape (n,); follows from the others.

    Raises:
        RouteError: malformed nodes, a negative speed, or a last speed other than 0.
    """

    times_s: FloatArray
    speeds_m_s: FloatArray
    start_position_m: float
    positions_m: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        times, speeds = read_only_nodes(self.times_s, self.speeds_m_s, "motion of the leader")
        if np.any(speeds < 0.0):
            bad = int(np.flatnonzero(speeds < 0.0)[0])
            raise RouteError(
                f"motion of the leader: speed {speeds[bad]} m/s at {times[bad]} s; allowed: >= 0"
            )
        if speeds[-1] != 0.0:
            raise RouteError(f"motion of the leader: it ends at {speeds[-1]} m/s; allowed: 0")
        if not np.isfinite(self.start_position_m):
            raise RouteError(
                f"motion of the leader: start at {self.start_position_m} m; must be finite"
            )
        positions = self.start_position_m + cumulative_integral(times, speeds)
        positions.setflags(write=False)
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "speeds_m_s", speeds)
        object.__setattr__(self, "positions_m", positions)

    @classmethod
    def from_cycle(cls, cycle: DrivingCycle, initial_gap_m: float) -> LeaderMotion:
        """Let the leader drive a cycle.

        If the cycle ends while the leader still moves, it brakes to a standstill with
        `FINAL_BRAKING_M_S2` after the last sample.

        Args:
            cycle: its speed trace.
            initial_gap_m: position of its rear bumper at t = 0, where the host starts at 0 m.

        Returns:
            The motion.
        """
        times, speeds = cycle.times_s, cycle.speeds_m_s
        if speeds[-1] > 0.0:
            # The floor keeps the node distinct from the last sample at a vanishing speed.
            braking_s = max(float(speeds[-1]) / FINAL_BRAKING_M_S2, _MIN_BRAKING_S)
            times = np.append(times, times[-1] + braking_s)
            speeds = np.append(speeds, 0.0)
        return cls(times, speeds, float(initial_gap_m))

    def speeds_at(self, times_s: ArrayLike) -> FloatArray:
        """Speeds in m/s at any times, same shape as ``times_s``."""
        times = np.asarray(times_s, dtype=np.float64)
        return np.interp(times, self.times_s, self.speeds_m_s, left=0.0, right=0.0)

    def positions_at(self, times_s: ArrayLike) -> FloatArray:
        """Rear-bumper positions in m at any times, same shape as ``times_s``."""
        times = np.maximum(np.asarray(times_s, dtype=np.float64), self.times_s[0])
        times = np.minimum(times, self.times_s[-1])
        return integral_at(times, self.times_s, self.speeds_m_s, self.positions_m)

    def state_at(self, time_s: float) -> LeaderState:
        """Position and speed at one instant."""
        return LeaderState(
            time_s=float(time_s),
            position_m=float(self.positions_at(time_s)),
            speed_m_s=float(self.speeds_at(time_s)),
        )
