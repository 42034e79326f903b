"""Events of a drive: stop lines that the host passes, and drivers that cut in or turn off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iptm_core.state import VehicleState
from iptm_traffic.corridor import HOST_LANE
from iptm_traffic.demand import LEADER, TrafficScenario
from iptm_traffic.simulation import HostInstant, TrafficSimulation
from iptm_v2x_bridge.prediction.road_rules import RoadRules

EVENT_PERIOD_S = 60.0
"""Cars cut in, or leaders turn off, no more often."""
CUT_IN_ROOM_M = (8.0, 60.0)
"""Where, seen from the host's front, a car of the other lane has its rear end when it cuts in."""
SETTLING_TICKS = 10
"""Ticks for which a gap is not judged after another car has moved in."""
_LEFT_LANE = 1


class LineWatch:
    """Notes the stop lines that the host passes.

    Attributes:
        passed: instants, and whether the line was open.
    """

    def __init__(self, rules: RoadRules) -> None:
        self._rules = rules
        self.passed: list[tuple[float, bool]] = []

    @property
    def passed_closed(self) -> int:
        """How many lines were not open when the host passed them."""
        return sum(not is_open for _, is_open in self.passed)

    def watch(self, before: HostInstant | VehicleState, after: HostInstant | VehicleState) -> None:
        """Look at one interval of the host."""
        signal = self._rules.plan.next_after(before.position_m)
        if signal is None or after.position_m <= signal.stop_line_m:
            return
        # The instant at constant acceleration; a host that halts inside the interval was there earlier.
        way_m = signal.stop_line_m - before.position_m
        mean = 0.5 * (before.speed_m_s + after.speed_m_s)
        acceleration = (after.speed_m_s - before.speed_m_s) / (after.time_s - before.time_s)
        root = max(before.speed_m_s**2 + 2.0 * acceleration * way_m, 0.0) ** 0.5
        elapsed_s = 2.0 * way_m / max(before.speed_m_s + root, 0.1 * mean, 1e-9)
        time_s = min(before.time_s + elapsed_s, after.time_s)
        self.passed.append((time_s, signal.is_open(time_s)))


class LeaderWatch:
    """Notes, tick by tick, who is really ahead of the host.

    Attributes:
        names: names of the cars ahead, one after the other.
    """

    def __init__(self, simulation: TrafficSimulation) -> None:
        self._simulation = simulation
        self.names: list[str] = []
        self._is_counted: list[bool] = []
        self._settled_at = 0

    def watch(self) -> tuple[str, float, float] | None:
        """Look at one tick; return name, gap and speed of the car ahead, None if there is none."""
        found = self._simulation.leader()
        tick = len(self._is_counted)
        if found is not None and (not self.names or self.names[-1] != found[0]):
            self.names.append(found[0])
            self._settled_at = tick + SETTLING_TICKS
        self._is_counted.append(found is not None and tick >= self._settled_at)
        return found

    @property
    def counted(self) -> NDArray[np.bool_]:
        """At which ticks the gap is that to a car that did not just move in, shape (ticks,)."""
        return np.array(self._is_counted, dtype=np.bool_)


class Director:
    """Makes happen what the scenario is about."""

    def __init__(self, scenario: TrafficScenario, simulation: TrafficSimulation) -> None:
        self._scenario, self._simulation = scenario, simulation
        self._next_s = EVENT_PERIOD_S

    def direct(self, leader: str | None) -> None:
        """Start an event in the traffic of a tick if one is due."""
        if self._simulation.time_s < self._next_s:
            return
        if self._scenario is TrafficScenario.CUT_IN:
            name = self._who_can_cut_in()
            if name is not None:
                self._simulation.change_lane(name, HOST_LANE, EVENT_PERIOD_S)
                self._next_s = self._simulation.time_s + EVENT_PERIOD_S
        elif (
            self._scenario is TrafficScenario.TURN_OFF
            and leader not in {None, LEADER}
            and self._simulation.turn_off(str(leader))
        ):
            self._next_s = self._simulation.time_s + 2.0 * EVENT_PERIOD_S

    def _who_can_cut_in(self) -> str | None:
        around = self._simulation.neighbours()
        host_m, speed = self._simulation.host_position_m, self._simulation.host_speed_m_s
        leader = self._simulation.leader()
        nearest = np.inf if leader is None else leader[1]
        for row, name in enumerate(around.names):
            rear_m = around.positions_m[row] - around.lengths_m[row] - host_m
            fits = CUT_IN_ROOM_M[0] < rear_m < min(CUT_IN_ROOM_M[1], nearest)
            beside = around.lanes[row] == _LEFT_LANE and 2.0 < around.lateral_m[row] < 5.0
            if fits and beside and around.speeds_m_s[row] > max(speed - 2.0, 3.0):
                return name
        return None
