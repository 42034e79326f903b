"""A car that announces its plan: its state and plan as messages to the car behind it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from iptm_core.routes.cycles import FINAL_BRAKING_M_S2, LeaderMotion, cumulative_integral
from iptm_core.routes.road_line import RoadLine
from iptm_core.state import NS_PER_S, FloatArray
from iptm_v2x_bridge.sending.sender import BEFORE_START_S, CamSender
from iptm_v2x_bridge.settings import SenderSettings

MAX_TICK_S = 10.0
"""Longest interval between two ticks over which the motion is sent."""


@dataclass(frozen=True, eq=False)
class EgoTick:
    """State and plan of a car at a tick.

    Attributes:
        time_ns: the tick, integer nanoseconds of trip time.
        position_m: its front along its own road.
        speed_m_s: its speed.
        plan_times_s: nodes of its plan, trip times, shape (n,), increasing; empty without a plan.
        plan_speeds_m_s: speeds there, shape (n,), linear in between.
    """

    time_ns: int
    position_m: float
    speed_m_s: float
    plan_times_s: FloatArray
    plan_speeds_m_s: FloatArray


class PlanSender:
    """Sends the messages of a drive in progress.

    The message of a tick carries the plan made at it; messages since the tick before carry none.
    """

    def __init__(
        self,
        road: RoadLine,
        settings: SenderSettings,
        ahead_m: float,
        start_timestamp_ms: int = 0,
    ) -> None:
        """Set up a sender.

        Args:
            road: where it drives.
            settings: what is sent.
            ahead_m: where its rear bumper is on this road when its own position is 0.
            start_timestamp_ms: TimestampIts at trip time 0.
        """
        self._road, self._settings, self._ahead_m = road, settings, ahead_m
        self._start_ms = start_timestamp_ms
        self._past: deque[EgoTick] = deque(maxlen=3)
        self._under_way: list[tuple[int, bytes]] = []

    def arrivals(self, tick: EgoTick) -> list[bytes]:
        """Return what arrives up to a tick and was not returned before."""
        last = self._past[-1] if self._past else None
        if last is None or tick.time_ns - last.time_ns > MAX_TICK_S * NS_PER_S:
            self._past.clear()
            # Of a car that drives already nothing is known before; one that stands, stood there.
            stood_s = BEFORE_START_S if tick.speed_m_s == 0.0 else 0.0
            after_ns = tick.time_ns - max(round(stood_s * NS_PER_S), 1)
        else:
            after_ns = last.time_ns
        self._past.append(tick)
        plan_end_s = float(tick.plan_times_s[-1]) if tick.plan_times_s.size else -math.inf
        sender = CamSender(
            self._motion(),
            self._road,
            self._settings,
            self._start_ms,
            plan=(tick.time_ns, plan_end_s),
        )
        self._under_way += sender.departures(after_ns, tick.time_ns)
        self._under_way.sort(key=lambda entry: entry[0])
        arrived = [datagram for at_ns, datagram in self._under_way if at_ns <= tick.time_ns]
        del self._under_way[: len(arrived)]
        return arrived

    def _motion(self) -> LeaderMotion:
        """Return the motion from some ticks before to the end of the plan, and a halt after it."""
        tick = self._past[-1]
        past_s = np.array([known.time_ns / NS_PER_S for known in self._past])
        past_m_s = np.array([known.speed_m_s for known in self._past])
        # A second before the first of them as it is there: no acceleration is known.
        past_s, past_m_s = (
            np.insert(past_s, 0, past_s[0] - 1.0),
            np.insert(past_m_s, 0, past_m_s[0]),
        )
        ahead = tick.plan_times_s > past_s[-1] + 1e-6
        times = np.concatenate([past_s, tick.plan_times_s[ahead]])
        speeds = np.concatenate([past_m_s, np.maximum(tick.plan_speeds_m_s[ahead], 0.0)])
        halt_s = times[-1] + max(speeds[-1] / FINAL_BRAKING_M_S2, 1e-3)
        distance_m = float(cumulative_integral(past_s, past_m_s)[-1])
        return LeaderMotion(
            np.append(times, halt_s),
            np.append(speeds, 0.0),
            self._ahead_m + tick.position_m - distance_m,
        )
