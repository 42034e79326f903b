"""Rules of the road for the ego, in addition to the vehicle ahead: speed limits and closed stop lines.

A line is asked for the time at which the ego vehicle arrives at it. One that is closed then is a stop until
it opens; so the ego vehicle holds back as soon as it is known, and never has to brake for a line that has
just closed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters.model import ModelParameters
from iptm_core.road_ahead import (
    HARDEST_M_S2,
    RoadAhead,
    RoadAheadSettings,
    SampledMotion,
    SpeedLimits,
    Stop,
    lawful_drive,
    limits_of_curves,
    limits_of_drive,
)
from iptm_core.routes import Route
from iptm_core.settings import LeaderSource, PreviewSettings
from iptm_core.state import NS_PER_S, FloatArray
from iptm_core.units import KM_H_PER_M_S
from iptm_v2x_bridge.bridge import (
    BridgeAnswer,
    CycleSource,
    EmptyRoad,
    PreviewSource,
    TickBridge,
    V2xBridge,
)
from iptm_v2x_bridge.prediction.road_rules import NO_LIMITS, RoadRules, Signal

PASS_MARGIN_S = 3.0
"""The ego vehicle counts on passing a line only if it arrives this much earlier than it closes."""
EARLY_S = 1.0
"""The ego vehicle may be earlier than calculated by this; a line must have opened by then."""
STOP_BEFORE_M = 2.0
"""Where the ego vehicle halts before a closed line."""
LIMITS_AHEAD_M = 3000.0
"""Limits up to here are passed on: more than any car drives in the minute that is looked ahead."""
LIMITS_BEHIND_M = 200.0
OF_THE_CYCLE = "cycle"
"""Value of `speed_limits_km_h` for the limits that the cycle itself keeps."""
AT_THE_END_M_S = 1e-3
"""Speed limit behind the end of the route: a halt."""
_STEP_S = 0.5


class RulesOfTheRoad:
    """Adds the road ahead to the answers of another bridge; the leader stays as it is."""

    def __init__(
        self,
        inner: TickBridge,
        rules: RoadRules,
        parameters: ModelParameters,
        settings: PreviewSettings | None = None,
        *,
        foresight_s: float = math.inf,
        start_timestamp_ms: int = 0,
        own_limits: SpeedLimits = NO_LIMITS,
    ) -> None:
        """Set up the rules.

        Args:
            inner: source of the leader.
            rules: speed limits of the road and its signals.
            parameters: of the ego vehicle: its spacing policy.
            settings: length of the look ahead.
            foresight_s: lines that the ego vehicle would reach later are not looked at.
            start_timestamp_ms: TimestampIts at trip time 0.
            own_limits: set speed, curves and the end of the route.
        """
        self._inner, self._rules, self._gap = inner, rules, parameters.gap
        self._own_limits = own_limits
        self._foresight_s = foresight_s
        self._start_s = start_timestamp_ms / 1000.0
        self._steps = round((settings or PreviewSettings()).preview_length_s / _STEP_S)
        self._holding_m: float | None = None
        """The line that held the ego vehicle at the last tick."""
        self._last: BridgeAnswer | None = None

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick; the same tick again has the same one. See `TickBridge.answer`."""
        if self._last is None or time_ns != self._last.time_ns:
            inner = self._inner.answer(time_ns, ego_position_m, ego_speed_m_s)
            # Only now: what has been heard by this tick counts.
            given = self._rules.limits or NO_LIMITS
            limits = given.and_not_above(self._own_limits)
            limits = limits.between(
                ego_position_m - LIMITS_BEHIND_M, ego_position_m + LIMITS_AHEAD_M
            )
            ego = (time_ns / NS_PER_S, ego_position_m, ego_speed_m_s)
            stops = self._stops(limits, ego, self._room_m(inner, ego[0]))
            road = RoadAhead(inner.leader is not None, limits, stops)
            self._last = replace(inner, road=road)
        return self._last

    def _room_m(self, answer: BridgeAnswer, now_s: float) -> FloatArray | None:
        """Return where the leader lets the ego stand at the steps if it drives on; None without one."""
        leader, preview = answer.leader, answer.preview.cautious()
        if leader is None:
            return None
        times = now_s + _STEP_S * np.arange(self._steps + 1)
        known = answer.preview.times_s <= answer.preview.known_until_s + 1e-6
        nodes, places, speeds = (
            np.concatenate([[now], values[known & (preview.times_s > now_s)]])
            for now, values in (
                (now_s, preview.times_s),
                (leader.position_m, preview.positions_m),
                (leader.speed_m_s, preview.speeds_m_s),
            )
        )
        beyond = np.maximum(times - nodes[-1], 0.0)
        rear: FloatArray = np.interp(times, nodes, places) + speeds[-1] * beyond
        return rear - self._gap.standstill_gap_m

    def _stops(
        self,
        limits: SpeedLimits,
        ego: tuple[float, float, float],
        room_m: FloatArray | None,
    ) -> tuple[Stop, ...]:
        """Return the lines that are closed when the ego vehicle arrives there, in driving order."""
        position = ego[1]
        holds: list[tuple[Signal, Stop]] = []
        while True:
            stops = sorted((stop for _, stop in holds), key=lambda stop: stop.position_m)
            headway_s = self._gap.time_headway_s
            drive = lawful_drive(limits, stops, ego, self._steps, _STEP_S, room_m, headway_s)
            closed = self._first_closed(drive, holds)
            if closed is None:
                break
            signal, until_s = closed
            halt_m = max(signal.stop_line_m - STOP_BEFORE_M, position)
            holds.append((signal, Stop(halt_m, until_s)))
        self._holding_m = holds[0][0].stop_line_m if holds else None
        return tuple(stops)

    def _first_closed(
        self, drive: SampledMotion, holds: list[tuple[Signal, Stop]]
    ) -> tuple[Signal, float] | None:
        """Return the first line that the ego would find closed, and the trip time at which it opens."""
        now_s, position, speed = (
            float(values[0]) for values in (drive.times_s, drive.positions_m, drive.speeds_m_s)
        )
        held = {signal.stop_line_m for signal, _ in holds}
        reached_m = float(drive.positions_m[-1])
        signal = self._rules.next_after(position)
        while signal is not None and signal.stop_line_m < reached_m:
            line_m = signal.stop_line_m
            after = int(np.searchsorted(drive.positions_m, line_m, side="right"))
            before_m, after_m = drive.positions_m[after - 1 : after + 1]
            share = (line_m - before_m) / (after_m - before_m)
            time_s = float(drive.times_s[after - 1]) + share * _STEP_S
            if time_s - now_s > self._foresight_s:
                return None
            if line_m not in held and not self._lets_pass(signal, time_s, now_s):
                is_too_late = speed * speed > 2.0 * HARDEST_M_S2 * (line_m - position)
                # A line that would take harder braking is passed: by the margin it is still open.
                if not is_too_late or holds or line_m == self._holding_m:
                    opens = signal.closed_until_s(signal.open_until_s(self._early(time_s, now_s)))
                    return signal, float(opens + EARLY_S - self._start_s)
            signal = self._rules.next_after(line_m)
        return None

    def _early(self, time_s: float, now_s: float) -> float:
        return self._start_s + max(time_s - EARLY_S, now_s)

    def _lets_pass(self, signal: Signal, time_s: float, now_s: float) -> bool:
        """Return whether a line is open when the ego vehicle arrives, with the margins of both sides."""
        at = self._start_s + time_s
        is_open = signal.is_open(self._early(time_s, now_s))
        return is_open and signal.open_until_s(at) - at >= PASS_MARGIN_S


