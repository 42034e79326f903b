"""The rules of the road as given and heard, brought up to date at every tick."""

from __future__ import annotations

from iptm_v2x_bridge.messages.packets import OpenedDatagram
from iptm_v2x_bridge.prediction.road_rules import ALWAYS, RoadRules, Signal
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.roadside.phases import (
    TimedPhases,
    joined,
    likely_closed,
    surely_closed,
)
from iptm_v2x_bridge.roadside.road_places import SAME_LINE_M, StopLine, limits_with
from iptm_v2x_bridge.roadside.table import ROADSIDE_KINDS, RoadsideTable, WaitingMessages


class HeardRules:
    """Combines given rules with received ones.

    For a stop line or a stretch with both, messages take precedence, also after they have ceased.

    Attributes:
        table: what is heard.
        ego: for an ego vehicle that keeps the rules: a line of unknown phase is closed.
        leader: for the prediction of a leader: a line of unknown phase binds it to nothing.
    """

    def __init__(self, table: RoadsideTable, given: RoadRules | None = None) -> None:
        """Set up the rules."""
        self.table, self._given = table, given or RoadRules()
        self._waiting = WaitingMessages(table.receive)
        self.ego = RoadRules(self._given.limits, self._given.signals)
        self.leader = RoadRules(self._given.limits, self._given.signals)
        self._known: dict[float, TimedPhases | None] = {}
        self._now_s = 0.0

    def forget(self) -> None:
        """Forget everything that was heard."""
        self.table.forget()
        self._waiting = WaitingMessages(self.table.receive)
        self.refresh(0, 0.0)

    def receive(self, opened: OpenedDatagram, now_ms: int) -> None:
        """Let a message wait to be decoded; see `RoadsideTable.receive`."""
        if not self.table.repeats(opened) and self._waiting.add(opened, now_ms):
            self.table.rejections.add(Rejection.WAITED)

    def decode(self, now_ms: int) -> None:
        """Decode as many of the waiting messages as the processor time allows; see `WaitingMessages`."""
        self._waiting.decode(now_ms)

    def refresh(self, now_ms: int, ego_position_m: float) -> None:
        """Bring the rules up to date."""
        table = self.table
        table.ego_position_m, self._now_s = ego_position_m, now_ms / 1000.0
        self.decode(now_ms)
        limits = limits_with(self._given.limits, table.stretches(now_ms))
        lines = table.lines()
        known = {line: table.phases_of(line, now_ms) for line in lines}
        given: list[Signal] = [
            signal
            for signal in self._given.signals
            if all(abs(signal.stop_line_m - line.position_m) >= SAME_LINE_M for line in lines)
        ]
        cautious = [_signal(line, phases, surely=True) for line, phases in known.items()]
        likely = [
            _signal(line, phases, surely=False)
            for line, phases in known.items()
            if phases is not None
        ]
        self.ego.limits = self.leader.limits = limits
        self.ego.signals = _in_order([*given, *cautious])
        self.leader.signals = _in_order([*given, *likely])
        self._known = {line.position_m: phases for line, phases in known.items()}

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics: what is known from where, and what was left out."""
        table, following = self.table, self.ego.next_after(self.table.ego_position_m)
        state = "none"
        if following is not None:
            state = "open" if following.is_open(self._now_s) else "closed"
            if following.stop_line_m not in self._known:
                state += " (given)"
            elif self._known[following.stop_line_m] is None:
                state = "unknown, counts as closed"
            else:
                state += " (heard)"
        values: dict[str, object] = {
            f"{kind.name.lower()}_accepted": table.accepted[kind] for kind in ROADSIDE_KINDS
        }
        values |= {
            "roadside_waiting": len(self._waiting),
            "lines_heard": len(self._known),
            "lines_of_unknown_phase": sum(phases is None for phases in self._known.values()),
            "speed_stretches_heard": len(table.stretches(round(1000.0 * self._now_s))),
            "next_line": state,
            "next_line_m": "none" if following is None else following.stop_line_m,
        }
        return values | {f"left_out_{part}": count for part, count in table.left_out.items()}


def _signal(line: StopLine, phases: TimedPhases | None, *, surely: bool) -> Signal:
    """Return a line that is open while all of its groups are."""
    if phases is None:
        return Signal(line.position_m, ALWAYS)
    closed = surely_closed if surely else likely_closed
    spans = (span for group in line.groups for span in closed(phases.groups[group]))
    return Signal(line.position_m, joined(spans))


def _in_order(signals: list[Signal]) -> tuple[Signal, ...]:
    """Return the signals in driving order; of two at one place, the first counts."""
    by_place = {signal.stop_line_m: signal for signal in reversed(signals)}
    return tuple(by_place[place] for place in sorted(by_place))
