"""The preview rule: cubics by hand, s_min behind a braking lead vehicle, and trips without a preview."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_controller.scenes import HERE_M, NOW_S, PARAMETERS, make_state

import iptm
from iptm_controller.rule_preview import gentlest_acceleration_m_s2
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.state import LeaderPreview

HEADWAY_S = 1.6
STANDSTILL_M = PARAMETERS.gap.standstill_gap_m


def found(extra_m: float, ego_m_s: float, leader_m_s: float, known_s: float) -> float:
    """Return the acceleration behind a leader at a steady speed, some metres beyond the desired gap."""
    begin_m = HERE_M + STANDSTILL_M + HEADWAY_S * leader_m_s + extra_m
    times_s = np.arange(0.0, 61.0)
    motion = LeaderPreview(
        NOW_S + times_s, begin_m + leader_m_s * times_s, np.full(times_s.size, leader_m_s)
    )
    state = make_state(speed_m_s=ego_m_s)
    return gentlest_acceleration_m_s2(state, motion, known_s, HEADWAY_S, PARAMETERS, 1.0)


def test_accelerations_by_hand() -> None:
    assert found(0.0, 20.0, 20.0, 60.0) == pytest.approx(0.0)
    # 2 m in 20 s at no change of speed: a h^2 / 6 = 2, so a = 0.03 m/s^2 and falls by 0.003 m/s^3.
    assert found(2.0, 20.0, 20.0, 60.0) == pytest.approx(0.03 - 0.5 * 0.003)
    # 2 m in 10 s: 0.12 m/s^2, falling by 0.024 m/s^3.
    assert found(2.0, 20.0, 20.0, 10.5) == pytest.approx(0.12 - 0.5 * 0.024)
    # In one second the speed is the one of the leader.
    assert found(2.0, 19.0, 20.0, 1.0) == pytest.approx(1.0)


def test_nothing_is_found_without_a_second_of_preview() -> None:
    assert math.isnan(found(0.0, 20.0, 20.0, 0.9))


def test_it_keeps_s_min_and_saves_and_is_a_cruise_control_without_a_preview() -> None:
    trip = {"cycle": "nycc", "duration_s": 300.0}
    foreseen = iptm.simulate(**trip, strategy="rule_preview")
    blind, base = (
        iptm.simulate(**trip, strategy=strategy, preview_mode="none")
        for strategy in ("rule_preview", "production")
    )
    below = [(gap_margins_m(r.trajectory, r.parameters) < -0.05).sum() for r in (foreseen, base)]
    assert below[0] < 0.3 * below[1]
    assert foreseen.metrics.battery_energy_j < 0.95 * base.metrics.battery_energy_j
    assert blind.trajectory.position_m.tolist() == base.trajectory.position_m.tolist()
