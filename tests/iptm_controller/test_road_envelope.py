"""The road ahead as the problem takes it: what leads, and how fast the ego vehicle may be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.forecast import LeaderForecast, PreviewQuality
from iptm_controller.road_envelope import LAG_M, LAG_S, RoadEnvelope
from iptm_core.road_ahead import RoadAhead, SpeedLimits, Stop
from iptm_core.state import LeaderPreview

GAP = PARAMETERS.gap
LIMITS = SpeedLimits(np.array([0.0]), np.array([14.0]))
FREE = RoadAhead(has_leader=False, limits=LIMITS)


def envelope() -> RoadEnvelope:
    return RoadEnvelope(PARAMETERS, 1.0)


def of_leader(gap_m: float, speed_m_s: float) -> LeaderForecast:
    times = np.arange(0.0, 61.0)
    motion = LeaderPreview(times, gap_m + speed_m_s * times, np.full(61, speed_m_s))
    return LeaderForecast(motion, motion, PreviewQuality.FULL, "", 0.0, 60.0)


def ego(speed_m_s: float, position_m: float = 0.0, time_s: float = 0.0) -> object:
    return make_state(speed_m_s=speed_m_s, position_m=position_m, time_s=time_s)


def test_what_is_followed_is_the_lead_vehicle_or_a_rule() -> None:
    """A desired headway is one to the lead vehicle; rules alone are not followed."""
    road, near, far = envelope(), of_leader(30.0, 10.0), of_leader(300.0, 14.0)
    for forecast, follows in ((near, True), (far, False)):
        motion, _ = road.lead(ego(14.0), FREE, forecast)
        assert road.follows(0.0, motion, forecast) is follows


AHEAD_M = GAP.max_gap_m - LAG_M - LAG_S * 14.0
"""From the pace at 14 m/s to the lead motion."""


def test_on_a_free_road_the_ego_is_not_left_behind_and_makes_up_for_what_it_lost() -> None:
    road = envelope()
    motion, limiting = road.lead(ego(14.0), FREE, None)
    assert limiting is motion
    assert motion.positions_m[0] == pytest.approx(AHEAD_M)
    assert np.diff(motion.positions_m) == pytest.approx(7.0)
    # The pace goes on at 14 m/s while the ego does 12, and never gets ahead of an ego vehicle that halts.
    later, _ = road.lead(ego(12.0, 26.0, 2.0), FREE, None)
    assert later.positions_m[0] == pytest.approx(26.0 + AHEAD_M)
    faster, _ = road.lead(ego(14.0, 60.0, 4.0), FREE, None)
    assert faster.positions_m[0] == pytest.approx(26.0 + 28.0 + AHEAD_M)


def test_the_lead_motion_keeps_the_limits_of_where_the_ego_is() -> None:
    """A limit falls at 200 m: the pace passes there with it, wherever the lead motion is by then."""
    falling = SpeedLimits(np.array([0.0, 200.0]), np.array([14.0, 8.0]))
    motion, _ = envelope().lead(ego(14.0), replace(FREE, limits=falling), None)
    at_limit = motion.times_s[np.argmax(motion.speeds_m_s < 8.01)]
    assert 200.0 / 14.0 < at_limit < 200.0 / 14.0 + 3.0
    assert np.all(np.diff(motion.positions_m) >= 0.0)


def test_a_stop_leads_until_it_opens() -> None:
    road = replace(FREE, stops=(Stop(150.0, 30.0),))
    motion, _ = envelope().lead(ego(14.0), road, None)
    held = motion.times_s < 30.0
    assert motion.positions_m[held].max() == pytest.approx(150.0 + GAP.standstill_gap_m)
    assert motion.speeds_m_s[held][-1] == 0.0
    assert motion.positions_m[-1] > 300.0


def test_the_nearer_one_of_leader_and_stop_binds() -> None:
    near, far = of_leader(40.0, 5.0), of_leader(40.0, 12.0)
    stop = replace(FREE, has_leader=True, stops=(Stop(300.0, math.inf),))
    # The slow leader is still in front of the line after 28 s, the fast one passes it.
    motion, _ = envelope().lead(ego(10.0), stop, near)
    places, _ = motion.at(np.array([0.0, 20.0]))
    assert places == pytest.approx([40.0, 140.0])
    motion, _ = envelope().lead(ego(10.0), stop, far)
    places, speeds = motion.at(np.array([0.0, 60.0]))
    assert places == pytest.approx([40.0, 300.0 + GAP.standstill_gap_m])
    assert speeds[-1] == 0.0


def test_behind_a_leader_that_may_brake_the_rules_lead_no_faster_than_to_its_halt() -> None:
    slow = replace(FREE, has_leader=True, limits=SpeedLimits(np.zeros(1), np.full(1, 10.0)))
    motion, _ = envelope().lead(ego(10.0), slow, of_leader(99.0, 11.0))
    ahead_m = 99.0 + 11.0 * motion.times_s
    halting_m = motion.positions_m + motion.speeds_m_s**2 / 4.0
    assert np.all(halting_m <= ahead_m + 11.0**2 / 4.0 + 1e-6)
    assert motion.speeds_m_s.min() == pytest.approx(
        10.0
    )  # a leader at 11 m/s does not make it slow down


def test_speed_limits_hold_around_the_expected_places() -> None:
    limits = SpeedLimits(np.array([0.0, 100.0, 200.0]), np.array([10.0, 5.0, 20.0]))
    places = np.array([0.0, 20.0, 90.0, 120.0, 204.0, 206.0])
    speeds = np.array([10.0, 10.0, 5.0, 5.0, 5.0, 5.0])
    found = envelope().speed_limits_m_s(
        replace(FREE, limits=limits), (np.arange(6.0), places, speeds)
    )
    # 95 m: 5 m before the lower limit; 199 m: still in it; 201 m: behind it.
    assert found == pytest.approx([10.0, math.sqrt(25.0 + 2.0 * 5.0), 5.0, 5.0, 20.0], rel=1e-6)


def test_a_driver_begins_to_brake_in_time_for_the_jerk_limit() -> None:
    road = envelope()
    limits = PARAMETERS.limits
    for bound in (
        replace(FREE, limits=SpeedLimits(np.array([0.0, 300.0]), np.array([20.0, 8.0]))),
        replace(FREE, limits=SpeedLimits(np.zeros(1), np.full(1, 20.0)), stops=(Stop(300.0, 1e9),)),
    ):
        speed, place, acceleration = 10.0, 0.0, 0.0
        for tick in range(120):
            wanted = road.command_m_s2(ego(speed, place, float(tick)), bound)
            change = wanted - acceleration
            acceleration += min(max(change, -limits.max_jerk_m_s3), limits.max_jerk_m_s3)
            after = max(speed + acceleration, 0.0)
            place, speed = place + 0.5 * (speed + after), after
            assert speed <= bound.limits.at_m_s(np.array([place]))[0] + 0.05
            assert not bound.stops or place <= 301.5
        assert place > 298.0
