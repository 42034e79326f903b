"""Cars that cut in at random: where they fit, how often, and that they leave again."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from iptm.faults.events import BY_HEADWAY, BY_ROOM, CutInLaw, mean_share
from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.faults.signals import Traffic
from iptm_core.state import LeaderPreview, LeaderState

SPEED_M_S = 20.0
BEFORE_M = 500.0
MEDIAN = np.zeros(1)


def own(time_s: float) -> LeaderState:
    return LeaderState(time_s, BEFORE_M + SPEED_M_S * time_s, SPEED_M_S)


def drive(fault: Fault, gap_m: float, seconds: int) -> list[float]:
    """Return by how far the car ahead is nearer than the leader; the ego vehicle keeps a gap to that car."""
    traffic, nearer_m = Traffic([fault]), []
    leader = own(0.0)
    for second in range(seconds):
        leader = traffic.leader(own(second), leader.position_m + SPEED_M_S - gap_m)
        nearer_m.append(own(second).position_m - leader.position_m)
    return nearer_m


def cut_ins(nearer_m: list[float]) -> int:
    return sum(after > before for before, after in pairwise(nearer_m))


@pytest.mark.parametrize(
    ("law", "ego_m_s", "room_m", "share"),
    [
        # 40 m less a car, exp(0.508) and exp(2.02) m; a car in every 4.5 m + 1.84 s exp(0.35²/2) 20 m/s.
        (BY_ROOM, 20.0, 26.30, 26.30 / 43.62),
        # Closing at 3 m/s: exp(2.02 + 3 · 0.188) m behind.
        (BY_ROOM, 23.0, 20.59, 20.59 / 49.50),
        # Twice the median of 1.002 s / sqrt(1 + (0.244 / 1.002)²) at 20 m/s and a car are 43.4 m.
        (BY_HEADWAY, 20.0, -3.44, 0.0),
        (BY_HEADWAY, 16.0, 0.45, 1.0),
    ],
)
def test_room_and_share_of_the_median_driver_by_hand(
    law: CutInLaw, ego_m_s: float, room_m: float, share: float
) -> None:
    found_m, _ = law.room_m(40.0, ego_m_s, 20.0, MEDIAN, MEDIAN)
    assert found_m[0] == pytest.approx(room_m, abs=0.01)
    assert law.share(found_m, ego_m_s)[0] == pytest.approx(share, abs=2e-4)


def test_cars_cut_into_a_gap_for_all_drivers_at_the_rate_over_the_share_of_other_gaps() -> None:
    """At 20 m/s, 40,000 s are 800 km; three standard deviations of the count."""
    faults = [
        Fault(FaultKind.LEADER_CUT_INS_BY_HEADWAY, duration_s=1e5, seed=seed) for seed in range(4)
    ]
    found = sum(cut_ins(drive(fault, 200.0, 10_000)) for fault in faults)
    entered = 800.0 * 7.2 / 100.0 / mean_share(BY_HEADWAY)
    assert found == pytest.approx(entered, abs=3.0 * math.sqrt(entered))


def test_the_larger_the_gap_the_more_cars_cut_in_and_none_where_none_fits() -> None:
    for kind in (FaultKind.LEADER_CUT_INS_BY_ROOM, FaultKind.LEADER_CUT_INS_BY_HEADWAY):
        fault = Fault(kind, duration_s=1e5, size=100.0)
        counts = [cut_ins(drive(fault, gap_m, 3000)) for gap_m in (5.0, 45.0, 120.0)]
        assert counts[0] == 0
        assert 0 < counts[1] < counts[2]


def test_cars_cut_in_between_leave_again_and_are_gone_in_the_end() -> None:
    fault = Fault(FaultKind.LEADER_CUT_INS_BY_ROOM, 10.0, 2000.0, size=200.0)
    nearer_m = drive(fault, 60.0, 2100)
    assert drive(fault, 60.0, 2100) == nearer_m
    assert drive(Fault(fault.kind, 10.0, 2000.0, size=200.0, seed=1), 60.0, 2100) != nearer_m
    steps = np.diff(nearer_m)
    entered = steps[steps > 1e-6]
    assert entered.max() < 60.0  # ahead of the ego vehicle
    assert entered.min() > 4.5  # behind the other car by its own length
    assert steps.min() < 0.0
    assert not any(nearer_m[:11])
    assert not any(nearer_m[2010:])


def test_a_preview_begins_at_the_car_that_was_ahead_when_it_was_made() -> None:
    traffic = Traffic([Fault(FaultKind.LEADER_CUT_INS_BY_ROOM, 0.0, 1e5, size=1000.0)])
    leaders = []
    for second in range(300):
        leaders.append(traffic.leader(own(second), own(second).position_m - 90.0))
        sampled = traffic.sampled(
            LeaderPreview(
                second + np.array([0.0, 0.5]),
                np.full(2, leaders[-1].position_m),
                np.full(2, SPEED_M_S),
            ),
            0.0,
        )
        assert np.ptp(sampled.positions_m) == 0.0  # cars cut in at ticks, not between them
    places = {leader.position_m - own(leader.time_s).position_m for leader in leaders}
    assert len(places) > 3
    for leader in leaders:
        made = own(leader.time_s)
        preview = LeaderPreview(
            np.array([leader.time_s]), np.array([made.position_m]), np.array([SPEED_M_S])
        )
        assert traffic.preview(preview).positions_m[0] == leader.position_m
