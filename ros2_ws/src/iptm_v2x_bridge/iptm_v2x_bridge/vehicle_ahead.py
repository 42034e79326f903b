"""A leader that is a vehicle of the same graph: its measured states, and its plans as predictions."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState
from iptm_v2x_bridge.bridge import single_sample
from iptm_v2x_bridge.prediction.extrapolation import AssumedBraking
from iptm_v2x_bridge.prediction.predictor import LeaderTrack
from iptm_v2x_bridge.stations.station import Observation

T = TypeVar("T")


class VehicleAhead:
    """Leader from its own state and plan messages; a `PreviewSource`.

    Everything is kept by its stamp, so an answer depends on stamps alone and not on what else has arrived: to
    a tick belong the state and the plan of that tick. A plan ends where its horizon does, and so does the
    prediction. A silent vehicle is assumed to brake to a halt from its last state on.
    """

    def __init__(self, length_m: float, kept: int | None = None) -> None:
        """Set up a vehicle of which nothing is known yet.

        Args:
            length_m: from the front bumper, the reference point of its position, to the rear one.
            kept: how many of the newest states and plans to keep; None keeps all.
        """
        self._length_m = length_m
        self._kept = kept
        self._states: dict[int, LeaderState] = {}
        self._plans: dict[int, LeaderPreview] = {}

    def note_state(self, stamp_ns: int, front_position_m: float, speed_m_s: float) -> None:
        """Take in a state."""
        rear_m = front_position_m - self._length_m
        self._states[stamp_ns] = LeaderState(stamp_ns / NS_PER_S, rear_m, speed_m_s)
        self._forget(self._states)

    def note_plan(
        self,
        stamp_ns: int,
        times_s: FloatArray,
        front_positions_m: FloatArray,
        speeds_m_s: FloatArray,
    ) -> None:
        """Take in the plan of a tick.

        Args:
            stamp_ns: instant of the state that it starts from, integer nanoseconds of trip time.
            times_s: trip times of its nodes, shape (n,), increasing; n = 0 where the tick has no plan.
            front_positions_m: front bumper at the nodes, shape (n,).
            speeds_m_s: speeds at the nodes, shape (n,).
        """
        # Round-off may let a plan roll backwards at a standstill; a prediction must not.
        positions = np.maximum.accumulate(front_positions_m - self._length_m)
        speeds = np.maximum(speeds_m_s, 0.0)
        self._plans[stamp_ns] = LeaderPreview(times_s, positions, speeds)
        self._forget(self._plans)

    def _forget(self, entries: dict[int, T]) -> None:
        while self._kept is not None and len(entries) > self._kept:
            del entries[next(iter(entries))]

    def has_state(self, time_ns: int) -> bool:
        """Return whether the state of a tick is known."""
        return time_ns in self._states

    def has_plan(self, time_ns: int) -> bool:
        """Return whether it is known what the vehicle planned at a tick, be it nothing."""
        return time_ns in self._plans

    @property
    def was_heard(self) -> bool:
        """Whether any state is known."""
        return bool(self._states)

    def leader_at(self, time_ns: int) -> LeaderState:
        """Return the leader's state at a tick; one state must be known.

        Where the one of the tick is not, the vehicle has braked since the last one known.
        """
        if time_ns in self._states:
            return self._states[time_ns]
        braking = self._braking(np.array([time_ns / NS_PER_S]))
        return LeaderState(
            time_ns / NS_PER_S, float(braking.positions_m[0]), float(braking.speeds_m_s[0])
        )

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the vehicle at the first instant; what it does then is planned, not measured."""
        now_s = float(times_s[0])
        return single_sample(self.leader_at(round(now_s * NS_PER_S)), now_s)

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the plan of a tick as a prediction, at the nodes of the plan; see `PreviewSource`.

        Args:
            times_s: the tick first, the last instant of interest last; the plan decides on those between.

        Returns:
            The prediction; empty where the vehicle had no plan.
        """
        time_ns = round(float(times_s[0]) * NS_PER_S)
        plan = self._plans.get(time_ns)
        if plan is None:
            return self._braking(times_s)
        count = int(np.searchsorted(plan.times_s, times_s[-1], side="right"))
        return LeaderPreview(
            plan.times_s[:count],
            plan.positions_m[:count],
            plan.speeds_m_s[:count],
        )

    def _braking(self, times_s: FloatArray) -> LeaderPreview:
        last = self._states[max(self._states)]
        observed = Observation(last.time_s, last.position_m, last.speed_m_s, None)
        # Without its bounds, which are 0.
        return AssumedBraking().predict(LeaderTrack((observed,)), times_s).cautious()
