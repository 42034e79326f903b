"""What the bridge makes of roadside messages: by hand, without their bits."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime, timezone

import numpy as np
import pytest
from tests.extras.iptm_its.roadside import (
    GREEN,
    LINE_M,
    RED,
    YELLOW,
    Stated,
    lane,
    lanes,
    phases,
)
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_core.road_ahead import SpeedLimits
from iptm_its.interpretation import stop_lines
from iptm_its.mapem import IntersectionMap, Lane
from iptm_its.spatem import (
    IntersectionPhases,
    SignalState,
    minute_of_year,
    resolve_minute_ms,
    resolve_second_s,
    second_of_hour,
)
from iptm_its.table import PHASES_KNOWN_MS, RoadsideTable
from iptm_v2x_bridge.messages.packets import its_timestamp_ms
from iptm_v2x_bridge.prediction.expected_motion import History
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, Observation, PredictorName
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules, Signal
from iptm_v2x_bridge.rejections import Rejection

NOW_MS = its_timestamp_ms(1_790_000_000 * 10**9)
NOW_S = NOW_MS / 1000.0


def heard(
    *messages: IntersectionPhases | IntersectionMap,
    at_ms: int = NOW_MS,
    given: RoadRules | None = None,
) -> RoadsideTable:
    rules = RoadsideTable(ROAD, given)
    for message in messages:
        assert rules.take(message, at_ms) is None
    rules.refresh(at_ms, 0.0)
    return rules


def test_times_of_signals_are_those_of_utc() -> None:
    instant = datetime(2026, 3, 1, 12, 34, 56, 700_000, tzinfo=timezone.utc)
    sent_ms = its_timestamp_ms(round(instant.timestamp() * 1e3) * 10**6)
    assert minute_of_year(sent_ms) == ((31 + 28) * 1440 + 12 * 60 + 34, 56_700)
    assert second_of_hour(sent_ms / 1000.0) == pytest.approx(34 * 60 + 56.7)
    assert resolve_minute_ms(*minute_of_year(sent_ms), sent_ms + 4000) == sent_ms


def test_a_minute_of_the_old_year_is_known_in_the_new_one() -> None:
    new_year = datetime(2027, 1, 1, tzinfo=timezone.utc)
    new_year_ms = its_timestamp_ms(round(new_year.timestamp()) * 10**9)
    for sent_ms, now_ms in (
        (new_year_ms - 700, new_year_ms + 300),
        (new_year_ms + 100, new_year_ms - 50),
    ):
        assert resolve_minute_ms(*minute_of_year(sent_ms), now_ms) == sent_ms


@pytest.mark.parametrize("after_s", [-120.0, 0.0, 9.5, 30.0, 3000.0])
def test_instants_are_found_across_the_full_hour(after_s: float) -> None:
    ten_before_s = NOW_S - second_of_hour(NOW_S) + 3590.0
    for now_s in (ten_before_s, NOW_S):
        second = second_of_hour(now_s + after_s)
        assert resolve_second_s(second, now_s) == pytest.approx(now_s + after_s)


def test_a_line_is_where_its_lane_begins_and_only_the_egos_lane_counts() -> None:
    (line,) = stop_lines(ROAD, lanes())
    assert line.position_m == pytest.approx(LINE_M, abs=0.02)
    assert line.groups == {1}


def test_of_several_connections_the_one_along_the_road_counts() -> None:
    ways = ((2, 1), (7, 4))
    ahead = lanes().lanes[1]
    turning = Lane(7, ((15.0, 5.0), (80.0, 5.0)), leads_out=True)
    ego = Lane(1, ((0.0, -10.0), (0.0, -90.0)), leads_in=True, connections=ways)
    base = lanes()
    for known, groups in (((ego, ahead, turning), {1}), ((ego, turning), {1, 4})):
        (line,) = stop_lines(ROAD, replace(base, lanes=known))
        assert line.groups == groups


def test_lanes_that_come_towards_the_ego_have_no_line_for_it() -> None:
    base = lanes()
    towards = lane(1, ((0.0, 10.0), (0.0, 90.0)))
    assert stop_lines(ROAD, replace(base, lanes=(towards,))) == ()


@pytest.mark.parametrize(
    ("stated", "open_s", "closed_s"),
    [
        # The present phase is sure up to its earliest end.
        ([(GREEN, 10.0, 20.0)], [0.0, 9.0], [10.5, 60.0]),
        # What follows is sure from the latest end before it on.
        ([(RED, 10.0, 20.0), (GREEN, 50.0, 50.0)], [20.5, 49.0], [0.0, 15.0, 51.0]),
        ([(GREEN, 8.0, 8.0), (YELLOW, 12.0, 12.0), (RED, 40.0, 45.0)], [7.0], [9.0, 50.0]),
        # After red without a word on what follows, nothing is known.
        ([(RED, 10.0, 20.0)], [], [0.0, 21.0]),
        # An end that is not stated is none to rely on.
        ([(GREEN, None, None)], [], [0.0, 5.0]),
        ([(RED, 10.0, None), (GREEN, 60.0, 60.0)], [], [30.0, 50.0]),
        # One over an hour ahead is one.
        ([(SignalState.DARK, 50.0, 50.0)], [], [0.0]),
        ([(SignalState.FLASHING_YELLOW, 50.0, 50.0)], [], [0.0]),
    ],
)
def test_the_ego_relies_on_what_is_sure(
    stated: list[Stated], open_s: list[float], closed_s: list[float]
) -> None:
    (signal,) = heard(lanes(), phases(NOW_MS, *stated)).ego.signals
    assert signal.stop_line_m == pytest.approx(LINE_M, abs=0.02)
    assert [signal.is_open(NOW_S + after) for after in open_s] == [True] * len(open_s)
    assert [signal.is_open(NOW_S + after) for after in closed_s] == [False] * len(closed_s)


def test_when_a_line_changes_is_told_to_the_tenth_across_the_hour() -> None:
    full_hour_ms = NOW_MS - round(1000.0 * second_of_hour(NOW_S)) + 3_600_000
    now_ms = full_hour_ms - 5_000
    stated = phases(now_ms, (GREEN, 12.3, 12.3), (RED, 40.0, 40.1), (GREEN, 60.0, 60.0))
    (signal,) = heard(lanes(), stated, at_ms=now_ms).ego.signals
    now_s = now_ms / 1000.0
    assert signal.open_until_s(now_s) - now_s == pytest.approx(12.3, abs=1e-6)
    assert signal.closed_until_s(now_s + 20.0) - now_s == pytest.approx(40.1, abs=1e-6)


@pytest.mark.parametrize("offset_ms", [-500, -200, 0, 200, 500])
@pytest.mark.parametrize("delay_ms", [0, 100])
def test_times_of_a_light_are_corrected_by_the_offset_of_its_clock(
    offset_ms: int, delay_ms: int
) -> None:
    """Closed from 10 s to 20 s: what is open by the own clock is open; at most 0.6 s of it are given away."""
    rules = RoadsideTable(ROAD)
    assert rules.take(lanes(), NOW_MS) is None
    for second in range(5):
        sent_ms = NOW_MS + 1000 * second + offset_ms
        ends = [(10.0, GREEN), (20.0, RED), (40.0, GREEN)]
        stated = [(state, end - second, end - second) for end, state in ends]
        heard_ms = sent_ms - offset_ms + delay_ms
        assert rules.take(phases(sent_ms, *stated), heard_ms) is None
    rules.refresh(heard_ms, 0.0)
    (signal,) = rules.ego.signals
    closed_s = [after for after in np.arange(5.0, 39.0, 0.05) if not signal.is_open(NOW_S + after)]
    delay_s = 1e-3 * delay_ms
    # Ahead, the delay of the fastest message is not known: the line closes later than stated by as much.
    assert closed_s[0] <= 10.0 + delay_s + 0.06
    assert 20.0 - 0.06 <= closed_s[-1] <= 20.0 + 0.5 + delay_s + 0.06


def test_all_groups_of_a_line_have_to_be_open() -> None:
    ways = ((20, 1), (21, 2))
    base = lanes()
    ego = Lane(1, ((0.0, -10.0), (0.0, -90.0)), leads_in=True, connections=ways)
    both = replace(base, lanes=(ego,))
    message = phases(NOW_MS, (GREEN, 30.0, 30.0), groups=(1, 2))
    red = phases(NOW_MS, (RED, 30.0, 30.0), groups=(2,))
    mixed = replace(message, groups=message.groups | red.groups)
    assert heard(both, message).ego.signals[0].is_open(NOW_S + 1.0)
    assert not heard(both, mixed).ego.signals[0].is_open(NOW_S + 1.0)


def test_a_line_whose_phases_are_silent_is_closed_for_the_ego_and_nothing_for_the_leader() -> None:
    rules = heard(lanes(), phases(NOW_MS, (GREEN, 60.0, 60.0)))
    assert rules.report()["next_line"] == "open (heard)"
    later_ms = NOW_MS + PHASES_KNOWN_MS
    rules.refresh(later_ms, 0.0)
    assert rules.ego.signals[0].is_open(later_ms / 1000.0)
    rules.refresh(later_ms + 1, 0.0)
    (signal,) = rules.ego.signals
    assert not signal.is_open(later_ms / 1000.0)
    assert signal.closed_until_s(later_ms / 1000.0) == math.inf
    assert rules.leader.signals == ()
    assert rules.report()["next_line"] == "unknown, counts as closed"
    assert rules.report()["lines_of_unknown_phase"] == 1


@pytest.mark.parametrize("changes", [{"is_working": False}, {"revision": 4}, {"groups": (2, 3)}])
def test_phases_that_do_not_fit_the_line_leave_it_unknown(changes: dict[str, object]) -> None:
    rules = heard(lanes(), phases(NOW_MS, (GREEN, 60.0, 60.0), **changes))  # type: ignore[arg-type]
    assert not rules.ego.signals[0].is_open(NOW_S)
    assert rules.leader.signals == ()


@pytest.mark.parametrize(
    ("sent_ms", "stated", "reason"),
    [
        (NOW_MS + 1000, (GREEN, 20.0, 20.0), Rejection.FUTURE),
        (NOW_MS - 3001, (GREEN, 20.0, 20.0), Rejection.STALE),
        (NOW_MS - 1000, (RED, 20.0, 20.0), Rejection.DUPLICATE),
        (NOW_MS - 1200, (RED, 20.0, 20.0), Rejection.OLDER),
        # Red until 19 s from now at the earliest, and open at once.
        (NOW_MS, (GREEN, 20.0, 20.0), Rejection.PHASE_JUMP),
        (NOW_MS, (RED, 5.0, 30.0), None),
    ],
)
def test_what_cannot_be_true_is_refused(
    sent_ms: int, stated: Stated, reason: Rejection | None
) -> None:
    rules = heard(lanes(), phases(NOW_MS - 1000, (RED, 20.0, 20.0)))
    assert rules.take(phases(sent_ms, stated), NOW_MS) is reason


def test_a_line_may_always_close_earlier() -> None:
    rules = heard(lanes(), phases(NOW_MS - 1000, (GREEN, 20.0, 20.0)))
    assert rules.take(phases(NOW_MS, (YELLOW, 3.0, 3.0)), NOW_MS) is None
    rules.refresh(NOW_MS, 0.0)
    assert not rules.ego.signals[0].is_open(NOW_S)


def test_maps_change_with_their_revision_only() -> None:
    rules = heard(lanes())
    moved = lanes(line_m=LINE_M + 20.0)
    assert rules.take(lanes(), NOW_MS) is None
    assert rules.take(moved, NOW_MS) is Rejection.OTHER_MAP
    assert rules.take(lanes(revision=2, line_m=600.0), NOW_MS) is Rejection.OLDER
    assert rules.take(lanes(revision=4, line_m=600.0), NOW_MS) is None
    rules.refresh(NOW_MS, 0.0)
    assert rules.ego.signals[0].stop_line_m == pytest.approx(600.0, abs=0.02)


GIVEN = RoadRules(
    SpeedLimits(np.array([0.0, 800.0]), np.array([14.0, 20.0])),
    (Signal.cyclic(LINE_M + 2.0, 60.0, 0.0, 60.0), Signal.cyclic(900.0, 60.0, 0.0, 60.0)),
)


def test_what_is_heard_of_a_line_replaces_what_is_given_of_it() -> None:
    rules = heard(lanes(), phases(NOW_MS, (RED, 20.0, 20.0)), given=GIVEN)
    first, second = rules.ego.signals
    assert first.cycle_s is None
    assert second is GIVEN.signals[1]
    assert rules.ego.limits is GIVEN.limits
    assert rules.report()["next_line"] == "closed (heard)"
    rules.refresh(NOW_MS, 600.0)
    assert rules.report()["next_line"] == "open (given)"


def test_the_leader_is_foretold_by_what_is_heard() -> None:
    times = NOW_S + np.arange(0.0, 41.0)
    track = LeaderTrack((Observation(NOW_S, 300.0, 14.0, 0.0),), length_m=5.0)
    silent = BoundedByRules(History(), heard().leader)
    assert silent.predict(track, times) is None
    red = heard(lanes(), phases(NOW_MS, (RED, 30.0, 30.0), (GREEN, 60.0, 60.0))).leader
    bounded = BoundedByRules(History(), red)
    stated = bounded.predict(track, times)
    assert stated is not None
    assert bounded.name is PredictorName.SIGNALS
    assert stated.positions_m[29] + 5.0 <= LINE_M + 0.02
    assert stated.speeds_m_s[40] > 5.0
