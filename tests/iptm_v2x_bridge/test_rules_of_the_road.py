"""The rules of the road as the bridge states them: which lines stop the ego, where, and for how long."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.road_ahead import RoadAhead, SpeedLimits
from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.prediction.road_rules import RoadRules, Signal
from iptm_v2x_bridge.rules_of_the_road import EARLY_S, STOP_BEFORE_M, RulesOfTheRoad

LIMITS = SpeedLimits(np.array([0.0]), np.array([14.0]))
PARAMETERS = load_parameters().values
CLOSED = Signal.cyclic(400.0, 1000.0, 900.0, 50.0)
OPEN = Signal.cyclic(400.0, 1000.0, -10.0, 900.0)


class Heard:
    """A bridge that hears of a leader which keeps its speed, foretold for some seconds."""

    def __init__(self, gap_m: float | None, speed_m_s: float = 10.0, known_s: float = 60.0) -> None:
        self.gap_m, self.speed_m_s, self.known_s = gap_m, speed_m_s, known_s

    def answer(
        self,
        time_ns: int,
        ego_position_m: float,
        ego_speed_m_s: float = 0.0,  # noqa: ARG002
    ) -> BridgeAnswer:
        now_s = time_ns / NS_PER_S
        if self.gap_m is None:
            return BridgeAnswer(time_ns, None, LeaderPreview.empty(), lost=False)
        times = now_s + np.arange(0.0, self.known_s + 1.0)
        places = ego_position_m + self.gap_m + self.speed_m_s * (times - now_s)
        preview = LeaderPreview(times, places, np.full(times.size, self.speed_m_s))
        state = LeaderState(now_s, ego_position_m + self.gap_m, self.speed_m_s)
        return BridgeAnswer(time_ns, state, preview, lost=False, predictor="history")


def rules(inner: Heard, signal: Signal, **more: float) -> RulesOfTheRoad:
    return RulesOfTheRoad(inner, RoadRules(LIMITS, (signal,)), PARAMETERS, **more)


def road(
    bridge: RulesOfTheRoad, speed_m_s: float, tick: int = 0, place_m: float = 0.0
) -> RoadAhead:
    found = bridge.answer(tick * NS_PER_S, place_m, speed_m_s).road
    assert found is not None
    return found


def test_a_closed_line_is_a_stop_until_it_opens() -> None:
    found = road(rules(Heard(None), CLOSED), 14.0)
    assert not found.has_leader
    (stop,) = found.stops
    assert stop.position_m == 400.0 - STOP_BEFORE_M
    assert stop.until_s == pytest.approx(900.0 + EARLY_S)


def test_limits_are_those_of_the_road_and_the_lower_ones_of_the_ego() -> None:
    own = SpeedLimits(np.array([0.0, 100.0]), np.array([20.0, 9.0]))
    bridge = RulesOfTheRoad(Heard(None), RoadRules(LIMITS), PARAMETERS, own_limits=own)
    found = road(bridge, 10.0).limits
    assert found is not None
    assert found.at_m_s(np.array([0.0, 99.0, 100.0])).tolist() == [14.0, 14.0, 9.0]


def test_the_same_tick_again_has_the_same_answer() -> None:
    keeping = rules(Heard(None), CLOSED)
    first, again = (keeping.answer(NS_PER_S, 10.0, 10.0) for _ in range(2))
    assert again is first


def test_an_open_line_stops_nobody() -> None:
    assert road(rules(Heard(None), OPEN), 10.0).stops == ()


def test_a_line_beyond_the_foresight_is_not_looked_at() -> None:
    assert road(rules(Heard(None), CLOSED, foresight_s=15.0), 14.0).stops == ()


def test_a_line_that_can_only_be_kept_by_hard_braking_is_passed_unless_it_has_held() -> None:
    """At 14 m/s and 30 m 3.3 m/s2 would be needed; who was held by it before is held on."""
    assert road(rules(Heard(None), CLOSED), 14.0, 0, 370.0).stops == ()
    held = rules(Heard(None), CLOSED)
    assert road(held, 14.0, 0, 300.0).stops
    assert road(held, 14.0, 1, 370.0).stops


def test_the_leader_and_its_preview_stay_as_they_are() -> None:
    inner = Heard(20.0)
    answer, heard = rules(inner, CLOSED).answer(0, 0.0, 10.0), inner.answer(0, 0.0)
    assert answer.leader == heard.leader
    assert answer.preview.positions_m.tolist() == heard.preview.positions_m.tolist()
    assert answer.road is not None
    assert answer.road.has_leader


def test_the_arrival_behind_a_leader_counts() -> None:
    # The leader passes 400 m after 38 s, the ego vehicle would three seconds later; it closes after 40 s.
    signal = Signal.cyclic(400.0, 1000.0, -10.0, 50.0)
    assert road(rules(Heard(20.0), signal), 10.0).stops
    assert road(rules(Heard(None), signal), 14.0).stops == ()


@pytest.mark.parametrize("position_m", [399.0, 400.0])
def test_a_ego_at_the_line_stays_where_it_is(position_m: float) -> None:
    held = rules(Heard(None), CLOSED)
    road(held, 0.0, 0, 395.0)
    stops = road(held, 0.0, 1, position_m).stops
    assert [stop.position_m for stop in stops] == ([position_m] if position_m < 400.0 else [])
