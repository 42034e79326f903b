"""The traffic as the world around the ego vehicle, headless and over ROS: SUMO advances with its plant."""

from __future__ import annotations

import math

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import FloatArray, LeaderPreview, LeaderState
from iptm_traffic.demand import LEADER, TrafficScenario
from iptm_traffic.moved_car import EgoMotion
from iptm_traffic.network import EGO_LANE
from iptm_traffic.radio import TrafficRadio
from iptm_traffic.right_of_way import RightOfWay
from iptm_traffic.simulation import TrafficSimulation
from iptm_v2x_bridge.bridge import single_sample
from iptm_v2x_bridge.prediction.road_rules import RoadRules

EVENT_PERIOD_S = 60.0
"""Smallest interval between two events (a car cuts in, a leader turns off)."""
CUT_IN_ROOM_M = (8.0, 60.0)
"""Distances of a rear end ahead of the ego vehicle's front at which a car of the other lane cuts in."""
SETTLING_TICKS = 10
"""Ticks for which a gap is not judged after another car has moved in."""
_LEFT_LANE = 1


def line_passed(rules: RoadRules, before: EgoMotion, after: EgoMotion) -> tuple[float, bool] | None:
    """Return when the ego vehicle passed a stop line, and whether it was open; None where it passed none."""
    signal = rules.next_after(before.position_m)
    if signal is None or after.position_m <= signal.stop_line_m:
        return None
    # The instant at constant acceleration; an ego that halts inside the interval was there earlier.
    distance_m = signal.stop_line_m - before.position_m
    mean = 0.5 * (before.speed_m_s + after.speed_m_s)
    acceleration = (after.speed_m_s - before.speed_m_s) / (after.time_s - before.time_s)
    root = max(before.speed_m_s**2 + 2.0 * acceleration * distance_m, 0.0) ** 0.5
    elapsed_s = 2.0 * distance_m / max(before.speed_m_s + root, 0.1 * mean, 1e-9)
    time_s = min(before.time_s + elapsed_s, after.time_s)
    return time_s, signal.is_open(time_s)


class SumoWorld:
    """Moves the ego in SUMO, starts the events of the scenario, and judges; a `World` of the closed loop.

    Attributes:
        simulation: the traffic; the deviation of plant and SUMO, and the collisions of the ego vehicle.
        radio: the messages sent around the ego vehicle.
        leaders: names of the cars ahead, in order.
        lines: stop lines that the ego vehicle has passed: instants, and whether the line was open.
    """

    def __init__(
        self,
        scenario: TrafficScenario,
        simulation: TrafficSimulation,
        radio: TrafficRadio,
        parameters: ModelParameters,
        right_of_way: RightOfWay | None = None,
    ) -> None:
        """Examine the traffic at trip time 0.

        Args:
            scenario: what is to happen.
            simulation: at trip time 0, with the ego vehicle in it.
            radio: what the vehicles around it send.
            parameters: of the ego vehicle.
            right_of_way: refreshed at every tick; None where all rules come from the network.
        """
        self._scenario, self._parameters = scenario, parameters
        self.simulation, self.radio = simulation, radio
        self._right_of_way = right_of_way
        self._time_s, self._next_event_s, self._settled_tick = 0.0, EVENT_PERIOD_S, 0
        self._margins_m: list[tuple[float, float, bool]] = []
        """Per tick the gap, the gap less s_min, and whether that is judged; infinite without a car ahead."""
        self.leaders: list[str] = []
        self._rules = right_of_way.shown if right_of_way else simulation.network.rules
        self.lines: list[tuple[float, bool]] = []
        self._look(0.0)

    def pass_interval(self, before: EgoMotion, after: EgoMotion) -> None:
        """Let an interval pass in which the ego vehicle moves from one state to the other."""
        passed = line_passed(self._rules, before, after)
        if passed is not None:
            self.lines.append(passed)
        self.simulation.move_ego(after, after.time_s - before.time_s)
        self._time_s = after.time_s
        if self._right_of_way is not None:
            self._right_of_way.refresh()
        self._look(after.speed_m_s)

    def _look(self, ego_speed_m_s: float) -> None:
        self._leader = found = self.simulation.ego.leader()
        gap_m, margin_m = math.inf, math.inf
        if found is not None:
            name, gap_m, speed_m_s = found
            if self.leaders[-1:] != [name]:
                self.leaders.append(name)
                self._settled_tick = len(self._margins_m) + SETTLING_TICKS
            policy, limits = self._parameters.gap, self._parameters.limits
            margin_m = gap_m - float(minimum_gap_m(ego_speed_m_s, speed_m_s, policy, limits))
        self._margins_m.append((gap_m, margin_m, len(self._margins_m) >= self._settled_tick))
        if self.simulation.time_s >= self._next_event_s:
            self._start_event()

    def _start_event(self) -> None:
        simulation = self.simulation
        if self._scenario is TrafficScenario.CUT_IN:
            name = self._who_can_cut_in()
            if name is not None:
                simulation.change_lane(name, EGO_LANE, EVENT_PERIOD_S)
                self._next_event_s = simulation.time_s + EVENT_PERIOD_S
        elif self._scenario is TrafficScenario.TURN_OFF and self._leader is not None:
            name = self._leader[0]
            if name != LEADER and simulation.turn_off(name):
                self._next_event_s = simulation.time_s + 2.0 * EVENT_PERIOD_S

    def _who_can_cut_in(self) -> str | None:
        around = self.simulation.neighbours()
        ego_m, speed = self.simulation.ego.position_m, self.simulation.ego.speed_m_s
        nearest = np.inf if self._leader is None else self._leader[1]
        for row, name in enumerate(around.names):
            rear_m = around.positions_m[row] - around.lengths_m[row] - ego_m
            fits = CUT_IN_ROOM_M[0] < rear_m < min(CUT_IN_ROOM_M[1], nearest)
            beside = around.lanes[row] == _LEFT_LANE and 2.0 < around.lateral_m[row] < 5.0
            if fits and beside and around.speeds_m_s[row] > max(speed - 2.0, 3.0):
                return name
        return None

    def leader_at(self, time_ns: int) -> LeaderState | None:
        """Return the car ahead at the present tick, None if there is none."""
        del time_ns
        if self._leader is None:
            return None
        _, gap_m, speed_m_s = self._leader
        return LeaderState(self._time_s, self.simulation.ego.position_m + gap_m, speed_m_s)

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the car ahead at the present tick; where it will be, SUMO has not decided yet."""
        return single_sample(self.leader_at(0), float(times_s[0]))

    @property
    def smallest_gap_m(self) -> float:
        """Smallest gap to the car ahead."""
        return min(gap_m for gap_m, _, _ in self._margins_m)

    @property
    def smallest_margin_m(self) -> float:
        """Smallest gap less s_min behind a car that did not just move in."""
        margins_m = [margin_m for _, margin_m, is_judged in self._margins_m if is_judged]
        return min(margins_m, default=math.inf)

    @property
    def lines_passed_closed(self) -> int:
        """How many of the stop lines passed were not green."""
        return sum(not is_open for _, is_open in self.lines)
