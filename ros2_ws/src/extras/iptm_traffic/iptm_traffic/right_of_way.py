"""Right of way for the ego vehicle in a network of SUMO: when its stop lines are closed, as by red signals.

A line is closed while its signal is not green, and at instants at which the ego vehicle, once past it, would
meet road users it has to yield to: vehicles on ways of higher priority, in a roundabout or on the lane that
it merges into, and pedestrians on crossings. The network file holds the right of way. Where the others are
and which way they take comes from SUMO.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from iptm_core.road_ahead import HARDEST_M_S2, START_M_S2, STRAIGHT_M_S, SpeedLimits
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_its.interpretation import joined
from iptm_traffic.simulation import TrafficSimulation
from iptm_traffic.sumo_net import Junction, Link
from iptm_v2x_bridge.prediction.road_rules import ALWAYS, RoadRules, Signal, Span
from iptm_v2x_bridge.rules_of_the_road import PASS_MARGIN_S

AHEAD_M = 200.0
"""Others are looked at for lines that are so near, and if they are as near to the junction."""
MARGIN_S = 1.0
"""Time margin between the ego vehicle leaving the junction and another vehicle arriving."""
PROGRAM_S = 150.0
"""Signals with fixed times are known so far ahead."""
END_M = 5.0
"""The way ends so far before the end of its last lane."""
FAST_SHARE, FAST_M_S2 = 1.2, 2.0
"""Others arrive at the earliest with this share of their limit, and with this acceleration."""
SLOW_SHARE, SLOWEST_M_S = 0.8, 2.0
"""Others leave at the latest with this share of their present speed, at least with the second."""
SOFT_M_S2 = 1.5
"""Largest deceleration imposed on a vehicle behind when the ego vehicle merges."""
STROLL_M_S, HURRY_M_S = 0.8, 2.0
"""Slowest and fastest people on foot."""
NEAR_CROSSING_M = 20.0
"""People on sidewalks nearer to a crossing may use it."""
_STATIC, _GO = 0, "GgOos"
_CLOSED, _YELLOW = "rRuU", "yY"


@dataclass(frozen=True)
class _Line:
    """One stop line of the ego vehicle, and where its link ends along the road."""

    link: Link
    junction: Junction
    position_m: float
    exit_m: float

    @property
    def conflicts(self) -> frozenset[int]:
        rows = self.junction.conflicts
        return rows[self.link.index] if self.link.index < len(rows) else frozenset()

    def yields_to(self, index: int) -> bool:
        return index in self.junction.yields_to[self.link.index]

    def is_mutual(self, index: int) -> bool:
        return self.yields_to(index) and self.link.index in self.junction.yields_to[index]


class RightOfWay:
    """The rules for the ego vehicle; two `RoadRules`.

    Attributes:
        ego: limits, signals, all that the ego vehicle has to yield to, and the end of the way.
        leader: limits and signals with fixed times, which a leader also keeps.
        shown: the next signals as they are: closed while red.
    """

    def __init__(self, simulation: TrafficSimulation) -> None:
        """Look at the present tick of a simulation with the ego vehicle in it."""
        network = simulation.network
        self._simulation, self._net = simulation, network.net
        self._lights = simulation.connection.trafficlight
        self._programs: dict[tuple[str, str], Any] = {}
        road = network.road
        starts = [*road.stop_lines_m[1:], math.inf]
        self._lines = []
        for link, line_m, next_line_m in zip(network.way, road.stop_lines_m, starts, strict=True):
            exit_m = line_m + self._net.length_inside_m(link)
            junction = self._net.junctions[link.junction]
            self._lines.append(_Line(link, junction, line_m, min(exit_m, next_line_m)))
        end_m = max(road.length_m - END_M, road.stop_lines_m[-1] + 1.0)
        self._end = Signal(end_m, ALWAYS)
        limits = self._with_unknown_ends(network.limits)
        self.ego, self.leader, self.shown = (RoadRules(limits) for _ in range(3))
        self.refresh()

    def _with_unknown_ends(self, limits: SpeedLimits) -> SpeedLimits:
        """Return limits with which the ego can stop or pass when a signal of unknown times turns yellow."""
        for line in self._lines:
            program = self._program(line.link.signal)
            if program is None or program.type == _STATIC:
                continue
            letters = [
                (phase.state[line.link.signal_index], phase.duration) for phase in program.phases
            ]
            yellow_s = min((lasts for letter, lasts in letters if letter in _YELLOW), default=3.0)
            speed = (
                2.0 * HARDEST_M_S2 * max(yellow_s - 1.0, 1.0)
            )  # a second until the ego vehicle acts
            from_m = line.position_m - speed**2 / (2.0 * HARDEST_M_S2)
            stretch = np.array([from_m - 1.0, from_m, line.position_m])
            limits = limits.and_not_above(
                SpeedLimits(stretch, np.array([STRAIGHT_M_S, speed, STRAIGHT_M_S]))
            )
        return limits

    def refresh(self) -> None:
        """Look at the present tick."""
        now_s, ego_m = self._simulation.time_s, self._simulation.ego.position_m
        ahead = [line for line in self._lines if line.position_m > ego_m]
        near = [line for line in ahead if line.position_m < ego_m + AHEAD_M]
        ways = self._ways() if any(line.conflicts for line in near) else []
        signals: list[Signal] = []
        fixed: list[Signal] = []
        for line in ahead:
            spans, is_fixed = self._signal_spans(line.link, now_s)
            if is_fixed:
                fixed.append(Signal(line.position_m, joined(spans)))
            if line in near:
                spans += self._conflict_spans(line, ways, now_s)
            if spans:
                signals.append(Signal(line.position_m, joined(spans)))
        self.ego.signals = (*signals, self._end)
        self.leader.signals = tuple(fixed)
        lights = [line for line in near if line.link.signal]
        red = [self._letter(line.link.signal, line.link.signal_index) in _CLOSED for line in lights]
        self.shown.signals = tuple(
            Signal(line.position_m, ALWAYS if is_red else ())
            for line, is_red in zip(lights, red, strict=True)
        )

    def _letter(self, signal: str, index: int) -> str:
        return str(self._lights.getRedYellowGreenState(signal)[index])

    def _program(self, signal: str) -> Any | None:
        if not signal:
            return None
        key = (signal, str(self._lights.getProgram(signal)))
        if key not in self._programs:
            logics = self._lights.getAllProgramLogics(signal)
            found = (logic for logic in logics if logic.programID == key[1])
            self._programs[key] = next(found, None)
        return self._programs[key]

    def _signal_spans(self, link: Link, now_s: float) -> tuple[list[Span], bool]:
        """Return when a link's signal is closed, and whether that is known of the future, too."""
        program = self._program(link.signal)
        if program is None or program.type != _STATIC:
            closed = bool(link.signal) and self._letter(link.signal, link.signal_index) not in _GO
            return [*(ALWAYS if closed else ())], False
        phases = self._phases(link.signal, program, now_s)
        spans = [span for *span, state in phases if state[link.signal_index] not in _GO]
        return [(begins, ends) for begins, ends in spans], True

    def _phases(
        self, signal: str, program: Any, now_s: float
    ) -> Iterator[tuple[float, float, str]]:
        """Yield beginning, end and letters of the phases of fixed times from the present one on."""
        begins, number = -math.inf, int(self._lights.getPhase(signal))
        ends = float(self._lights.getNextSwitch(signal)) - self._simulation.start_s
        while begins < now_s + PROGRAM_S:
            phase = program.phases[number]
            yield begins, ends, phase.state
            number = phase.next[0] if phase.next else (number + 1) % len(program.phases)
            begins, ends = ends, ends + program.phases[number].duration

    def _opens_s(self, signal: str, index: int, now_s: float) -> float:
        """Return when others may pass a signal: now, with its next green, or never if that is not known."""
        if not signal or self._letter(signal, index) not in _CLOSED:
            return now_s
        program = self._program(signal)
        if program is None or program.type != _STATIC:
            return math.inf
        phases = self._phases(signal, program, now_s)
        return next((begins for begins, _, state in phases if state[index] in _GO), math.inf)

    def _ways(self) -> list[tuple[Link, float, float, float]]:
        """Return link, distance to its stop line, speed and length of the vehicles around; below 0 inside."""
        found = []
        for name, lane, on_lane_m, speed, length_m in self._simulation.on_lanes():
            link = self._net.inside.get(lane)
            if link is None:
                left_m = self._net.lanes[lane].length_m - on_lane_m
            else:
                before = link.inside[: link.inside.index(lane)]
                done_m = on_lane_m + sum(self._net.lanes[part].length_m for part in before)
                found.append((link, -done_m, speed, length_m))
                left_m = self._net.length_inside_m(link) - done_m
                left_m += self._net.lanes[link.to_lane].length_m
            for following in self._simulation.connection.vehicle.getNextLinks(name):
                link = self._net.inside.get(following[4])
                if link is None or left_m > AHEAD_M:
                    break
                found.append((link, left_m, speed, length_m))
                left_m += self._net.length_inside_m(link)
                left_m += self._net.lanes[link.to_lane].length_m
        return found

    def _conflict_spans(
        self, line: _Line, ways: list[tuple[Link, float, float, float]], now_s: float
    ) -> list[Span]:
        """Return when the ego vehicle must not pass a line because of others."""
        clear_s, exit_m_s = self._clearing(line)
        spans: list[Span] = []
        for link, way_m, speed, length_m in ways:
            if link.junction != line.link.junction or link.index not in line.conflicts:
                continue
            inside_m = self._net.length_inside_m(link)
            gone_m = way_m + inside_m + length_m
            out_s = now_s + gone_m / max(SLOW_SHARE * speed, SLOWEST_M_S)
            yields = line.yields_to(link.index)
            if way_m <= 0.0:
                # Who has to yield may wait inside, where the ego vehicle passes.
                last_m = self._net.lanes[link.inside[-1]].length_m
                if yields or len(link.inside) == 1 or -way_m > inside_m - last_m:
                    spans.append((-math.inf, out_s))
                continue
            if not yields or (line.is_mutual(link.index) and speed < STROLL_M_S):
                continue
            opens_s = self._opens_s(link.signal, link.signal_index, now_s)
            if opens_s == math.inf:
                continue
            fast = max(FAST_SHARE * self._net.lanes[link.from_lane].limit_m_s, speed)
            in_s = max(now_s + _duration_s(way_m, speed, FAST_M_S2, fast), opens_s)
            needed_s = clear_s + MARGIN_S
            if link.to_lane == line.link.to_lane:
                needed_s += max(fast - exit_m_s, 0.0) ** 2 / (2.0 * SOFT_M_S2 * fast)
            spans.append((in_s - max(needed_s - PASS_MARGIN_S, 0.0), out_s + opens_s - now_s))
        for index in line.conflicts:
            name = line.junction.lanes_inside[index]
            if self._net.edge_of(name) in self._net.crossings:
                spans += self._walk_spans(name, clear_s, now_s, yields=line.yields_to(index))
        return spans

    def _clearing(self, line: _Line) -> tuple[float, float]:
        """Return how long the ego takes from a line until it has left the junction, and its speed then."""
        limits = self._simulation.network.limits
        limit = min(limits.approach_at_m_s(line.position_m), limits.approach_at_m_s(line.exit_m))
        speed = min(self._simulation.ego.speed_m_s, limit)
        way_m = line.exit_m - line.position_m + VEHICLE_LENGTH_M
        clear_s = _duration_s(way_m, speed, START_M_S2, limit)
        return clear_s, min(speed + START_M_S2 * clear_s, limit)

    def _walk_spans(
        self, crossing: str, clear_s: float, now_s: float, *, yields: bool
    ) -> list[Span]:
        """Return when the ego vehicle must not pass a line because of people on or near a crossing."""
        connection, net = self._simulation.connection, self._net
        edge, lane = net.edge_of(crossing), net.lanes[crossing]
        walking = [(name, 0.0, now_s) for name in connection.edge.getLastStepPersonIDs(edge)]
        opens_s = self._opens_s(*net.crossing_lights.get(edge, ("", 0)), now_s)
        if yields and opens_s < math.inf:
            areas = {net.edge_of(walk) for walk in net.walks.get(edge, ())} & net.areas
            beside = {net.edge_of(walk) for area in areas for walk in net.walks[area]}
            for place in sorted((areas | beside) - net.crossings):
                for name in connection.edge.getLastStepPersonIDs(place):
                    following = connection.person.getNextEdge(name)
                    ends = lane.shape_m[[0, -1], :2] - np.array(connection.person.getPosition(name))
                    away_m = float(np.min(np.hypot(*ends.T)))
                    if following == edge or (following in areas and away_m < NEAR_CROSSING_M):
                        walking.append((name, away_m, opens_s))
        spans = []
        for name, away_m, from_s in walking:
            slow = max(SLOW_SHARE * float(connection.person.getSpeed(name)), STROLL_M_S)
            in_s = max(now_s + away_m / HURRY_M_S, from_s)
            in_s -= max(clear_s + MARGIN_S - PASS_MARGIN_S, 0.0)
            spans.append((in_s, from_s + (away_m + lane.length_m) / slow))
        return spans


def _duration_s(way_m: float, speed: float, acceleration: float, limit: float) -> float:
    """Return how long a way takes with an acceleration up to a limit."""
    gaining_m = max(limit**2 - speed**2, 0.0) / (2.0 * acceleration)
    if way_m <= gaining_m:
        return (math.sqrt(speed**2 + 2.0 * acceleration * way_m) - speed) / acceleration
    top = max(limit, speed)
    return (top - speed) / acceleration + (way_m - gaining_m) / top