def given_rules(settings: RoadAheadSettings, route: Route) -> RoadRules:
    """Return the rules that settings state for a route.

    Raises:
        ParameterError: a text is not usable.
    """
    text = settings.speed_limits_km_h.strip()
    if text == OF_THE_CYCLE:
        limits: SpeedLimits | None = limits_of_drive(route.leader)
    else:
        limits = read_limits(text) if text else None
    return RoadRules(limits, read_signals(settings.signals))


def own_limits(settings: RoadAheadSettings, route: Route) -> SpeedLimits:
    """Return the limits other than signs: set speed, curves and, without a leader, the end of the route."""
    limits = limits_of_curves(route.road_line, settings.max_lateral_acceleration_m_s2)
    if settings.set_speed_km_h:
        wanted = np.full(1, settings.set_speed_km_h / KM_H_PER_M_S)
        limits = limits.and_not_above(SpeedLimits(np.zeros(1), wanted))
    if settings.leader_source is LeaderSource.NONE:
        motion = route.leader
        end_m = float(motion.positions_m[-1] - motion.start_position_m)
        end = SpeedLimits(
            np.array([0.0, end_m]), np.array([NO_LIMITS.limits_m_s[0], AT_THE_END_M_S])
        )
        limits = limits.and_not_above(end)
    return limits


