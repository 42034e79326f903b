"""The law of car following: what it expects by hand, and within which bounds."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.state import FloatArray
from iptm_its.car_following import PAST_S, TIME_GAPS_S, FollowingLaw, Past, shipped_law, time_gap_s

AGO_S = np.arange(PAST_S + 1.0)


def past(
    speed_m_s: FloatArray | float, ahead_m_s: FloatArray | float, gap_m: FloatArray | float
) -> Past:
    columns = np.broadcast_arrays(speed_m_s, ahead_m_s, gap_m, 0.0 * AGO_S + 1.0)
    return Past(*(np.array(column, dtype=np.float64)[None] for column in columns))


@pytest.mark.parametrize(
    ("gap_m", "expected_s"),
    [(2.0 + 1.5 * 20.0, 1.5), (2.0 + 2.5 * 20.0, 2.456), (3.0, 0.5), (150.0, 4.0)],
)
def test_the_time_gap_is_identified_within_bounds(gap_m: float, expected_s: float) -> None:
    """Eleven measurements at 20 m/s have a weight of 11 x 20²; 200 m²/s² are 1.5 s."""
    found = time_gap_s(past(20.0, 20.0, gap_m))
    assert found == pytest.approx(expected_s, abs=1e-3)
    assert TIME_GAPS_S[0] <= found <= TIME_GAPS_S[1]


def test_steady_following_goes_on() -> None:
    motion = shipped_law().motion(past(20.0, 20.0, 32.0))
    assert motion.driven_m[0, 2] == pytest.approx(40.0, abs=0.3)
    assert motion.driven_m[0, 5] == pytest.approx(100.0, abs=2.0)


def test_a_vehicle_ahead_that_brakes_slows_the_leader_that_does_not_yet() -> None:
    braking = 20.0 - np.maximum(2.0 - 2.0 * AGO_S, 0.0)  # 2 m/s² in the last second
    slower = shipped_law().motion(past(20.0, braking, 32.0)).driven_m[0]
    steady = shipped_law().motion(past(20.0, 20.0, 32.0)).driven_m[0]
    assert np.all(np.diff(steady - slower) >= 0.0)
    assert 0.5 < steady[2] - slower[2] < 4.0  # 2 m/s² for 2 s are 4 m
    assert steady[5] - slower[5] > 5.0


def test_motion_never_goes_backwards_and_bounds_grow() -> None:
    random = np.random.default_rng(1)
    for _ in range(200):
        given = past(*(random.uniform(0.0, top, PAST_S + 1) for top in (40.0, 40.0, 200.0)))
        motion = shipped_law().motion(given)
        assert motion.speeds_m_s.min() >= 0.0
        assert np.diff(motion.driven_m).min() >= 0.0
        assert np.diff(motion.spread_m).min() >= 0.0


def test_a_law_is_the_same_after_writing_and_reading() -> None:
    law = shipped_law()
    again = FollowingLaw.from_json(law.as_json())
    assert again.fitted_to == law.fitted_to
    assert "CC BY 4.0" in law.fitted_to
    for name in ("leads_s", "law", "spread", "half_90", "behind_99"):
        np.testing.assert_array_equal(getattr(again, name), getattr(law, name))
