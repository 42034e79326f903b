"""The traffic as the world around the ego, headless and over ROS: SUMO advances with that of the ego."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import FloatArray, LeaderPreview, LeaderState
from iptm_traffic.demand import LEADER, TrafficScenario
from iptm_traffic.network import EGO_LANE
from iptm_traffic.right_of_way import RightOfWay
from iptm_traffic.simulation import EgoMotion, TrafficSimulation
from iptm_v2x_bridge.bridge import single_sample
from iptm_v2x_bridge.prediction.road_rules import RoadRules

EVENT_PERIOD_S = 60.0
"""Smallest interval between two events (a car cuts in, a leader turns off)."""
CUT_IN_ROOM_M = (8.0, 60.0)
"""Distances of a rear end ahead of the ego vehicle's front at which a car of the other lane cuts in."""
SETTLING_TICKS = 10
"""Ticks for which a gap is not judged after another car has moved in."""
_LEFT_LANE = 1


@dataclass(frozen=True, eq=False)
class TrafficFacts:
    """Results of a drive that the traffic provides, wherever plant and controller run.

    Attributes:
        smallest_gap_m: to the car ahead.
        smallest_margin_m: smallest gap less s_min behind a car that did not just move in.
        lines_passed: stop lines passed by the ego vehicle.
        lines_passed_closed: how many of them were not green.
        largest_deviation_m: largest distance between the positions of the ego vehicle in SUMO and in the
        plant. leaders: names of the cars ahead, in order. messages: messages sent around the ego vehicle.
        collisions: those of the ego vehicle that SUMO has noticed, one text each.
    """

    smallest_gap_m: float
    smallest_margin_m: float
    lines_passed: int
    lines_passed_closed: int
    largest_deviation_m: float
    leaders: tuple[str, ...]
    messages: int
    collisions: tuple[str, ...]

    @property
    def leader_count(self) -> int:
        """How many cars were ahead, one after the other."""
        return len(self.leaders)

    @property
    def collision_count(self) -> int:
        """How many steps the ego vehicle spent in collisions."""
        return len(self.collisions)


class LineWatch:
    """Records the stop lines that the ego vehicle passes.

    Attributes:
        passed: instants, and whether the line was open.
    """

    def __init__(self, rules: RoadRules) -> None:
        self._rules = rules
        self.passed: list[tuple[float, bool]] = []

    def watch(self, before: EgoMotion, after: EgoMotion) -> None:
        """Examine one interval of the ego vehicle."""
        signal = self._rules.next_after(before.position_m)
        if signal is None or after.position_m <= signal.stop_line_m:
            return
        # The instant at constant acceleration; an ego that halts inside the interval was there earlier.
        distance_m = signal.stop_line_m - before.position_m
        mean = 0.5 * (before.speed_m_s + after.speed_m_s)
        acceleration = (after.speed_m_s - before.speed_m_s) / (after.time_s - before.time_s)
        root = max(before.speed_m_s**2 + 2.0 * acceleration * distance_m, 0.0) ** 0.5
        elapsed_s = 2.0 * distance_m / max(before.speed_m_s + root, 0.1 * mean, 1e-9)
        time_s = min(before.time_s + elapsed_s, after.time_s)
        self.passed.append((time_s, signal.is_open(time_s)))


class SumoWorld:
    """Moves the ego in SUMO, starts the events of the scenario, and judges; a `World` of the closed loop.

    Attributes:
        leaders: names of the cars ahead, in order.
        lines: stop lines that the ego vehicle has passed.
    """

    def __init__(
        self,
        scenario: TrafficScenario,
        simulation: TrafficSimulation,
        parameters: ModelParameters,
        right_of_way: RightOfWay | None = None,
    ) -> None:
        """Examine the traffic at trip time 0.

        Args:
            scenario: what is to happen.
            simulation: at trip time 0, with the ego vehicle in it.
            parameters: of the ego vehicle.
            right_of_way: refreshed at every tick; None where all rules are those of the network.
        """
        self._scenario, self._simulation, self._parameters = scenario, simulation, parameters
        self._right_of_way = right_of_way
        self._time_s, self._next_event_s, self._settled_tick = 0.0, EVENT_PERIOD_S, 0
        self._margins_m: list[tuple[float, float, bool]] = []
        """Per tick the gap, the gap less s_min, and whether that is judged; infinite without a car ahead."""
        self.leaders: list[str] = []
        self.lines = LineWatch(right_of_way.shown if right_of_way else simulation.network.rules)
        self._look(0.0)

    def pass_interval(self, before: EgoMotion, after: EgoMotion) -> None:
        """Let an interval pass in which the ego vehicle moves from one state to the other."""
        self.lines.watch(before, after)
        self._simulation.move_ego(after, after.time_s - before.time_s)
        self._time_s = after.time_s
        if self._right_of_way is not None:
            self._right_of_way.refresh()
        self._look(after.speed_m_s)

    def _look(self, ego_speed_m_s: float) -> None:
        self._leader = found = self._simulation.leader()
        gap_m, margin_m = math.inf, math.inf
        if found is not None:
            name, gap_m, speed_m_s = found
            if self.leaders[-1:] != [name]:
                self.leaders.append(name)
                self._settled_tick = len(self._margins_m) + SETTLING_TICKS
            policy, limits = self._parameters.gap, self._parameters.limits
            margin_m = gap_m - float(minimum_gap_m(ego_speed_m_s, speed_m_s, policy, limits))
        self._margins_m.append((gap_m, margin_m, len(self._margins_m) >= self._settled_tick))
        if self._simulation.time_s >= self._next_event_s:
            self._start_event()

    def _start_event(self) -> None:
        simulation = self._simulation
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
        around = self._simulation.neighbours()
        ego_m, speed = self._simulation.ego_position_m, self._simulation.ego_speed_m_s
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
        return LeaderState(self._time_s, self._simulation.ego_position_m + gap_m, speed_m_s)

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the car ahead at the present tick; where it will be, SUMO has not decided yet."""
        del times_s
        return single_sample(self.leader_at(0))

    def facts(self, messages: int) -> TrafficFacts:
        """Return the results so far; `messages` is the number of messages sent around the ego vehicle."""
        return TrafficFacts(
            smallest_gap_m=min(gap_m for gap_m, _, _ in self._margins_m),
            smallest_margin_m=min(
                (margin_m for _, margin_m, is_judged in self._margins_m if is_judged),
                default=math.inf,
            ),
            lines_passed=len(self.lines.passed),
            lines_passed_closed=sum(not is_open for _, is_open in self.lines.passed),
            largest_deviation_m=self._simulation.largest_deviation_m,
            leaders=tuple(self.leaders),
            messages=messages,
            collisions=tuple(self._simulation.collisions),
        )