def with_rules(
    inner: TickBridge,
    settings: RoadAheadSettings,
    route: Route,
    model: ModelParameters,
    preview: PreviewSettings,
    rules: RoadRules,
    start_timestamp_ms: int = 0,
) -> TickBridge:
    """Return a bridge that adds the rules of the road, or the same one where none are kept."""
    if not settings.keeps_rules:
        return inner
    return RulesOfTheRoad(
        inner,
        rules,
        model,
        preview,
        foresight_s=settings.line_foresight_s,
        start_timestamp_ms=start_timestamp_ms,
        own_limits=own_limits(settings, route),
    )


def road_bridge(
    settings: RoadAheadSettings,
    route: Route,
    model: ModelParameters,
    preview: PreviewSettings,
    leader: PreviewSource | None = None,
) -> tuple[PreviewSource, TickBridge]:
    """Return who drives ahead of an ego vehicle without ROS, and the bridge that answers its ticks.

    Raises:
        ParameterError: a text is not usable.
    """
    source: PreviewSource = leader or CycleSource(route)
    if settings.leader_source is LeaderSource.NONE:
        source = EmptyRoad()
    rules = given_rules(settings, route)
    return source, with_rules(V2xBridge(source, preview), settings, route, model, preview, rules)


def read_limits(text: str) -> SpeedLimits:
    """Return the speed limits that a text such as `0:50, 1200:70` states.

    Raises:
        ParameterError: the text is malformed.
    """
    try:
        pairs = np.array([[float(part) for part in entry.split(":")] for entry in text.split(",")])
        return SpeedLimits(pairs[:, 0], pairs[:, 1] / KM_H_PER_M_S)
    except (ValueError, IndexError, RouteError) as reason:
        raise ParameterError(
            f"speed_limits_km_h is {text!r}; allowed: <from metre>:<km/h> parts joined by commas, metres "
            "increasing, limits above 0; or cycle"
        ) from reason


def read_signals(text: str) -> tuple[Signal, ...]:
    """Return the signals that a text such as `1100:80:12.5:42` states, none for an empty one.

    Raises:
        ParameterError: the text is malformed.
    """
    entries = [entry.split(":") for entry in text.split(",") if entry.strip()]
    try:
        return RoadRules(
            None, tuple(Signal.cyclic(*map(float, parts)) for parts in entries)
        ).signals
    except (ValueError, TypeError, RouteError) as reason:
        raise ParameterError(
            f"signals is {text!r}: {reason}; allowed: <metre of the stop line>:<cycle in s>:<turns green at "
            "s>:<green for s> parts joined by commas, metres increasing"
        ) from reason
